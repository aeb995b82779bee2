//! What is wrong with a dataset, and how to mend it.
//!
//! [`examine`] loads a dataset as training would. Each check is a file and gives [`Finding`]s. All checks are
//! deterministic and take samples of large datasets.
//!
//! # Map
//! - `finding`: a finding; `contents`: layout, counts, sizes, times; `masks`, `memory`, `timing`.
//! - `cloud`: the points and the training box; `agreement`: points against the pictures' colours.
//! - `poses`: poses by colours and by axes; `conventions`, `misplaced`: mistakes that would explain them.
//! - `tracks`: one pass over all pictures, for `brightness`, `sync` and `motion`; `small`: what they compare; `span`: what
//!   changes over the clip.
//! - `picture`: the cameras, points and box seen from above and from the side.

mod agreement;
mod brightness;
mod cloud;
mod contents;
mod conventions;
mod finding;
mod masks;
mod memory;
mod misplaced;
mod motion;
mod picture;
mod poses;
mod small;
mod span;
mod sync;
#[cfg(test)]
mod tests;
mod timing;
mod tracks;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use dash_kernels::Camera;
use serde::Serialize;

pub use finding::{Finding, Severity};
pub use timing::TimedOn;

use crate::Error;
use crate::dataset::{
    Dataset, FarScene, Layout, LoadOptions, OddLens, Partition, View, load_decodable, poses_alone,
};
use crate::train::core::shortage::shortages;
use crate::video::write_png;
use cloud::Cloud;
use picture::{DrawnCamera, Sketch};

/// Files that fail alike are named up to this many.
const ALIKE: usize = 3;

/// What was found in a dataset.
#[derive(Debug, Clone, Serialize)]
pub struct Diagnosis {
    /// The dataset's folder.
    pub dataset: PathBuf,
    /// The worst of the findings.
    pub worst: Severity,
    /// One by one, in the order of the checks.
    pub findings: Vec<Finding>,
    #[serde(skip)]
    sketch: Sketch,
}

impl Diagnosis {
    /// Cameras, points and training box from above (left) and from the side (right): points in their
    /// colours, the box green, cameras blue, held out orange, with doubtful poses red. `None` where no camera and no point
    /// could be read.
    pub fn picture(&self) -> Option<image::RgbImage> {
        let has_content = !self.sketch.cameras.is_empty() || !self.sketch.positions.is_empty();
        has_content.then(|| self.sketch.draw())
    }

    /// Writes [`picture`](Self::picture) as a PNG, whole or not at all; says whether there is one.
    ///
    /// # Errors
    /// The system's, naming the file.
    pub fn write_picture(&self, path: &Path) -> Result<bool, Error> {
        let Some(picture) = self.picture() else {
            return Ok(false);
        };
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        write_png(path, width, height, picture.as_raw())?;
        Ok(true)
    }

    /// How many findings are this bad.
    pub fn count(&self, severity: Severity) -> usize {
        let of = self.findings.iter().filter(|f| f.severity == severity);
        of.count()
    }
}

/// Loads the dataset in the folder `root` as training would, and examines it. What can't be loaded is a
/// finding, and what is left is examined all the same. `memory`: what the pictures may take.
///
/// ```
/// use dash_train::dataset::LoadOptions;
/// use dash_train::doctor::{Severity, examine};
///
/// let folder = tempfile::tempdir()?;
/// let diagnosis = examine(folder.path(), &LoadOptions::default(), None);
/// assert_eq!(diagnosis.count(Severity::Error), 1, "an empty folder is no dataset");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn examine(root: &Path, options: &LoadOptions, memory: Option<u64>) -> Diagnosis {
    examine_timed(root, options, memory, None)
}

/// [`examine`], and where something to train on is named, how long training would take on it. That is
/// measured, which takes some seconds, and differs from one time to the next.
pub fn examine_timed(
    root: &Path,
    options: &LoadOptions,
    memory: Option<u64>,
    on: Option<TimedOn>,
) -> Diagnosis {
    let mut findings = Vec::new();
    let mut sketch = Sketch::default();
    let layout = match options.layout {
        Some(layout) => Ok(layout),
        None => Layout::detect(root),
    };
    match layout {
        Err(error) => findings.push(Finding::refused("layout", &error)),
        Ok(layout) => {
            findings.push(contents::layout(root, layout, options.layout.is_some()));
            match load_decodable(root, options) {
                Ok((dataset, broken)) => {
                    sketch = all_checks(&dataset, &broken, memory, &mut findings);
                    findings.extend(on.map(|on| timing::check(&dataset, on)));
                }
                Err(error) => {
                    findings.push(Finding::refused("load", &error));
                    sketch.cameras = poses_only(root, layout, &mut findings);
                    let text = "not estimated, because the dataset can't be loaded";
                    findings.extend(on.map(|_| Finding::note("time", text)));
                }
            }
        }
    }
    let worst = findings.iter().map(|finding| finding.severity).max();
    Diagnosis {
        dataset: root.to_path_buf(),
        worst: worst.unwrap_or(Severity::Ok),
        findings,
        sketch,
    }
}

