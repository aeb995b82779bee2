//! Models as several tools leave them: unused cameras, points in every form, other folders.

use super::super::Layout;
use super::colmap::{MODELS, cameras_bin, capture, expected_camera, points_bin};
use crate::test_kit::{Fixture, H, W, assert_cameras_equal};

#[test]
fn cameras_that_no_image_uses_do_not_matter() {
    const N_PARAMETERS: [(u32, usize); 12] = [
        (5, 8),
        (7, 5),
        (8, 4),
        (9, 5),
        (10, 12),
        (11, 16),
        (12, 4),
        (13, 5),
        (14, 3),
        (15, 4),
        (16, 6),
        (17, 2),
    ];
    let fixture = capture("sparse/0");
    let used = cameras_bin(MODELS[1].0, MODELS[1].2);
    for (model, n) in N_PARAMETERS {
        let other = cameras_bin(model, &vec![0.0; n]);
        let mut bytes = 2u64.to_le_bytes().to_vec();
        bytes.extend(6u32.to_le_bytes());
        bytes.extend(&other[12..]);
        bytes.extend(&used[8..]);
        fixture.write("sparse/0/cameras.bin", bytes);
        let dataset = fixture.load().expect("loads");
        assert_cameras_equal(&dataset.views[0].camera, &expected_camera());
        // It is refused where an image uses it.
        fixture.write("sparse/0/cameras.bin", other);
        fixture.refuses(&["cameras.bin", "for camera 5", "image_undistorter"]);
    }
    let fixture = text_capture("sparse/0");
    let used = "5 PINHOLE 8 6 9 9 4 3\n";
    for other in [
        "6 EQUIRECTANGULAR 8 6",
        "6 OPENCV_FISHEYE 8 6 9 9 4 3 0 0 0 0",
        "6 NEWER 8 6 1",
        "6 PINHOLE 0 0 9 9 4 3",
        "6 PINHOLE 8 6 -1 nan 4 3",
    ] {
        fixture.write("sparse/0/cameras.txt", format!("{other}\n{used}"));
        assert_eq!(fixture.load().expect(other).views.len(), 2);
        fixture.write("sparse/0/cameras.txt", other.replacen('6', "5", 1));
        fixture.refuses(&["cameras.txt", "for camera 5"]);
    }
}

/// [`capture`] with a text model.
fn text_capture(folder: &str) -> Fixture {
    let fixture = capture("binary");
    let pose = "2 2 0 0 0.5 -1 4 5";
    let images = format!("1 {pose} a.png\n\n2 {pose} b.png\n\n");
    let at = |name: &str| match folder {
        "" => name.to_string(),
        folder => format!("{folder}/{name}"),
    };
    fixture.write(&at("cameras.txt"), "5 PINHOLE 8 6 9 9 4 3\n");
    fixture.write(&at("images.txt"), images);
    fixture.write(&at("points3D.txt"), "7 1 2 3 9 8 7 0.5\n");
    fixture
}

#[test]
fn points_are_read_in_every_form_that_colmap_writes() {
    use crate::ply::{PointCloud, write_points};
    let fixture = text_capture("sparse/0");
    let ply = PointCloud {
        positions: vec![[4.0, 5.0, 6.0]],
        colors: vec![[1, 2, 3]],
    };
    write_points(&fixture.path("sparse/0/points3D.ply"), &ply).expect("writes");
    fixture.write("sparse/0/points3D.bin", points_bin(&[[7.0, 8.0, 9.0]]));
    let first = || {
        fixture
            .load()
            .expect("loads")
            .points
            .map(|points| points.positions[0])
    };
    assert_eq!(first(), Some([7.0, 8.0, 9.0]));
    fixture.remove("sparse/0/points3D.bin");
    assert_eq!(first(), Some([1.0, 2.0, 3.0]));
    fixture.remove("sparse/0/points3D.txt");
    assert_eq!(first(), Some([4.0, 5.0, 6.0]));
    fixture.write("sparse/0/points3D.ply", "no points");
    fixture.refuses(&["points3D.ply"]);
    fixture.remove("sparse/0/points3D.ply");
    assert_eq!(first(), None);
}

#[test]
fn the_next_model_is_read_where_the_first_is_missing() {
    for folder in ["sparse/1", "sparse/7"] {
        let fixture = text_capture(folder);
        fixture.write("sparse/12/cameras.txt", "damaged");
        let dataset = fixture.load().expect("loads");
        assert_eq!((dataset.layout, dataset.views.len()), (Layout::Colmap, 2));
        assert_eq!(dataset.points.expect("points").positions, [[1.0, 2.0, 3.0]]);
    }
}

#[test]
fn flat_exports_have_the_model_beside_the_images() {
    let fixture = text_capture("");
    // With a folder of images, or all in one.
    for in_one in [false, true] {
        if in_one {
            for name in ["a.png", "b.png"] {
                let [from, to] = [
                    fixture.root().join("images").join(name),
                    fixture.root().join(name),
                ];
                std::fs::rename(from, to).expect("moves");
            }
            std::fs::remove_dir(fixture.root().join("images")).expect("empty");
        }
        let dataset = fixture.load().expect("loads");
        assert_eq!((dataset.layout, dataset.views.len()), (Layout::Colmap, 2));
        assert_cameras_equal(&dataset.views[0].camera, &expected_camera());
        assert_eq!(dataset.points.expect("points").colors, [[9, 8, 7]]);
    }
    fixture.remove("images.txt");
    fixture.refuses(&["cameras.txt and images.txt (colmap)"]);
}

#[test]
fn tables_of_registrations_are_told_with_what_to_export() {
    let fixture = Fixture::new();
    fixture.image("a.png", W, H, [0; 3]);
    fixture.write("notes.csv", "time,value\n1,2\n");
    fixture.refuses(&["poses_bounds.npy"]);
    fixture.write(
        "cameras.csv",
        "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\na.png,1,2,3\n",
    );
    fixture.refuses(&["cameras.csv", "RealityScan", "COLMAP's format"]);
}
