//! The settings of `prepare`.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use clap::ValueEnum;

use super::frames::FrameSize;
use crate::Error;
use crate::files::parse_json;

/// COLMAP's camera models that datasets are read with.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum CameraModel {
    /// One focal length, no distortion.
    SimplePinhole,
    /// Two focal lengths, no distortion.
    Pinhole,
    /// One focal length, one coefficient of radial distortion.
    SimpleRadial,
    /// One focal length, two coefficients of radial distortion.
    Radial,
    /// Two focal lengths, two radial and two tangential coefficients.
    #[default]
    Opencv,
}

impl CameraModel {
    /// COLMAP's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::SimplePinhole => "SIMPLE_PINHOLE",
            Self::Pinhole => "PINHOLE",
            Self::SimpleRadial => "SIMPLE_RADIAL",
            Self::Radial => "RADIAL",
            Self::Opencv => "OPENCV",
        }
    }
}

/// Whether cameras share one lens.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum LensChoice {
    /// Shared if all images have one size; if that fails, one for each camera.
    #[default]
    Auto,
    /// All cameras have the same lens at the same zoom.
    Shared,
    /// Each camera has its own.
    Own,
}

/// The settings of `prepare`.
#[derive(Debug, Clone, PartialEq)]
pub struct PrepareConfig {
    /// Frames a second; the lowest rate among the recordings when `None`.
    pub fps: Option<f64>,
    /// Frames a second of folders of images.
    pub image_rate: f64,
    /// Size of the frames.
    pub size: FrameSize,
    /// Start of the clip in the rig's time, seconds.
    pub start: Option<f64>,
    /// End of the clip, seconds.
    pub end: Option<f64>,
    /// JSON file of seconds by camera name: the recording's own time minus the rig's time.
    pub offsets: Option<PathBuf>,
    /// Known poses: `poses_bounds.npy`, `transforms.json` or the folder of a COLMAP model.
    pub poses: Option<PathBuf>,
    /// Lens model for structure from motion.
    pub camera_model: CameraModel,
    /// Whether cameras share it.
    pub lens: LensChoice,
    /// This many random points instead of triangulated ones.
    pub random_points: Option<usize>,
    /// At most this many points are kept.
    pub max_points: usize,
    /// Indices of the cameras to hold out for testing.
    pub test_cameras: Vec<usize>,
    /// Seed of the random points.
    pub seed: u64,
}

impl Default for PrepareConfig {
    fn default() -> Self {
        Self {
            fps: None,
            image_rate: 30.0,
            size: FrameSize::Recorded,
            start: None,
            end: None,
            offsets: None,
            poses: None,
            camera_model: CameraModel::default(),
            lens: LensChoice::default(),
            random_points: None,
            max_points: 100_000,
            test_cameras: vec![0],
            seed: 0,
        }
    }
}

/// The most points that are asked for.
const MAX_POINTS: usize = 10_000_000;

impl PrepareConfig {
    /// Checks what does not depend on the input.
    ///
    /// # Errors
    /// Names the option and says what would fit.
    pub fn validate(&self) -> Result<(), Error> {
        let rates = [("--fps", self.fps), ("--image-fps", Some(self.image_rate))];
        for (option, rate) in rates {
            if let Some(rate) = rate.filter(|rate| !(*rate > 0.0 && *rate <= 1e4)) {
                let expected = "a number of frames a second above 0, at most 10000";
                return Err(Error::setting(option, expected, rate));
            }
        }
        for (option, time) in [("--start", self.start), ("--end", self.end)] {
            if let Some(time) = time.filter(|time| !time.is_finite()) {
                return Err(Error::setting(option, "a time in seconds", time));
            }
        }
        if let (Some(start), Some(end)) = (self.start, self.end)
            && end < start
        {
            let expected = format!("a time not before --start {start}");
            return Err(Error::setting("--end", expected, end));
        }
        match self.size {
            FrameSize::Height(0) => {
                return Err(Error::setting("--height", "at least 1 pixel", 0));
            }
            FrameSize::Downscale(factor) if !(factor >= 1.0 && factor.is_finite()) => {
                let expected = "a factor of at least 1";
                return Err(Error::setting("--downscale", expected, factor));
            }
            _ => {}
        }
        let counts = [
            ("--random-points", self.random_points),
            ("--max-points", Some(self.max_points)),
        ];
        for (option, count) in counts {
            if let Some(count) = count.filter(|count| !(1..=MAX_POINTS).contains(count)) {
                let expected = format!("from 1 to {MAX_POINTS} points");
                return Err(Error::setting(option, expected, count));
            }
        }
        if self.random_points.is_some() && self.poses.is_none() {
            return Err(Error::setting(
                "--random-points",
                "known poses too (--poses), since random points have nothing to find poses by",
                "none",
            ));
        }
        Ok(())
    }
}

/// For each of `n` cameras whether it is held out.
pub(super) fn held_out(indices: &[usize], n: usize) -> Result<Vec<bool>, Error> {
    let mut held_out = vec![false; n];
    for &index in indices {
        match held_out.get_mut(index) {
            Some(held_out) => *held_out = true,
            None => {
                let expected = format!("camera indices from 0 to {}", n.saturating_sub(1));
                return Err(Error::setting("--test-cameras", expected, index));
            }
        }
    }
    if held_out.iter().all(|&held_out| held_out) {
        let expected = "at least one camera to train on";
        return Err(Error::setting(
            "--test-cameras",
            expected,
            format!("all {n} held out"),
        ));
    }
    Ok(held_out)
}

/// The seconds of each camera, zero where the file has none.
pub(super) fn read_offsets(path: &Path, names: &[String]) -> Result<Vec<f64>, Error> {
    let bytes = fs::read(path).map_err(Error::access(path))?;
    let malformed = |found: String| {
        Error::invalid(
            path,
            "JSON with seconds by camera, such as {\"cam01\": 0.033}",
            found,
            format!("mend the file; the cameras are {}", names.join(", ")),
        )
    };
    let offsets: BTreeMap<String, f64> =
        parse_json(&bytes).map_err(|e| malformed(e.to_string()))?;
    if let Some(unknown) = offsets.keys().find(|name| !names.contains(name)) {
        return Err(malformed(format!(
            "`{unknown}`, which is no camera of the input"
        )));
    }
    Ok(names
        .iter()
        .map(|name| offsets.get(name).copied().unwrap_or(0.0))
        .collect())
}
