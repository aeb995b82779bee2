//! The cameras of a `transforms*.json` (NeRF, D-NeRF, Blender, nerfstudio), to render from.

use std::path::{Component, Path, PathBuf};

use dash_kernels::Camera;

use super::CameraEntry;
use crate::Error;
use crate::dataset::Dataset;
use crate::dataset::pixels::dimensions;
use crate::dataset::poses::transforms::{Frame, Transforms, parse};
use crate::files::find_image;

/// By this share of the clip a time may lie outside it, as rounded ones do.
const ROUNDING: f64 = 1e-6;

/// What a `transforms*.json` with further cameras of a dataset leaves to it: the size of pictures where the
/// file states none, and what its times mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DatasetTerms {
    /// Width and height of the pictures as loaded, where all have one size.
    pub size: Option<(usize, usize)>,
    /// The factor by which they were made smaller on loading.
    pub downscale: f64,
    /// The first and the last stated time, where times were stretched over [0, 1].
    pub stated_span: Option<[f64; 2]>,
}

impl DatasetTerms {
    /// Those of a dataset that was loaded at `downscale`.
    pub fn of(dataset: &Dataset, downscale: f64) -> Self {
        let mut sizes = dataset
            .views
            .iter()
            .map(|view| (view.camera.width, view.camera.height));
        let first = sizes.next();
        Self {
            size: first.filter(|first| sizes.all(|size| size == *first)),
            downscale,
            stated_span: dataset.stated_span,
        }
    }

    /// The size as loaded, and before that, to about a pixel.
    fn sizes(&self) -> Option<[(usize, usize); 2]> {
        let before = |side: usize| (side as f64 * self.downscale).round() as usize;
        let (width, height) = self.size?;
        Some([(width, height), (before(width), before(height))])
    }

    /// A stated time in [0, 1], or what is wrong with it.
    fn unit_time(dataset: Option<&Self>, stated: f64) -> Result<f64, String> {
        let span = dataset.and_then(|terms| terms.stated_span);
        let [first, last] = span.unwrap_or([0.0, 1.0]);
        let length = if last > first { last - first } else { 1.0 };
        let time = (stated - first) / length;
        if (-ROUNDING..=1.0 + ROUNDING).contains(&time) {
            return Ok(time.clamp(0.0, 1.0));
        }
        Err(match span {
            Some(_) => format!(
                "expected a time from {first} to {last} as in the run's dataset, found {stated}; leave \
                 the frame out"
            ),
            None => format!(
                "expected `time` from 0 to 1 over the clip, found {stated}; divide by the clip's length"
            ),
        })
    }
}

/// A file with at least one frame.
#[derive(Debug)]
pub(super) struct TransformsFile {
    path: PathBuf,
    listed: Transforms,
}

impl TransformsFile {
    pub(super) fn read(path: &Path) -> Result<Self, Error> {
        let listed = parse(path)?;
        listed.warn_of_keys(path);
        Ok(Self {
            path: path.to_path_buf(),
            listed,
        })
    }

    /// The cameras in the terms of a dataset; without one, times are in [0, 1].
    pub(super) fn cameras(
        &self,
        dataset: Option<&DatasetTerms>,
    ) -> Result<Vec<CameraEntry>, Error> {
        let frames = &self.listed.frames;
        let has_number = |frame: &Frame| frame.time.is_none() && frame.timestep_index().is_some();
        let numbered = frames.iter().all(has_number);
        frames
            .iter()
            .enumerate()
            .map(|(index, frame)| {
                let stated = match numbered {
                    true => frame.timestep_index(),
                    false => frame.time,
                };
                let time = stated.map(|stated| DatasetTerms::unit_time(dataset, stated));
                let refused = |what| Error::Camera {
                    path: self.path.clone(),
                    index,
                    name: format!(" ({})", frame.file_path),
                    what,
                };
                Ok(CameraEntry {
                    id: index as u64,
                    img_name: name_of(frame).unwrap_or_else(|| format!("camera{index:02}")),
                    camera: self.camera(frame, dataset)?,
                    time: time.transpose().map_err(refused)?,
                })
            })
            .collect()
    }

