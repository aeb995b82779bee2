//! Real and simulated captures, where an environment variable names their folder.

use std::path::Path;

use super::super::poses::colmap::binary::{Reader, cameras};
use super::super::poses::colmap::{pinhole, place};
use super::super::{Dataset, Layout, LoadOptions, Partition, View, load};
use crate::ply::PointCloud;
use crate::test_kit::real_capture;

fn load_at(name: &str, downscale: f64) -> Option<Dataset> {
    let options = LoadOptions {
        downscale,
        ..LoadOptions::default()
    };
    Some(load(&real_capture(name)?, &options).expect("a sound capture"))
}

/// Of the points in front of the camera: the share inside the image, and of those the median
/// difference (of the channels' mean, in [0, 1]) between the point's colour and its pixel.
fn agreement(view: &View, points: &PointCloud) -> (f64, f64) {
    let rgb = view.rgb([1.0; 3]).expect("in memory");
    let (mut in_front, mut differences) = (0, Vec::new());
    for (position, color) in points.positions.iter().zip(&points.colors) {
        let Some(([u, v], _)) = view.camera.project(position.map(f64::from)) else {
            continue;
        };
        in_front += 1;
        let inside = |at: f64, side: usize| at >= 0.0 && at < side as f64;
        if !(inside(u, view.camera.width) && inside(v, view.camera.height)) {
            continue;
        }
        let at = (v as usize * view.camera.width + u as usize) * 3;
        let difference: f64 = color
            .iter()
            .zip(&rgb[at..])
            .map(|(c, p)| (f64::from(*c) / 255.0 - f64::from(*p)).abs())
            .sum();
        differences.push(difference / 3.0);
    }
    differences.sort_by(f64::total_cmp);
    assert!(
        !differences.is_empty(),
        "{}: no point projects into the image",
        view.name
    );
    (
        differences.len() as f64 / f64::from(in_front),
        differences[differences.len() / 2],
    )
}

#[test]
fn zju313_points_project_onto_their_colors() {
    let Some(dataset) = load_at("zju313", 1.0) else {
        return;
    };
    assert_eq!(dataset.layout, Layout::N3dv);
    assert_eq!(
        (dataset.n_cameras, dataset.n_frames, dataset.views.len()),
        (19, 15, 285)
    );
    assert_eq!(dataset.views_of(Partition::Test).count(), 15);
    assert_eq!(dataset.views[14].time, 1.0);
    let points = dataset.points.as_ref().expect("points3D_downsample2.ply");
    assert_eq!(points.len(), 1494);
    let views: Vec<&View> = dataset
        .views
        .iter()
        .filter(|view| view.frame == 0)
        .collect();
    for view in &views {
        let (inside, _) = agreement(view, points);
        assert!(inside >= 0.9, "{}: {inside}", view.name);
    }
    let difference = assert_colors_agree_best_unshifted("zju313", &views, points);
    assert!(difference < 0.06, "{difference}");
}

/// The views' mean [`agreement`] in colour, which must be better than with principal points a few
/// pixels off: colours of corner points fade within two or three.
#[track_caller]
fn assert_colors_agree_best_unshifted(name: &str, views: &[&View], points: &PointCloud) -> f64 {
    let mean = |[dx, dy]: [f64; 2]| {
        let difference = |view: &&View| {
            let mut shifted = (*view).clone();
            shifted.camera.cx += dx;
            shifted.camera.cy += dy;
            agreement(&shifted, points).1
        };
        views.iter().map(difference).sum::<f64>() / views.len() as f64
    };
    let unshifted = mean([0.0; 2]);
    for shift in [[2.0, 0.0], [-2.0, 0.0], [0.0, 2.0], [0.0, -2.0]] {
        let shifted = mean(shift);
        eprintln!("{name}: colour difference {unshifted:.4}, shifted by {shift:?} px {shifted:.4}");
        assert!(
            unshifted < shifted,
            "{name}: shift {shift:?}: {unshifted} {shifted}"
        );
    }
    unshifted
}

#[test]
fn nr_nerf_is_one_moving_camera() {
    let Some(dataset) = load_at("nr_nerf", 2.0) else {
        return;
    };
    assert_eq!(dataset.layout, Layout::Blender);
    assert_eq!(
        (dataset.n_cameras, dataset.n_frames, dataset.views.len()),
        (86, 86, 86)
    );
    assert_eq!(dataset.views_of(Partition::Test).count(), 11);
    for view in &dataset.views {
        assert!(
            (view.time - view.frame as f32 / 85.0).abs() < 1e-6,
            "{}",
            view.name
        );
        assert_eq!((view.camera.width, view.camera.height), (256, 192));
        assert!((view.camera.fx - 0.5 * 256.609_527_587_890_6).abs() < 1e-9);
        assert_eq!(
            view.camera_index,
            dataset
                .views
                .iter()
                .position(|v| v.frame == view.frame)
                .expect("itself")
        );
    }
    assert_eq!((dataset.background, dataset.points), (None, None));
}

/// The pixel in the middle of the red sphere, if all of the sphere is inside the image.
fn red_sphere(view: &View) -> Option<[f64; 2]> {
    let (width, height) = (view.camera.width, view.camera.height);
    let (mut n, mut sum) = (0.0, [0.0; 2]);
    for (index, pixel) in view
        .rgb([1.0; 3])
        .expect("in memory")
        .chunks_exact(3)
        .enumerate()
    {
        if pixel[0] < 0.1 || pixel[0] < 2.0 * pixel[1].max(pixel[2]) {
            continue;
        }
        let (x, y) = (index % width, index / width);
        if x == 0 || y == 0 || x + 1 == width || y + 1 == height {
            return None;
        }
        n += 1.0;
        sum = [sum[0] + x as f64 + 0.5, sum[1] + y as f64 + 0.5];
    }
    (n > 0.0).then(|| sum.map(|s| s / n))
}

