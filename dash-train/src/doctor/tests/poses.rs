//! Poses and points that do not belong together.

use super::super::Severity::{Error, Note, Ok as Fine, Warning};
use super::{CAMERAS, Scene, else_clean, finds, flip};

use super::super::agreement::first_pictures;
use super::super::cloud::Cloud;
use super::super::poses::by_colors;
use crate::dataset::{LoadOptions, load};

/// Poses and what follows from them.
const POSES: [&str; 3] = ["poses", "points", "colours"];

#[test]
fn one_camera_in_another_convention_is_named() {
    let scene = Scene::bounce();
    scene.edit_poses(|rows| flip(&mut rows[3]));
    let diagnosis = scene.examine();
    finds(
        &diagnosis,
        "poses",
        Error,
        &["cam03", "y and z axes negated"],
    );
    else_clean(&diagnosis, &["poses"]);
}

#[test]
fn a_camera_of_a_model_that_misses_colours_is_no_mistake() {
    let scene = Scene::bounce();
    scene.edit_poses(|rows| flip(&mut rows[3]));
    let dataset = load(&scene.root(), &LoadOptions::default()).expect("loads");
    let cloud = dataset.points.as_ref().map(Cloud::of);
    let pictures = first_pictures(&dataset).expect("in memory");
    let of_poses = |of_model| {
        let findings = by_colors(cloud.as_ref(), &pictures, of_model).findings;
        let mut of_poses = findings.into_iter().filter(|f| f.check == "poses");
        of_poses.next().expect("cam03 misses its colours")
    };
    assert_eq!(of_poses(false).severity, Error);
    let noted = of_poses(true);
    assert_eq!(noted.severity, Note);
    assert!(noted.text.contains("cam03"), "{noted:?}");
}

#[test]
fn all_cameras_in_another_convention_are_told_with_points_and_without() {
    let scene = Scene::bounce();
    scene.edit_poses(|rows| rows.iter_mut().for_each(flip));
    let diagnosis = scene.examine();
    finds(&diagnosis, "poses", Error, &["y and z axes negated"]);
    else_clean(&diagnosis, &POSES);

    std::fs::remove_file(scene.root().join(super::POINTS)).expect("removed");
    let without = scene.examine();
    finds(
        &without,
        "poses",
        Warning,
        &["in front of 0 of 8", "y and z axes negated"],
    );
    finds(&without, "points", Note, &["no point cloud"]);
    scene.edit_poses(|rows| rows[1..].iter_mut().for_each(flip));
    finds(
        &scene.examine(),
        "poses",
        Warning,
        &["7 of 8", "behind cam00"],
    );
}

#[test]
fn inverted_poses_are_told() {
    let scene = Scene::bounce();
    scene.edit_poses(|rows| {
        for row in rows {
            // Columns are down, right, backwards, position.
            let column = |c: usize| glam::DVec3::new(row[c], row[5 + c], row[10 + c]);
            let axes = glam::DMat3::from_cols(column(1), -column(0), column(2));
            let back = axes.transpose();
            let position = -(back * column(3));
            let columns = [-back.y_axis, back.x_axis, back.z_axis, position];
            for (c, column) in columns.into_iter().enumerate() {
                for axis in 0..3 {
                    row[5 * axis + c] = column[axis];
                }
            }
        }
    });
    finds(&scene.examine(), "poses", Error, &["poses inverted"]);
}

#[test]
fn interchanged_and_reordered_poses_are_told() {
    let scene = Scene::bounce();
    scene.edit_poses(|rows| rows.swap(2, 6));
    let diagnosis = scene.examine();
    finds(
        &diagnosis,
        "poses",
        Error,
        &["cam02 and cam06 are interchanged"],
    );
    else_clean(&diagnosis, &["poses"]);
    scene.edit_poses(|rows| {
        rows.swap(2, 6);
        rows.rotate_left(2);
    });
    finds(
        &scene.examine(),
        "poses",
        Error,
        &["of 8 pictures fit the pose of another camera"],
    );
}