    /// The camera without its lens's distortion. Its size is the file's, else that of the dataset's loaded pictures,
    /// else that of the frame's own picture.
    fn camera(&self, frame: &Frame, dataset: Option<&DatasetTerms>) -> Result<Camera, Error> {
        let mut loaded = None;
        let size = || match dataset.and_then(DatasetTerms::sizes) {
            // Focal lengths in pixels are those of the pictures before they were made smaller.
            Some([smaller, before]) => {
                loaded = Some(smaller);
                Ok(before)
            }
            None => self.picture_size(frame),
        };
        let (mut camera, distortion) = self.listed.camera(&self.path, frame, size)?;
        if !distortion.is_negligible() {
            camera = distortion.pinhole(&camera, &self.path)?;
        }
        Ok(match loaded {
            Some((width, height)) => camera.resized(width, height),
            None => camera,
        })
    }

    fn picture_size(&self, frame: &Frame) -> Result<(usize, usize), Error> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let picture = folder.join(frame.file_path.replace('\\', "/"));
        let size = find_image(picture, &self.path).and_then(|picture| dimensions(&picture));
        size.map_err(|_| {
            Error::invalid(
                &self.path,
                "the size of each picture as `w` and `h`, or a picture where `file_path` says",
                format!("neither in frame `{}`", frame.file_path),
                "add `w` and `h`",
            )
        })
    }
}

/// The last two parts of the picture's path without extension.
fn name_of(frame: &Frame) -> Option<String> {
    let path = PathBuf::from(frame.file_path.replace('\\', "/")).with_extension("");
    let parts: Vec<&str> = path
        .components()
        .filter_map(|part| match part {
            Component::Normal(name) => name.to_str(),
            _ => None,
        })
        .collect();
    let last = &parts[parts.len().saturating_sub(2)..];
    (!last.is_empty()).then(|| last.join("/"))
}

#[cfg(test)]
mod tests {
    use super::super::{CameraFile, read_cameras};
    use super::*;

    /// Looks along -z from (1, 2, 4), as OpenGL's axes do by themselves.
    const POSE: &str = "[[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 4], [0, 0, 0, 1]]";
    /// The focal length is half the picture's width.
    const RIGHT_ANGLE: f64 = std::f64::consts::FRAC_PI_2;

