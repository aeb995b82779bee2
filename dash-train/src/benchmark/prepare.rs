//! How a scene is loaded, as its protocol says, and what it lacks of that.

use std::collections::BTreeSet;
use std::path::Path;

use super::{Benchmark, DroppedCamera};
use crate::Error;
use crate::dataset::{Dataset, FrameRange, LoadOptions, Partition, load};
use crate::published::{Protocol, Scene};
use crate::train::DataConfig;

/// A scene before it is trained.
#[derive(Debug, Clone, PartialEq)]
pub struct Prepared {
    /// How it is loaded.
    pub data: DataConfig,
    /// Width and height of its pictures as loaded, pixels.
    pub size: [usize; 2],
    /// Distinct times.
    pub n_frames: usize,
    /// Names of the cameras that are held out; of a dataset that lists its views, how many are.
    pub held_out: Vec<String>,
    /// In what it differs from the protocol.
    pub differs: Vec<String>,
}

impl Prepared {
    /// Looks at a scene's files; its images are not decoded.
    ///
    /// # Errors
    /// When it cannot be loaded, or has no test views.
    pub(super) fn of(benchmark: &Benchmark, scene: &Scene, folder: &Path) -> Result<Self, Error> {
        let protocol = benchmark.protocol.protocol();
        let folder = folder
            .canonicalize()
            .map_err(|e| Error::io(folder, "find", e))?;
        let mut data = DataConfig {
            dataset: folder,
            layout: None,
            downscale: 1.0,
            test_cameras: None,
            drop_cameras: DroppedCamera::of_scene(&benchmark.drop_cameras, scene.name),
            frames: None,
            invert_masks: false,
            skip_broken: false,
            backdrop: None,
            device: benchmark.device.clone(),
        };
        let mut dataset = look(&data)?;
        let is_longer = protocol.n_frames.is_some_and(|n| dataset.n_frames > n);
        if let (Some((first, last)), true) = (scene.frames, is_longer) {
            data.frames = Some(FrameRange::Between { first, last });
            dataset = look(&data)?;
        }
        let wanted = protocol.held_out.unwrap_or_default();
        if !wanted.is_empty() && held_out_numbers(&dataset) != numbers(wanted) {
            data.test_cameras = indices_of(wanted, &data)?;
            dataset = look(&data)?;
        }
        let held_out = held_out(&dataset);
        if held_out.is_empty() {
            return Err(Error::run(
                &data.dataset,
                "expected test views to score, found none; drop other cameras, or complete the scene",
            ));
        }
        let native = size_of(&dataset);
        let wanted_size = upright_as(protocol.size, native);
        data.downscale = (native[0] as f64 / wanted_size[0] as f64).max(1.0);
        let size = native.map(|side| (side as f64 / data.downscale).round().max(1.0) as usize);
        let mut prepared = Self {
            size,
            n_frames: dataset.n_frames,
            held_out,
            differs: Vec::new(),
            data,
        };
        prepared.differs = prepared.differences(protocol, wanted_size, &dataset);
        Ok(prepared)
    }

    /// Options to load the scene with.
    pub(super) fn load_options(&self, memory: Option<u64>) -> LoadOptions {
        LoadOptions {
            memory,
            ..self.data.load_options()
        }
    }

    fn differences(
        &self,
        protocol: &Protocol,
        wanted_size: [usize; 2],
        dataset: &Dataset,
    ) -> Vec<String> {
        let mut differs = Vec::new();
        let ([width, height], [w, h]) = (self.size, wanted_size);
        if self.size != wanted_size {
            differs.push(format!("{width}x{height} pixels instead of {w}x{h}"));
        }
        if let Some(n) = protocol.n_frames.filter(|&n| n != self.n_frames) {
            differs.push(format!("{} frames instead of {n}", self.n_frames));
        }
        let wanted = protocol.held_out.unwrap_or_default();
        if !wanted.is_empty() && held_out_numbers(dataset) != numbers(wanted) {
            let wanted: Vec<String> = wanted.iter().map(ToString::to_string).collect();
            differs.push(format!(
                "held out {} instead of cameras {}",
                self.held_out.join(", "),
                wanted.join(", ")
            ));
        }
        if !self.data.drop_cameras.is_empty() {
            differs.push(format!("without {}", self.data.drop_cameras.join(", ")));
        }
        differs
    }
}

/// The dataset without its pictures.
fn look(data: &DataConfig) -> Result<Dataset, Error> {
    let options = LoadOptions {
        on_demand: true,
        ..data.load_options()
    };
    load(&data.dataset, &options)
}

fn size_of(dataset: &Dataset) -> [usize; 2] {
    let view = &dataset.views[0].camera;
    [view.width, view.height]
}

/// The size, lying or standing as another one does.
fn upright_as([w, h]: [usize; 2], [width, height]: [usize; 2]) -> [usize; 2] {
    if (w < h) == (width < height) || width == height {
        [w, h]
    } else {
        [h, w]
    }
}

/// Names of the cameras of the test views.
fn held_out(dataset: &Dataset) -> Vec<String> {
    let views = dataset.views_of(Partition::Test);
    let names: BTreeSet<(usize, &str)> = views
        .map(|view| (view.camera_index, view.camera_name.as_str()))
        .collect();
    names
        .into_iter()
        .map(|(_, name)| name.to_string())
        .collect()
}

/// The numbers in the names of the held-out cameras.
fn held_out_numbers(dataset: &Dataset) -> BTreeSet<Option<u64>> {
    let names = held_out(dataset);
    names.iter().map(|name| number(name)).collect()
}

fn numbers(wanted: &[u64]) -> BTreeSet<Option<u64>> {
    wanted.iter().map(|&number| Some(number)).collect()
}

/// The number at a name's end: 13 of `cam13`.
fn number(name: &str) -> Option<u64> {
    let digits = name.rsplit(|c: char| !c.is_ascii_digit()).next()?;
    digits.parse().ok()
}

/// Indices of the cameras with these numbers, among all that are there; `None` where there is none.
fn indices_of(wanted: &[u64], data: &DataConfig) -> Result<Option<Vec<usize>>, Error> {
    // Indices count the cameras that are dropped, too.
    let whole = look(&DataConfig {
        drop_cameras: Vec::new(),
        ..data.clone()
    })?;
    let found: BTreeSet<usize> = whole
        .views
        .iter()
        .filter(|view| number(&view.camera_name).is_some_and(|number| wanted.contains(&number)))
        .map(|view| view.camera_index)
        .collect();
    Ok((!found.is_empty()).then(|| found.into_iter().collect()))
}