/// What poses alone tell, where pictures can't be loaded.
fn poses_only(root: &Path, layout: Layout, findings: &mut Vec<Finding>) -> Vec<DrawnCamera> {
    let cameras = match poses_alone(root, layout) {
        Ok(cameras) => cameras.unwrap_or_default(),
        // Already reported: the same file refused loading.
        Err(_) => Vec::new(),
    };
    if !cameras.is_empty() {
        let names: Vec<String> = (0..cameras.len()).map(|i| format!("camera {i}")).collect();
        findings.push(poses::by_axes(&cameras, &names, None, false));
    }
    let drawn = cameras.into_iter().enumerate();
    let drawn = drawn.map(|(index, camera)| DrawnCamera {
        camera,
        name: index.to_string(),
        held_out: false,
        doubtful: false,
    });
    drawn.collect()
}

fn all_checks(
    dataset: &Dataset,
    broken: &[Error],
    memory: Option<u64>,
    findings: &mut Vec<Finding>,
) -> Sketch {
    let looked = tracks::look(dataset);
    check_frames(dataset, broken, &looked, findings);
    let (sketch, gains) = check_geometry(dataset, findings);
    findings.extend(match gains.as_slice() {
        [] => brightness::of_whole_pictures(&looked),
        gains => brightness::between_cameras(gains),
    });
    findings.extend(brightness::along_time(&looked));
    findings.extend(sync::check(&looked));
    findings.extend(motion::check(&looked));
    findings.push(memory::check(dataset, memory));
    sketch
}

/// What can't be read: the first few of each kind, and how many more there are.
fn unreadable<'a>(errors: impl Iterator<Item = &'a Error>) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut seen = BTreeSet::new();
    let mut n_of: BTreeMap<String, usize> = BTreeMap::new();
    for error in errors {
        let finding = Finding::refused("frames", error);
        // Frames of one group of pictures fail for one reason.
        if !seen.insert(finding.text.clone()) {
            continue;
        }
        let n = n_of
            .entry(finding.mend.clone().unwrap_or_default())
            .or_default();
        *n += 1;
        if *n <= ALIKE {
            findings.push(finding);
        }
    }
    for (mend, n) in n_of {
        if n > ALIKE {
            let text = format!("{} more can't be read", n - ALIKE);
            findings.push(Finding::error("frames", text, &mend));
        }
    }
    findings
}

/// What can be decoded, and what the dataset contains.
fn check_frames(
    dataset: &Dataset,
    broken: &[Error],
    looked: &tracks::Tracks,
    findings: &mut Vec<Finding>,
) {
    findings.extend(unreadable(broken.iter().chain(&looked.broken)));
    let whole = broken.is_empty() && looked.broken.is_empty();
    findings.extend(contents::contents(dataset, whole));
    findings.extend(masks::check(dataset, looked));
    if looked.left_out > 0 {
        let text = format!(
            "the last {} frames of each camera were not looked at",
            looked.left_out
        );
        findings.push(Finding::note("frames", text));
    }
}

/// Poses, points and the training box; the exposure of every picture whose pose is sound.
fn check_geometry(dataset: &Dataset, findings: &mut Vec<Finding>) -> (Sketch, Vec<(String, f64)>) {
    let mut cameras: BTreeMap<usize, &View> = BTreeMap::new();
    for view in &dataset.views {
        cameras.entry(view.camera_index).or_insert(view);
    }
    let names: Vec<String> = cameras
        .values()
        .map(|view| view.camera_name.clone())
        .collect();
    let poses: Vec<Camera> = cameras.values().map(|view| view.camera.clone()).collect();

    let cloud = dataset.points.as_ref().map(Cloud::of);
    let pictures = agreement::first_pictures(dataset).unwrap_or_default();
    let verdict = poses::by_colors(cloud.as_ref(), &pictures, dataset.layout == Layout::Colmap);
    findings.push(poses::by_axes(
        &poses,
        &names,
        verdict.sound,
        verdict.explained,
    ));
    if let Some(far) = FarScene::of(&dataset.views, dataset.points.as_ref()) {
        findings.push(Finding::warning("origin", far.text(), &far.mend()));
    }
    if let Some(odd) = OddLens::of(&dataset.views) {
        findings.push(Finding::warning("lens", odd.text(), &odd.mend()));
    }
    findings.extend(cloud::numbers(dataset, cloud.as_ref()));
    findings.extend(
        cloud
            .as_ref()
            .and_then(|cloud| cloud::inside(cloud, &poses)),
    );
    findings.extend(verdict.findings);
    let shortages = shortages(dataset);
    let lacks_all = shortages.iter().any(|shortage| shortage.is_fatal);
    findings.extend(shortages.into_iter().map(Finding::of_shortage));
    let space = match cloud::training_box(dataset) {
        Ok((space, used)) => {
            findings.extend(cloud.as_ref().and_then(|c| cloud::outside(c, &space, used)));
            Some(space)
        }
        Err(error @ Error::TooLittle { .. }) if !lacks_all => {
            findings.push(Finding::refused("points", &error));
            None
        }
        // A picture that can't be read is among the findings already.
        Err(_) => None,
    };
    let drawn = cameras.iter().map(|(index, view)| DrawnCamera {
        camera: view.camera.clone(),
        name: view.camera_name.clone(),
        held_out: view.partition == Partition::Test,
        doubtful: verdict.doubtful.contains(index),
    });
    let (positions, colors) =
        cloud.map_or_else(Default::default, |cloud| (cloud.positions, cloud.colors));
    let sketch = Sketch {
        cameras: drawn.collect(),
        focus: conventions::Meeting::of(&poses).map(|meeting| meeting.point),
        positions,
        colors,
        space,
    };
    (sketch, verdict.gains)
}
