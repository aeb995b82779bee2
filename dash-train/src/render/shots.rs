//! Which cameras at which times.

use dash_kernels::Camera;

use crate::Error;
use crate::cameras::{CameraFile, DatasetTerms, spiral};
use crate::dataset::{Dataset, Layout, Partition};

/// One picture to take.
#[derive(Debug, Clone, PartialEq)]
pub struct Shot {
    /// The camera's name.
    pub camera_name: String,
    /// Name of the picture's file: the camera's, or that of the image captured by it at that time.
    pub name: String,
    /// The camera.
    pub camera: Camera,
    /// In [0, 1].
    pub time: f32,
}

/// The test views of a dataset, at their own times.
pub fn test_shots(dataset: &Dataset) -> Vec<Shot> {
    dataset
        .views_of(Partition::Test)
        .map(|view| Shot {
            camera_name: view.camera_name.clone(),
            name: match dataset.layout {
                // Its cameras have no names of their own, its images have.
                Layout::Blender => view.name.clone(),
                _ => view.camera_name.clone(),
            },
            camera: view.camera.clone(),
            time: view.time,
        })
        .collect()
}

/// The cameras of a file, at their own times or else at 0; those of a `transforms*.json` in the terms of a
/// dataset, where there is one.
///
/// # Errors
/// When a camera of a `transforms*.json` can't be used.
pub fn file_shots(file: CameraFile, dataset: Option<&DatasetTerms>) -> Result<Vec<Shot>, Error> {
    let cameras = file.cameras(dataset)?.into_iter();
    Ok(cameras
        .map(|entry| Shot {
            camera_name: entry.img_name.clone(),
            name: entry.img_name,
            camera: entry.camera,
            time: entry.time.unwrap_or(0.0) as f32,
        })
        .collect())
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
            name: "spiral".into(),
            camera,
            time: even_time(step, n),
        })
        .collect()
}

/// Each of the shots' cameras at each of `n` times, evenly from 0 to 1 (0 for a single one); one
/// camera after the other, a camera that occurs more than once, be it under other names, only once.
pub fn at_times(shots: &[Shot], n: usize) -> Vec<Shot> {
    let mut cameras: Vec<&Shot> = Vec::new();
    for shot in shots {
        if !cameras.iter().any(|other| other.camera == shot.camera) {
            cameras.push(shot);
        }
    }
    cameras
        .into_iter()
        .flat_map(|shot| {
            (0..n).map(move |frame| Shot {
                name: shot.camera_name.clone(),
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
            name: format!("{name}/image"),
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
            // Each frame of a `transforms.json` has a name of its own.
            shot("c", 1.0, 0.7),
        ];
        let names = |shots: &[Shot]| {
            shots
                .iter()
                .map(|s| (s.name.clone(), s.time))
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
