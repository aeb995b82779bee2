use std::path::PathBuf;

use serde_json::json;

use super::super::reconstruct::write_model;
use super::{Bench, H, W, assert_close, frame, known};
use crate::dataset::poses::known::{KnownCamera, read};

fn names(n: usize) -> Vec<String> {
    (0..n).map(|index| format!("cam{index}")).collect()
}

#[test]
fn a_written_model_reads_back_as_the_same_cameras() {
    let bench = Bench::new();
    let model = bench.path("sparse/0/cameras.txt");
    let model = model.parent().expect("a folder");
    let cameras: Vec<KnownCamera> = (0..3).map(known).collect();
    // Listed in another order than the names.
    let images: Vec<PathBuf> = [2, 0, 1].map(|n| format!("x/cam{n}.png").into()).to_vec();
    let listed = [2, 0, 1].map(|n| cameras[n].clone());
    write_model(model, &images, &listed).expect("writes");
    for path in [model.to_path_buf(), bench.path("sparse/0").join("../..")] {
        let read = read(&path, &names(3), &[[W, H]; 3]).expect("reads");
        for (got, expected) in read.iter().zip(&cameras) {
            assert_close(got, expected);
        }
    }
    let mut folded = cameras;
    folded[0].distortion.k[3] = 0.1;
    let error = write_model(model, &images, &folded)
        .expect_err("k4")
        .to_string();
    assert!(error.contains("k4"), "{error}");
}

#[test]
fn transforms_go_by_names_and_fit_pictures_of_another_size() {
    let bench = Bench::new();
    let path = bench.poses(3);
    let twice = read(&path, &names(3), &[[2 * W, 2 * H]; 3]).expect("reads");
    assert_close(&twice[2], &known(2).resized([2 * W, 2 * H]));
    let refused = |names: &[String], size: [usize; 2]| {
        read(&path, names, &vec![size; names.len()])
            .expect_err("refused")
            .to_string()
    };
    assert!(refused(&names(4), [W, H]).contains("none for cam3"));
    assert!(refused(&names(3), [W, 2 * H]).contains("16x24"));

    let mut moved = known(0);
    moved.camera.translation[0] += 1.0;
    let frames = [frame(0, &known(0)), frame(0, &moved)];
    let path = bench.write("moving.json", json!({ "frames": frames }).to_string());
    let error = read(&path, &names(1), &[[W, H]])
        .expect_err("two poses")
        .to_string();
    assert!(error.contains("several different ones for cam0"), "{error}");
}

#[test]
fn rows_of_poses_bounds_go_by_order_and_their_number_must_fit() {
    let bench = Bench::new();
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 17), }\n";
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    let identity = |x: f64| {
        // Columns down, right, backwards, position, (height, width, focal).
        [
            [0.0, 1.0, 0.0, x, H as f64],
            [1.0, 0.0, 0.0, 0.0, W as f64],
            [0.0, 0.0, -1.0, 0.0, 20.0],
        ]
    };
    for row in [identity(0.0), identity(5.0)] {
        for value in row.iter().flatten().chain(&[1.0, 9.0]) {
            bytes.extend(value.to_le_bytes());
        }
    }
    let path = bench.write("poses_bounds.npy", &bytes);
    let cameras = read(&path, &names(2), &[[W, H]; 2]).expect("reads");
    assert_eq!(cameras[1].camera.position(), [5.0, 0.0, 0.0]);
    assert_eq!(cameras[1].camera.fx, 20.0);
    let error = read(&path, &names(3), &[[W, H]; 3])
        .expect_err("three")
        .to_string();
    assert!(
        error.contains("cam2") && error.contains("2 rows"),
        "{error}"
    );
    for (name, word) in [("poses.txt", "another kind"), ("empty/x", "COLMAP model")] {
        let path = bench.write(name, "x");
        let path = if name == "empty/x" {
            path.parent().expect("a folder").to_path_buf()
        } else {
            path
        };
        let error = read(&path, &names(1), &[[W, H]])
            .expect_err(name)
            .to_string();
        assert!(error.contains(word), "{error}");
    }
}
