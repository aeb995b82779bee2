//! Preparation of videos and images that the tests write, with a made-up COLMAP.

mod cloud;
mod known_poses;
mod made_up_colmap;
mod recordings;
mod schedule;

use std::fs;
use std::ops::Deref;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use super::{PrepareConfig, PrepareSummary, prepare};
use crate::Error;
use crate::dataset::pixels::distortion::Distortion;
use crate::dataset::poses::known::KnownCamera;
use crate::test_kit::Fixture;

/// Size of the images.
const W: usize = 16;
const H: usize = 12;

/// A folder with recordings, and what is prepared of them.
struct Bench(Fixture);

impl Deref for Bench {
    type Target = Fixture;

    fn deref(&self) -> &Fixture {
        &self.0
    }
}

impl Bench {
    fn new() -> Self {
        Self(Fixture::new())
    }

    /// A grey image.
    fn image(&self, name: &str, shade: u8) {
        self.0.image(name, W, H, [shade; 3]);
    }

    /// `input/cam0/0000.png` and so on; the shade is `40 * camera + frame`.
    fn image_folders(&self, n_cameras: usize, n_frames: usize) {
        for camera in 0..n_cameras {
            for frame in 0..n_frames {
                let name = format!("input/cam{camera}/{frame:04}.png");
                self.image(&name, (40 * camera + frame) as u8);
            }
        }
    }

    /// `poses.json` in the form of nerfstudio, with the names of the cameras.
    fn poses(&self, n_cameras: usize) -> PathBuf {
        let frames: Vec<_> = (0..n_cameras)
            .map(|index| frame(index, &known(index)))
            .collect();
        self.write(
            "poses.json",
            serde_json::json!({ "frames": frames }).to_string(),
        )
    }

    fn prepare(&self, config: &PrepareConfig) -> Result<PrepareSummary, Error> {
        prepare(&self.path("input"), &self.path("out/made"), config)
    }

    /// The message with which preparation fails; every word must be in it, and nothing be left behind.
    #[track_caller]
    fn refuses(&self, config: &PrepareConfig, words: &[&str]) {
        let error = self.prepare(config).expect_err("must not prepare");
        self.check_refusal(&error, words);
    }

    #[track_caller]
    fn check_refusal(&self, error: &Error, words: &[&str]) {
        let message = error.to_string();
        for word in words {
            assert!(message.contains(word), "`{word}` is not in: {message}");
        }
        let left = fs::read_dir(self.path("out/made").parent().expect("a folder"));
        assert_eq!(
            left.expect("listed").count(),
            0,
            "left behind by: {message}"
        );
    }

    /// The shades of a camera's frames.
    fn shades(&self, camera: &str) -> Vec<u8> {
        let folder = self.path(&format!("out/made/{camera}/images"));
        let images = crate::files::list_images(&folder).expect("listed");
        let shade = |path: &PathBuf| {
            image::open(path)
                .expect("an image")
                .to_rgb8()
                .get_pixel(2, 2)
                .0[0]
        };
        images.iter().map(shade).collect()
    }
}

/// Cameras on an arc that look at the origin, with distortion and a principal point of their own.
fn known(index: usize) -> KnownCamera {
    let angle = 0.3 * index as f64;
    let eye = [4.0 * angle.sin(), -1.0, -4.0 * angle.cos()];
    let camera = Camera::new(20.0, 21.0, 7.5, 6.5, W, H).look_at(eye, [0.0; 3], [0.0, -1.0, 0.0]);
    let distortion = Distortion {
        k: [0.02, -0.01, 0.0, 0.0],
        p: [0.001, -0.002],
    };
    KnownCamera { camera, distortion }
}

fn frame(index: usize, known: &KnownCamera) -> serde_json::Value {
    let KnownCamera { camera, distortion } = known;
    let [right, down, forward] = camera.rotation;
    let position = camera.position();
    let rows: Vec<[f64; 4]> = (0..3)
        .map(|axis| [right[axis], -down[axis], -forward[axis], position[axis]])
        .collect();
    serde_json::json!({
        "file_path": format!("images/cam{index}.png"), "transform_matrix": rows,
        "w": W, "h": H, "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy,
        "k1": distortion.k[0], "k2": distortion.k[1], "p1": distortion.p[0], "p2": distortion.p[1],
    })
}

#[track_caller]
fn assert_close(got: &KnownCamera, expected: &KnownCamera) {
    let numbers = |known: &KnownCamera| {
        let c = &known.camera;
        let mut numbers = vec![c.fx, c.fy, c.cx, c.cy, c.width as f64, c.height as f64];
        numbers.extend(c.rotation.iter().flatten());
        numbers.extend(
            c.translation
                .iter()
                .chain(&known.distortion.k)
                .chain(&known.distortion.p),
        );
        numbers
    };
    for (index, (a, b)) in numbers(got).iter().zip(numbers(expected)).enumerate() {
        assert!(
            (a - b).abs() < 1e-9,
            "number {index}: got {a}, expected {b}"
        );
    }
}

fn exists(path: &Path, name: &str) -> bool {
    path.join(name).is_file()
}
