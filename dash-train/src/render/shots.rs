//! Which cameras at which times.

use std::path::Path;

use dash_kernels::Camera;

use crate::TrainError;
use crate::cameras::{read_cameras, spiral};
use crate::dataset::{Dataset, Split};

/// One picture to take.
#[derive(Debug, Clone, PartialEq)]
pub struct Shot {
    /// The camera's name, which names the picture's file.
    pub camera_name: String,
    /// The camera.
    pub camera: Camera,
    /// In [0, 1].
    pub time: f32,
}

/// The views of a dataset's test split, at their own times.
pub fn test_shots(dataset: &Dataset) -> Vec<Shot> {
    dataset
        .split(Split::Test)
        .map(|view| Shot {
            camera_name: view.camera_name.clone(),
            camera: view.camera.clone(),
            time: view.time,
        })
        .collect()
}

/// The cameras of a `cameras.json`, at their own times or else at 0.
///
/// # Errors
/// When the file can't be read, or a time is outside [0, 1].
pub fn file_shots(path: &Path) -> Result<Vec<Shot>, TrainError> {
    read_cameras(path)?
        .into_iter()
        .map(|entry| {
            let time = entry.time.unwrap_or(0.0);
            if !(0.0..=1.0).contains(&time) {
                let name = &entry.img_name;
                return Err(TrainError::run(
                    path,
                    format!("camera `{name}`: expected a time in [0, 1], found {time}; mend it"),
                ));
            }
            Ok(Shot {
                camera_name: entry.img_name,
                camera: entry.camera,
                time: time as f32,
            })
        })
        .collect()
}

/// `n` cameras on a path amid the dataset's, times even from 0 to 1.
pub fn spiral_shots(dataset: &Dataset, n: usize) -> Vec<Shot> {
    let mut cameras: Vec<Camera> = Vec::new();
    for view in &dataset.views {
        if !cameras.contains(&view.camera) {
            cameras.push(view.camera.clone());
        }
    }
    spiral(&cameras, n, None)
        .into_iter()
        .enumerate()
        .map(|(step, camera)| Shot {
            camera_name: "spiral".into(),
            camera,
            time: even_time(step, n),
        })
        .collect()
}

/// Each of the shots' cameras at each of `n` times, evenly from 0 to 1 (0 for a single one); one
/// camera after the other, a camera that occurs more than once only once.
pub fn at_times(shots: &[Shot], n: usize) -> Vec<Shot> {
    let mut cameras: Vec<&Shot> = Vec::new();
    for shot in shots {
        let known =
            |other: &&Shot| other.camera_name == shot.camera_name && other.camera == shot.camera;
        if !cameras.iter().any(known) {
            cameras.push(shot);
        }
    }
    cameras
        .into_iter()
        .flat_map(|shot| {
            (0..n).map(move |frame| Shot {
                time: even_time(frame, n),
                ..shot.clone()
            })
        })
        .collect()
}

/// The time of one of `n` even steps from 0 to 1.
fn even_time(step: usize, n: usize) -> f32 {
    if n > 1 {
        (step as f64 / (n - 1) as f64) as f32
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_camera_sees_every_time_once() {
        let shot = |name: &str, x: f64, time| Shot {
            camera_name: name.into(),
            camera: Camera {
                translation: [x, 0.0, 0.0],
                ..Camera::new(9.0, 9.0, 4.0, 3.0, 8, 6)
            },
            time,
        };
        let shots = [
            shot("a", 0.0, 0.0),
            shot("a", 0.0, 0.4),
            shot("b", 1.0, 0.0),
        ];
        let names = |shots: &[Shot]| {
            shots
                .iter()
                .map(|s| (s.camera_name.clone(), s.time))
                .collect::<Vec<_>>()
        };
        let a = |time| ("a".to_string(), time);
        let b = |time| ("b".to_string(), time);
        assert_eq!(
            names(&at_times(&shots, 3)),
            [a(0.0), a(0.5), a(1.0), b(0.0), b(0.5), b(1.0)]
        );
        assert_eq!(names(&at_times(&shots, 1)), [a(0.0), b(0.0)]);
    }
}