/// Distance between the lines of sight through two views' pixels.
fn distance_of_rays(a: (&View, [f64; 2]), b: (&View, [f64; 2])) -> f64 {
    let direction = |(view, [u, v]): (&View, [f64; 2])| {
        let camera = &view.camera;
        glam::DVec3::from(camera.unproject([u, v], 1.0)) - glam::DVec3::from(camera.position())
    };
    let between =
        glam::DVec3::from(b.0.camera.position()) - glam::DVec3::from(a.0.camera.position());
    between
        .dot(direction(a).cross(direction(b)).normalize())
        .abs()
}

#[test]
fn mujoco_lines_of_sight_to_a_sphere_meet() {
    for (name, n_train, n_test) in [("mujoco/scene1", 108, 21), ("mujoco/scene5", 126, 27)] {
        let Some(dataset) = load_at(name, 4.0) else {
            return;
        };
        assert_eq!(dataset.views_of(Partition::Train).count(), n_train);
        assert_eq!(dataset.views_of(Partition::Test).count(), n_test);
        assert_eq!(
            (dataset.n_cameras, dataset.n_frames),
            (12, n_train + n_test)
        );
        assert_eq!(dataset.background, Some([1.0; 3]));
        assert_eq!(dataset.points.as_ref().map(PointCloud::len), Some(100_000));
        assert!(
            dataset
                .views
                .iter()
                .all(|view| (0.0..=1.0).contains(&view.time))
        );

        let mut by_time: Vec<&View> = dataset.views.iter().collect();
        by_time.sort_by_key(|view| view.frame);
        let mut distances = Vec::new();
        let mut upside_down = Vec::new();
        for pair in by_time
            .windows(2)
            .filter(|pair| pair[0].camera_index != pair[1].camera_index)
        {
            let (Some(a), Some(b)) = (red_sphere(pair[0]), red_sphere(pair[1])) else {
                continue;
            };
            distances.push(distance_of_rays((pair[0], a), (pair[1], b)));
            let flip = |[u, v]: [f64; 2]| [u, 2.0 * pair[0].camera.cy - v];
            upside_down.push(distance_of_rays((pair[0], flip(a)), (pair[1], flip(b))));
        }
        let median = |values: &mut Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        assert!(
            distances.len() > 20,
            "{name}: only {} pairs of views",
            distances.len()
        );
        let (distance, control) = (median(&mut distances), median(&mut upside_down));
        eprintln!("{name}: rays pass at {distance:.4}, upside down at {control:.4}");
        assert!(
            distance < 0.1 && distance < 0.25 * control,
            "{name}: {distance} {control}"
        );
    }
}

#[test]
fn beer_can_points_project_onto_their_colors_after_undistortion() {
    let Some(dataset) = load_at("beer_can", 1.0) else {
        return;
    };
    assert_eq!(dataset.layout, Layout::Colmap);
    assert_eq!(
        (dataset.n_cameras, dataset.n_frames, dataset.views.len()),
        (71, 1, 71)
    );
    assert_eq!(dataset.views_of(Partition::Test).count(), 9);
    let points = dataset.points.as_ref().expect("points3D.bin");
    assert_eq!(points.len(), 4414);
    let views: Vec<&View> = dataset.views.iter().collect();
    let difference = assert_colors_agree_best_unshifted("beer_can", &views, points);
    assert!(difference < 0.08, "{difference}");
}

/// COLMAP's observations against its points through the cameras and lenses as read here.
#[test]
fn beer_can_points_reproject_onto_their_observations() {
    let Some(root) = real_capture("beer_can") else {
        return;
    };
    let read = |name: &str| std::fs::read(root.join("sparse/0").join(name)).expect("present");
    let (cameras_bytes, images_bytes, points_bytes) = (
        read("cameras.bin"),
        read("images.bin"),
        read("points3D.bin"),
    );
    let path = Path::new("beer_can");
    let cameras = cameras(path, &cameras_bytes).expect("sound");

    let mut points = std::collections::HashMap::new();
    let mut reader = Reader::new(path, &points_bytes);
    for _ in 0..reader.u64("n").expect("sound") {
        let id = reader.u64("id").expect("sound");
        let position = [0; 3].map(|_| reader.f64("position").expect("sound"));
        points.insert(id, position);
        reader.take(3 + 8, "colour and error").expect("sound");
        let track = reader.u64("track").expect("sound") as usize;
        reader.take(8 * track, "track").expect("sound");
    }
    let mut reader = Reader::new(path, &images_bytes);
    let mut errors = Vec::new();
    for _ in 0..reader.u64("n").expect("sound") {
        let image = reader.image().expect("sound");
        let model = cameras
            .iter()
            .find(|c| c.id == image.camera_id)
            .expect("listed");
        let (intrinsics, lens) = pinhole(model, path).expect("supported");
        let camera = place(&intrinsics, &image).expect("sound");
        for _ in 0..reader.u64("observations").expect("sound") {
            let seen = [0; 2].map(|_| reader.f64("pixel").expect("sound"));
            let Some(&point) = points.get(&reader.u64("point").expect("sound")) else {
                continue;
            };
            let [x, y, z] = camera.transform(point);
            let [x, y] = lens.apply([x / z, y / z]);
            let (u, v) = (camera.fx * x + camera.cx, camera.fy * y + camera.cy);
            errors.push((u - seen[0]).hypot(v - seen[1]));
        }
    }
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    eprintln!(
        "beer_can: {} observations, mean reprojection error {mean:.3} px",
        errors.len()
    );
    assert!(errors.len() > 10_000 && mean < 1.0, "{mean}");
}