    /// A folder with `transforms.json` of these top-level fields, and one frame for each string of
    /// fields.
    fn file(shared: &str, frames: &[&str]) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join("transforms.json");
        let frames: Vec<String> = frames
            .iter()
            .enumerate()
            .map(|(n, fields)| {
                let fixed =
                    format!("\"file_path\": \"./test/r_{n}\", \"transform_matrix\": {POSE}");
                format!("{{{fixed}{fields}}}")
            })
            .collect();
        let text = format!("{{{shared}, \"frames\": [{}]}}", frames.join(", "));
        std::fs::write(&path, text).expect("a scratch file");
        (folder, path)
    }

    fn angle() -> String {
        format!("\"camera_angle_x\": {RIGHT_ANGLE}")
    }

    fn complaint(shared: &str, frames: &[&str], dataset: Option<&DatasetTerms>) -> String {
        let (_folder, path) = file(shared, frames);
        let read = CameraFile::read(&path).and_then(|file| file.cameras(dataset));
        let error = read.expect_err("must be refused").to_string();
        assert!(error.contains("transforms.json"), "{error}");
        error
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    #[test]
    fn a_frame_by_hand() {
        let shared = format!("{}, \"w\": 80, \"h\": 60.0", angle());
        let (_folder, path) = file(&shared, &[", \"time\": 0.25", ""]);
        let cameras = read_cameras(&path).expect("a valid file");
        let named: Vec<(u64, &str, Option<f64>)> = cameras
            .iter()
            .map(|entry| (entry.id, entry.img_name.as_str(), entry.time))
            .collect();
        assert_eq!(named, [(0, "test/r_0", Some(0.25)), (1, "test/r_1", None)]);
        let camera = &cameras[0].camera;
        assert_eq!((camera.width, camera.height), (80, 60));
        assert!(close(camera.fx, 40.0) && close(camera.fy, 40.0));
        assert_eq!((camera.cx, camera.cy), (40.0, 30.0));
        assert_eq!(camera.position(), [1.0, 2.0, 4.0]);
        assert_eq!(camera.forward(), [0.0, 0.0, -1.0]);
    }

    #[test]
    fn what_it_leaves_open_is_as_in_the_dataset() {
        let terms = DatasetTerms {
            size: Some((40, 30)),
            downscale: 2.0,
            stated_span: Some([10.0, 30.0]),
        };
        let of = |shared: &str, frames: &[&str]| {
            let (_folder, path) = file(shared, frames);
            let file = CameraFile::read(&path).expect("read");
            assert!(file.is_transforms());
            file.cameras(Some(&terms)).expect("complete")
        };
        let times = [", \"time\": 10", ", \"time\": 15", ", \"time\": 30.000001"];
        let cameras = of(&angle(), &times);
        let found: Vec<Option<f64>> = cameras.iter().map(|entry| entry.time).collect();
        assert_eq!(found, [Some(0.0), Some(0.25), Some(1.0)]);
        let camera = &cameras[0].camera;
        assert_eq!((camera.width, camera.height), (40, 30));
        assert!(close(camera.fx, 20.0), "{}", camera.fx);
        // In pixels of the whole pictures, 80x60.
        let camera = &of("\"fl_x\": 50, \"cx\": 44", &[""])[0].camera;
        assert_eq!((camera.fx, camera.cx, camera.cy), (25.0, 22.0, 15.0));
        // A size that is stated is that of the pictures.
        let stated = format!("{}, \"w\": 64, \"h\": 48", angle());
        let camera = &of(&stated, &[""])[0].camera;
        assert_eq!((camera.width, camera.height), (64, 48));
        // Numbers of times serve where there are no times.
        let cameras = of(&angle(), &[", \"timestep_index\": 20"]);
        assert_eq!(cameras[0].time, Some(0.5));

        let error = complaint(&angle(), &["", ", \"time\": 9.5"], Some(&terms));
        let expected = "camera 1 (./test/r_1): expected a time from 10 to 30";
        assert!(error.contains(expected), "{error}");
    }

    #[test]
    fn without_a_dataset_size_and_time_must_be_there() {
        let error = complaint(&angle(), &[""], None);
        assert!(error.contains("neither in frame `./test/r_0`"), "{error}");
        let sized = format!("{}, \"w\": 8, \"h\": 6", angle());
        let error = complaint(&sized, &[", \"time\": 15"], None);
        assert!(error.contains("from 0 to 1 over the clip"), "{error}");

        let (folder, path) = file(&angle(), &[""]);
        std::fs::create_dir(folder.path().join("test")).expect("a scratch folder");
        let picture = folder.path().join("test/r_0.png");
        image::RgbImage::new(12, 10).save(picture).expect("saved");
        let camera = &read_cameras(&path).expect("sized by the picture")[0].camera;
        assert_eq!((camera.width, camera.height), (12, 10));
    }

    #[test]
    fn lenses_are_undone_as_those_of_a_dataset() {
        let lens = |k1: f64| format!("{}, \"w\": 80, \"h\": 60, \"k1\": {k1}", angle());
        let (_folder, path) = file(&lens(0.1), &[""]);
        let camera = &read_cameras(&path).expect("a mild lens")[0].camera;
        assert!(camera.fx > 40.1 && close(camera.fx, camera.fy));
        let error = complaint(&lens(-5.0), &[""], None);
        assert!(error.contains("lens distortion"), "{error}");
        let fisheye = format!("{}, \"is_fisheye\": true", lens(0.0));
        assert!(complaint(&fisheye, &[""], None).contains("fisheye"));
    }
}
