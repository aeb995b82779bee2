//! Options about the data of training commands, and the data of a run.

use std::path::Path;

use clap::Args;
use dash_train::dataset::{Dataset, FrameRange, Layout, LoadOptions, load};
use dash_train::device::DeviceChoice;
use dash_train::train::DataConfig;

use crate::configuration::DataSection;
use crate::failure::Failure;
use crate::summary;
use crate::values::{self, CameraList};

/// How a dataset is loaded.
#[derive(Args, Clone)]
pub struct DataArgs {
    /// Indices of the cameras to hold out, such as 0,7, or none; the layout's own choice when left
    /// out
    #[arg(long, value_name = "LIST")]
    test_cameras: Option<CameraList>,
    /// Names of cameras to leave out, of training and of testing, such as cam13
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub drop_cameras: Vec<String>,
    /// Frames to use, such as 151-200, all, or every tenth with all/10; times are over them. Numbers are those of the files, or
    /// count from 0 [default: all, of published Technicolor scenes the published ones]
    #[arg(long, value_name = "FIRST-LAST|all[/N]")]
    pub frames: Option<FrameRange>,
    /// Divide width and height of images by this factor; about 500 pixels on the longer side suit a CPU [default: 1]
    #[arg(long, value_name = "K", value_parser = values::downscale)]
    pub downscale: Option<f64>,
    /// Memory that the dataset's images may take, such as 2GiB; those that don't fit are decoded when
    /// they are needed [default: half of what is free]
    #[arg(long, value_name = "BYTES", value_parser = values::bytes)]
    pub memory: Option<u64>,
    /// White in the pictures of `masks/` marks what does not count, instead of what does
    #[arg(long)]
    pub invert_masks: bool,
    /// Force the dataset's layout instead of recognising it by its files
    #[arg(long, value_enum)]
    pub layout: Option<Layout>,
    /// Leave out views whose image cannot be read, with a warning, instead of stopping
    #[arg(long)]
    pub skip_broken: bool,
}

impl DataArgs {
    /// `--test-cameras`.
    pub fn test_cameras(&self) -> Option<Vec<usize>> {
        self.test_cameras.as_ref().map(|list| list.0.clone())
    }

    /// The dataset, and what a run's `config.toml` says of it; what is not on the command line is taken
    /// from a configuration file's section.
    pub fn load(
        &self,
        dataset: &Path,
        file: &DataSection,
        device: DeviceChoice,
    ) -> Result<(DataConfig, Dataset), Failure> {
        self.load_as(dataset, file, device, false)
    }

    /// The same, to be looked at only: images are decoded once they are asked for.
    pub fn look(
        &self,
        dataset: &Path,
        file: &DataSection,
        device: DeviceChoice,
    ) -> Result<(DataConfig, Dataset), Failure> {
        self.load_as(dataset, file, device, true)
    }

    fn load_as(
        &self,
        dataset: &Path,
        file: &DataSection,
        device: DeviceChoice,
        on_demand: bool,
    ) -> Result<(DataConfig, Dataset), Failure> {
        let mut data = DataConfig {
            dataset: dataset.to_path_buf(),
            layout: self.layout.or(file.layout),
            downscale: self.downscale.or(file.downscale).unwrap_or(1.0),
            test_cameras: self.test_cameras().or_else(|| file.test_cameras.clone()),
            drop_cameras: match self.drop_cameras.as_slice() {
                [] => file.drop_cameras.clone().unwrap_or_default(),
                named => named.to_vec(),
            },
            frames: self.frames.or(file.frames),
            invert_masks: self.invert_masks || file.invert_masks.unwrap_or(false),
            skip_broken: self.skip_broken || file.skip_broken.unwrap_or(false),
            backdrop: None,
            device: device.to_string(),
        };
        let loaded = load_dataset(&data, self.memory, on_demand)?;
        data.dataset = values::absolute(dataset)?;
        Ok((data, loaded))
    }
}

/// The dataset of a run that is there, from where `config.toml` says or from `elsewhere`, loaded as the run did;
/// with `on_demand`, its images only once they are asked for.
pub fn dataset_of(
    data: &DataConfig,
    elsewhere: Option<&Path>,
    on_demand: bool,
) -> Result<Dataset, Failure> {
    let folder = elsewhere.unwrap_or(&data.dataset);
    if elsewhere.is_none() && !folder.is_dir() {
        return Err(Failure::new(format!(
            "{}: expected the run's dataset, found no such folder; if it was moved, say where it is with \
             --dataset DIR",
            folder.display()
        )));
    }
    let options = LoadOptions {
        on_demand,
        ..data.load_options()
    };
    Ok(load(folder, &options)?)
}

/// The dataset of a run that trains; with `on_demand`, its images only once they are asked for.
pub fn load_dataset(
    data: &DataConfig,
    memory: Option<u64>,
    on_demand: bool,
) -> Result<Dataset, Failure> {
    let options = LoadOptions {
        memory,
        on_demand,
        ..data.load_options()
    };
    let dataset = load(&data.dataset, &options)?;
    tracing::debug!(
        "{}: {} views, {}",
        data.dataset.display(),
        dataset.views.len(),
        summary::bytes(dataset.image_bytes())
    );
    Ok(dataset)
}

/// The first option that asks for other data than a run has, and what the run has.
pub fn other_data(args: &DataArgs, data: &DataConfig) -> Option<(&'static str, String)> {
    if args
        .downscale
        .is_some_and(|downscale| downscale != data.downscale)
    {
        return Some(("--downscale", data.downscale.to_string()));
    }
    if args.frames.is_some() && args.frames != data.frames {
        let usual = "the usual ones".into();
        return Some(("--frames", data.frames.map_or(usual, |f| f.to_string())));
    }
    if args.layout.is_some() && args.layout != data.layout {
        let none = "none".into();
        return Some(("--layout", data.layout.map_or(none, |l| l.to_string())));
    }
    if args.skip_broken && !data.skip_broken {
        return Some(("--skip-broken", "every view".into()));
    }
    if args.test_cameras().is_some() && args.test_cameras() != data.test_cameras {
        let usual = "the layout's own".into();
        let cameras = data.test_cameras.as_ref();
        return Some((
            "--test-cameras",
            cameras.map_or(usual, |c| format!("{c:?}")),
        ));
    }
    if !args.drop_cameras.is_empty() && args.drop_cameras != data.drop_cameras {
        let none = "none dropped".to_string();
        let dropped = &data.drop_cameras;
        return Some((
            "--drop-cameras",
            if dropped.is_empty() {
                none
            } else {
                dropped.join(",")
            },
        ));
    }
    (args.invert_masks && !data.invert_masks)
        .then(|| ("--invert-masks", "masks as they are".into()))
}