#[test]
fn points_of_another_scale_or_turned_are_told() {
    let scene = Scene::bounce();
    scene.edit_points(|points| {
        points
            .positions
            .iter_mut()
            .flatten()
            .for_each(|v| *v *= 10.0)
    });
    finds(
        &scene.examine(),
        "poses",
        Error,
        &["coordinates times 0.100"],
    );
    scene.edit_points(|points| {
        for p in &mut points.positions {
            *p = [p[0] / 10.0, p[2] / 10.0, -p[1] / 10.0];
        }
    });
    finds(&scene.examine(), "poses", Error, &["taken as (x, -z, y)"]);
}

#[test]
fn wrong_focal_lengths_are_told() {
    let scene = Scene::bounce();
    scene.edit_poses(|rows| rows.iter_mut().for_each(|row| row[14] *= 2.0));
    finds(
        &scene.examine(),
        "poses",
        Error,
        &["focal lengths times 0.5"],
    );
}

#[test]
fn random_points_are_named_as_such() {
    use rand::{Rng, SeedableRng};
    let scene = Scene::bounce();
    scene.edit_points(|points| {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
        points
            .colors
            .iter_mut()
            .for_each(|c| *c = std::array::from_fn(|_| rng.random()));
    });
    let diagnosis = scene.examine();
    finds(&diagnosis, "points", Note, &["drawn at random"]);
    finds(&diagnosis, "box", Note, &["does not start from the points"]);
    else_clean(&diagnosis, &[]);
    // Grey points that fill a box, as some datasets carry.
    scene.edit_points(|points| {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(2);
        points.positions = (0..20_000)
            .map(|_| std::array::from_fn(|_| rng.random_range(-1.3..1.3)))
            .collect();
        points.colors = vec![[128; 3]; 20_000];
    });
    finds(
        &scene.examine(),
        "points",
        Note,
        &["20000 points that were drawn at random"],
    );
}

#[test]
fn duplicates_and_points_far_away_are_counted() {
    let scene = Scene::bounce();
    scene.edit_points(|points| {
        points.positions.truncate(1000);
        points.colors.truncate(1000);
        points.positions.extend_from_within(..500);
        points.colors.extend_from_within(..500);
    });
    let diagnosis = scene.examine();
    finds(&diagnosis, "points", Warning, &["33 %", "(500)"]);
    else_clean(&diagnosis, &["points"]);
    let path = scene.root().join(super::POINTS);
    let mut bytes = std::fs::read(&path).expect("points");
    let header = bytes
        .windows(11)
        .position(|w| w == b"end_header\n")
        .expect("a header")
        + 11;
    bytes[header..header + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(&path, bytes).expect("writes");
    finds(
        &scene.examine(),
        "points",
        Warning,
        &["1 points have coordinates that are not finite"],
    );
}

#[test]
fn doubtful_cameras_are_drawn_in_red() {
    let red = |scene: &Scene| {
        let image = scene.examine().picture().expect("cameras");
        image.pixels().filter(|p| p.0 == [215, 20, 30]).count()
    };
    let scene = Scene::bounce();
    assert_eq!(red(&scene), 0);
    scene.edit_poses(|rows| flip(&mut rows[CAMERAS - 1]));
    assert!(red(&scene) > 50);
    finds(&scene.examine(), "colours", Fine, &["correlation"]);
}

#[test]
fn a_scene_in_map_coordinates_is_told_with_what_to_subtract() {
    let scene = Scene::bounce();
    let east = 400_000.0;
    scene.edit_poses(|rows| rows.iter_mut().for_each(|row| row[3] += east));
    scene.edit_points(|points| {
        for position in &mut points.positions {
            position[0] += east as f32;
        }
    });
    let diagnosis = scene.examine();
    finds(
        &diagnosis,
        "origin",
        Warning,
        &["times its size from the origin"],
    );
    let mut mends = diagnosis.findings.iter().filter_map(|f| f.mend.as_deref());
    assert!(mends.any(|mend| mend.starts_with("subtract (400000.")));
}
