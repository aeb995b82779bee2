use dash_kernels::Camera;

use super::super::{Layout, LoadOptions, Partition};
use crate::test_kit::{Fixture, H, W, assert_cameras_equal};

/// Camera model id, name and parameters; all have focal length 9 and a centred principal point.
pub(super) const MODELS: [(u32, &str, &[f64]); 6] = [
    (0, "SIMPLE_PINHOLE", &[9.0, 4.0, 3.0]),
    (1, "PINHOLE", &[9.0, 9.0, 4.0, 3.0]),
    (2, "SIMPLE_RADIAL", &[9.0, 4.0, 3.0, 0.0]),
    (3, "RADIAL", &[9.0, 4.0, 3.0, 0.0, 0.0]),
    (4, "OPENCV", &[9.0, 9.0, 4.0, 3.0, 0.0, 0.0, 0.0, 0.0]),
    (
        6,
        "FULL_OPENCV",
        &[9.0, 9.0, 4.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ),
];
/// Quarter turn about x, not of unit length: (1, 1, 0, 0).
const TURN: [f64; 4] = [2.0, 2.0, 0.0, 0.0];
const TRANSLATION: [f64; 3] = [0.5, -1.0, 4.0];

/// The camera of [`TURN`]: world y is the camera's z, world z its -y.
pub(super) fn expected_camera() -> Camera {
    Camera {
        rotation: [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
        translation: TRANSLATION,
        ..Camera::new(9.0, 9.0, 4.0, 3.0, W, H)
    }
}

pub(super) fn cameras_bin(model: u32, parameters: &[f64]) -> Vec<u8> {
    let mut bytes = 1u64.to_le_bytes().to_vec();
    bytes.extend(5u32.to_le_bytes());
    bytes.extend(model.to_le_bytes());
    bytes.extend((W as u64).to_le_bytes());
    bytes.extend((H as u64).to_le_bytes());
    bytes.extend(parameters.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

fn images_bin(names: &[&str], quaternion: [f64; 4], camera_id: u32) -> Vec<u8> {
    let mut bytes = (names.len() as u64).to_le_bytes().to_vec();
    for (id, name) in names.iter().enumerate() {
        bytes.extend((id as u32).to_le_bytes());
        bytes.extend(
            quaternion
                .iter()
                .chain(&TRANSLATION)
                .flat_map(|v| v.to_le_bytes()),
        );
        bytes.extend(camera_id.to_le_bytes());
        bytes.extend(name.as_bytes());
        bytes.push(0);
        bytes.extend(1u64.to_le_bytes());
        bytes.extend([1.5f64, 2.5].iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend((-1i64).to_le_bytes());
    }
    bytes
}

pub(super) fn points_bin(positions: &[[f64; 3]]) -> Vec<u8> {
    let mut bytes = (positions.len() as u64).to_le_bytes().to_vec();
    for (id, position) in positions.iter().enumerate() {
        bytes.extend((id as u64).to_le_bytes());
        bytes.extend(position.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend([1, 2, 3]);
        bytes.extend(0.5f64.to_le_bytes());
        bytes.extend(2u64.to_le_bytes());
        bytes.extend([0; 16]);
    }
    bytes
}

pub(super) fn capture(folder: &str) -> Fixture {
    let fixture = Fixture::new();
    fixture.write(
        &format!("{folder}/cameras.bin"),
        cameras_bin(MODELS[1].0, MODELS[1].2),
    );
    fixture.write(
        &format!("{folder}/images.bin"),
        images_bin(&["b.png", "a.png"], TURN, 5),
    );
    let points = points_bin(&[[1.0, 2.0, 3.0], [f64::NAN, 0.0, 0.0]]);
    fixture.write(&format!("{folder}/points3D.bin"), points);
    fixture.image("images/a.png", W, H, [10; 3]);
    fixture.image("images/b.png", W, H, [20; 3]);
    fixture
}

#[test]
fn binary_models_in_either_folder() {
    for folder in ["sparse/0", "sparse"] {
        let dataset = capture(folder).load().expect("loads");
        assert_eq!(dataset.layout, Layout::Colmap);
        assert_eq!((dataset.n_cameras, dataset.n_frames), (2, 1));
        let listed: Vec<_> = dataset
            .views
            .iter()
            .map(|v| (v.name.as_str(), v.partition))
            .collect();
        assert_eq!(
            listed,
            [("a", Partition::Test), ("b", Partition::Train)],
            "in the order of names"
        );
        assert_eq!(
            dataset.views[1].rgb([0.0; 3]).expect("in memory")[0],
            20.0 / 255.0
        );
        assert_cameras_equal(&dataset.views[0].camera, &expected_camera());
        let points = dataset.points.expect("points");
        assert_eq!(
            (points.positions, points.colors),
            (vec![[1.0, 2.0, 3.0]], vec![[1, 2, 3]])
        );
    }
}

#[test]
fn names_may_be_relative_to_the_datasets_folder_or_of_another_computer() {
    let fixture = capture("sparse/0");
    fixture.image("input/c.png", W, H, [30; 3]);
    let names = [
        "images/b.png",
        "/home/ann/scene/images/a.png",
        "/home/ann/scene/input/c",
    ];
    fixture.write("sparse/0/images.bin", images_bin(&names, TURN, 5));
    let dataset = fixture.load().expect("loads");
    let mut seen: Vec<(&str, f32)> = dataset
        .views
        .iter()
        .map(|view| {
            (
                view.name.as_str(),
                view.rgb([0.0; 3]).expect("in memory")[0] * 255.0,
            )
        })
        .collect();
    seen.sort_by(|a, b| a.0.cmp(b.0));
    assert_eq!(seen, [("a", 10.0), ("b", 20.0), ("input/c", 30.0)]);
    // A lost picture is one that may be left out.
    let lost = ["images/b.png", "a.png", "/home/ann/scene/images/c.png"];
    fixture.write("sparse/0/images.bin", images_bin(&lost, TURN, 5));
    let skipping = LoadOptions {
        skip_broken: true,
        ..LoadOptions::default()
    };
    assert_eq!(
        fixture
            .load_with(&skipping)
            .expect("two are left")
            .views
            .len(),
        2
    );
    let lost = ["images/b.png", "images/c.png"];
    fixture.write("sparse/0/images.bin", images_bin(&lost, TURN, 5));
    fixture.refuses(&["images.bin", "images/c.png"]);
}

#[test]
fn all_pinhole_models_with_undone_lenses() {
    let fixture = capture("sparse/0");
    for (model, name, parameters) in MODELS {
        fixture.write("sparse/0/cameras.bin", cameras_bin(model, parameters));
        let camera = &fixture.load().expect(name).views[0].camera;
        assert_cameras_equal(camera, &expected_camera());
        if parameters.len() > 3 && name != "PINHOLE" {
            let mut distorted = parameters.to_vec();
            let k = distorted.iter().rposition(|&v| v == 3.0).expect("cy") + 1;
            distorted[k] = 1.0;
            fixture.write("sparse/0/cameras.bin", cameras_bin(model, &distorted));
            let zoomed = fixture.load().expect(name).views[0].camera.fx;
            assert!(zoomed > 9.0 && zoomed < 12.0, "{name}: {zoomed}");
        }
    }
    for (model, n) in [(5, 8), (7, 5), (8, 4), (9, 5), (10, 12)] {
        fixture.write("sparse/0/cameras.bin", cameras_bin(model, &vec![1.0; n]));
        fixture.refuses(&[
            "cameras.bin",
            "SIMPLE_RADIAL",
            "a fisheye lens",
            "colmap image_undistorter",
        ]);
    }
    let mut rational = MODELS[5].2.to_vec();
    // k3 is of the polynomial, k4 below the fraction's line.
    rational[8] = 30.0;
    fixture.write("sparse/0/cameras.bin", cameras_bin(6, &rational));
    assert!(fixture.load().expect("a polynomial").views[0].camera.fx > 9.0);
    rational[9] = 0.1;
    fixture.write("sparse/0/cameras.bin", cameras_bin(6, &rational));
    fixture.refuses(&[
        "cameras.bin",
        "k4, k5 and k6",
        "0.1",
        "colmap image_undistorter",
    ]);
    fixture.write("sparse/0/cameras.bin", cameras_bin(99, &[]));
    fixture.refuses(&["cameras.bin", "model 99"]);
    fixture.write("sparse/0/cameras.bin", cameras_bin(18, &[1.0; 16]));
    fixture.refuses(&[
        "not supported",
        "model 18",
        "camera 5",
        "colmap image_undistorter",
    ]);
}

#[test]
fn text_models_equal_binary_ones() {
    let binary = capture("sparse/0").load().expect("loads");
    let fixture = capture("elsewhere");
    fixture.write(
        "sparse/0/cameras.txt",
        "# Camera list\n5 PINHOLE 8 6 9.0 9 4 3\n",
    );
    // The first image has no observations: its second line is empty.
    let images =
        "# Image list\n1 2 2 0 0 0.5 -1 4 5 b.png\n\n2 2 2 0 0 0.5 -1 4 5 a.png\n1.5 2.5 -1\n";
    fixture.write("sparse/0/images.txt", images);
    fixture.write(
        "sparse/0/points3D.txt",
        "# Points\n7 1 2 3 1 2 3 0.5 0 0 1 0\n8 nan 0 0 1 2 3 0.5\n",
    );
    let text = fixture.load().expect("loads");
    assert_eq!(text.points, binary.points);
    for (a, b) in text.views.iter().zip(&binary.views) {
        assert_eq!((&a.name, a.partition), (&b.name, b.partition));
        assert_cameras_equal(&a.camera, &b.camera);
    }
    let spaces = images.replace("png\n\n", "png\n \t\n");
    fixture.write("sparse/0/images.txt", spaces);
    assert_eq!(fixture.load().expect("loads").views.len(), 2);
    // A writer that left out the empty lines: every second image would be lost.
    fixture.write("sparse/0/images.txt", images.replace("\n\n", "\n"));
    fixture.refuses(&[
        "images.txt",
        "observations of image `b.png`",
        "another image in line 3",
        "leave an empty line after each image",
    ]);
    fixture.write("sparse/0/images.txt", images.replace(" 4 5 a.png", ""));
    fixture.refuses(&["images.txt", "line 4"]);
    fixture.write("sparse/0/images.txt", images.replace("-1 4 5 b", "x 4 5 b"));
    fixture.refuses(&["images.txt", "`x`", "line 2"]);
}

#[test]
fn inconsistent_models_are_errors() {
    let fixture = capture("sparse/0");
    let write = |bytes: Vec<u8>| fixture.write("sparse/0/images.bin", bytes);
    write(images_bin(&["a.png"], TURN, 6));
    fixture.refuses(&["images.bin", "camera id 6", "a.png"]);
    for broken in [
        [0.0; 4],
        [f64::NAN, 0.0, 0.0, 1.0],
        [f64::INFINITY, 0.0, 0.0, 1.0],
    ] {
        write(images_bin(&["a.png"], broken, 5));
        fixture.refuses(&["images.bin", "quaternion", "a.png"]);
    }
    write(images_bin(&["c.png"], TURN, 5));
    fixture.refuses(&["images.bin", "c.png", "no such file"]);
    write(images_bin(&["../images/../../a.png"], TURN, 5));
    fixture.refuses(&["images.bin", "inside"]);
    write(images_bin(&[], TURN, 5));
    fixture.refuses(&["images.bin", "registered images"]);
    write(images_bin(&["b.png", "a.png"], TURN, 5));
    fixture.image("images/b.png", W * 2, H, [0; 3]);
    fixture.refuses(&["b.png", "8x6", "16x6"]);
    fixture.image("images/b.png", W, H, [0; 3]);
    for parameters in [
        [0.0, 9.0, 4.0, 3.0],
        [9.0, 9.0, f64::NAN, 3.0],
        [9.0, -9.0, 4.0, 3.0],
    ] {
        fixture.write("sparse/0/cameras.bin", cameras_bin(1, &parameters));
        fixture.refuses(&["cameras.bin", "camera 5"]);
    }
}

#[test]
fn truncated_files_and_huge_counts_are_errors() {
    let fixture = capture("sparse/0");
    for name in [
        "sparse/0/cameras.bin",
        "sparse/0/images.bin",
        "sparse/0/points3D.bin",
    ] {
        fixture.survives_truncation(name, 1);
        let whole = std::fs::read(fixture.path(name)).expect("fixture file");
        for count in [u64::MAX, 1 << 60, 1 << 32, 1000] {
            let mut bytes = whole.clone();
            bytes[..8].copy_from_slice(&count.to_le_bytes());
            fixture.write(name, &bytes);
            fixture.refuses(&[name, &count.to_string()]);
        }
        fixture.write(name, whole);
    }
}

#[test]
fn byte_order_marks_are_skipped_and_names_keep_their_spaces() {
    let fixture = capture("elsewhere");
    fixture.image("images/my  pic b.png", W, H, [0; 3]);
    let images = "1 2 2 0 0 0.5 -1 4 5 my  pic b.png \n\n2 2 2 0 0 0.5 -1 4 5 a.png\n\n";
    for (name, text) in [
        ("cameras.txt", "# Camera list\n5 PINHOLE 8 6 9.0 9 4 3\n"),
        ("images.txt", images),
        ("points3D.txt", "7 1 2 3 1 2 3 0.5 0 0 1 0\n"),
    ] {
        fixture.write(&format!("sparse/0/{name}"), format!("\u{feff}{text}"));
    }
    let dataset = fixture.load().expect("loads");
    let names: Vec<&str> = dataset.views.iter().map(|v| v.name.as_str()).collect();
    assert_eq!(names, ["a", "my  pic b"]);
    assert_eq!(dataset.points.expect("points").positions, [[1.0, 2.0, 3.0]]);
}
