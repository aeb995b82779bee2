//! 4DGaussians' multi-view layout, on data made up.

use super::super::{Layout, Partition};
use crate::ply::{PointCloud, write_points};
use crate::test_kit::{Fixture, H, W, assert_cameras_equal, camera, npy_f64, write_model};

/// Cameras `cam01` .. with two frames each, and a model whose images are named so.
fn capture(images: [&str; 3]) -> Fixture {
    let fixture = Fixture::new();
    for camera in 0..3 {
        for frame in 0..2 {
            let shade = [camera as u8, frame as u8, 9];
            fixture.image(
                &format!("cam{:02}/frame_{:05}.jpg", 9 + camera, 1 + frame),
                W,
                H,
                shade,
            );
        }
    }
    // Not in the cameras' order.
    let images = [2, 0, 1].map(|index| (images[index], camera(index)));
    write_model(&fixture, "sparse_", &images);
    fixture.write(
        "poses_bounds_multipleview.npy",
        npy_f64(&super::n3dv::rows(3)),
    );
    fixture
}

#[test]
fn images_of_the_model_are_cameras_by_their_numbers() {
    for images in [
        ["image9.jpg", "image10.jpg", "image11.jpg"],
        ["image09.png", "image010.png", "image0011.png"],
        ["cam09.jpg", "cam10.jpg", "cam11.jpg"],
        [
            "cam09/frame_00001.jpg",
            "cam10/frame_00001.jpg",
            "cam11/frame_00001.jpg",
        ],
        [
            "images/image9.jpg",
            "images/image10.jpg",
            "images/image11.jpg",
        ],
    ] {
        let fixture = capture(images);
        let dataset = fixture.load().expect("loads");
        assert_eq!(dataset.layout, Layout::Multipleview);
        assert_eq!(
            (dataset.n_cameras, dataset.n_frames, dataset.views.len()),
            (3, 2, 6)
        );
        for view in &dataset.views {
            assert_cameras_equal(&view.camera, &camera(view.camera_index));
            let partition = Partition::held_out(view.camera_index == 0);
            assert_eq!(
                (view.partition, view.time),
                (partition, view.frame as f32),
                "{}",
                view.name
            );
        }
        assert_eq!(dataset.views[0].name, "cam09/frame_00001");
        // The model's own point; a file of the layout comes first.
        assert_eq!(dataset.points.expect("points").positions, [[1.0, 2.0, 3.0]]);
        let cloud = PointCloud {
            positions: vec![[7.0; 3]; 2],
            colors: vec![[1; 3]; 2],
        };
        write_points(&fixture.path("points3D_multipleview.ply"), &cloud).expect("writes");
        assert_eq!(fixture.load().expect("loads").points, Some(cloud));
    }
}

#[test]
fn what_is_missing_is_named() {
    let named = ["image9.jpg", "image10.jpg", "image11.jpg"];
    let fixture = capture(["image9.jpg", "image10.jpg", "image12.jpg"]);
    fixture.refuses(&["images.txt", "cam11", "image12.jpg"]);
    let fixture = capture(named);
    fixture.remove("sparse_/cameras.txt");
    fixture.refuses(&["sparse_", "cameras"]);
    let fixture = capture(named);
    fixture.remove("cam10/frame_00002.jpg");
    fixture.refuses(&["cam10", "2 frames", "--skip-broken"]);
}
