use dash_kernels::Camera;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use super::super::cloud::clean;
use super::super::random::random_points;
use super::known;
use crate::dataset::poses::colmap::TrackedPoint;

/// Points on a plane, which share a coordinate, all of them reliable.
fn plane(n: usize) -> Vec<TrackedPoint> {
    let mut rng = Pcg64::seed_from_u64(7);
    let mut point = |_| TrackedPoint {
        position: [
            rng.random_range(-1.0..1.0),
            rng.random_range(-1.0..1.0),
            2.0,
        ],
        color: [100, 150, 200],
        error: 0.5,
        n_images: 4,
    };
    (0..n).map(&mut point).collect()
}

#[test]
fn doubtful_points_and_those_that_stand_alone_are_left_out() {
    let mut points = plane(3000);
    points[0].error = 5.0;
    points[1].error = f64::NAN;
    points[2].n_images = 2;
    points[3].position = [40.0, 0.0, 2.0];
    points[4].position[0] = f64::INFINITY;
    let (cloud, counts) = clean(&points, 10_000);
    assert_eq!(counts.doubtful, 4);
    assert!(
        !cloud.positions.iter().any(|p| p[0] > 2.0),
        "far away from all"
    );
    // A random plane has a few lonely points of its own.
    assert!((1..60).contains(&counts.outliers), "{counts:?}");
    assert_eq!(
        counts.found - counts.doubtful - counts.outliers - counts.merged,
        cloud.len()
    );
    assert_eq!(counts.kept, cloud.len());
}

#[test]
fn two_images_are_enough_where_there_are_few_points() {
    let mut points = plane(100);
    for point in &mut points {
        point.n_images = 2;
    }
    assert_eq!(clean(&points, 1000).1.doubtful, 0);
    for n in [0, 1, 5, 9] {
        assert_eq!(clean(&plane(n), 1000).0.len(), n);
    }
}

#[test]
fn thinning_keeps_the_shape_with_nearly_as_many_points_as_allowed() {
    let points = plane(5000);
    let (cloud, counts) = clean(&points, 500);
    assert!((350..=500).contains(&cloud.len()), "{counts:?}");
    assert!(cloud.colors.iter().all(|color| *color == [100, 150, 200]));
    for corner in [[-1.0f32, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]] {
        let near = |p: &&[f32; 3]| (p[0] - corner[0]).hypot(p[1] - corner[1]) < 0.2;
        assert!(cloud.positions.iter().find(near).is_some(), "{corner:?}");
    }
    assert_eq!(clean(&points, 500).0, cloud, "the same every time");
    assert_eq!(clean(&points, 1).0.len(), 1);
    let same = vec![points[0]; 50];
    assert_eq!(clean(&same, 10).0.len(), 1, "points in one place");
}

#[test]
fn random_points_lie_where_two_cameras_look() {
    let cameras: Vec<Camera> = (0..4).map(|index| known(index).camera).collect();
    let points = random_points(&cameras, 300, 1);
    assert_eq!(points.len(), 300);
    for position in &points.positions {
        let seen = cameras
            .iter()
            .filter(|c| c.project_inside(position.map(f64::from)).is_some());
        assert!(seen.count() >= 2, "{position:?}");
    }
    assert_eq!(random_points(&cameras, 300, 1), points);
    assert_ne!(random_points(&cameras, 300, 2), points);
    assert!(
        random_points(&cameras[..1], 10, 1).is_empty(),
        "a single camera"
    );
    // One looks away from the other.
    let away = Camera::new(20.0, 20.0, 8.0, 6.0, 16, 12);
    let other = away
        .clone()
        .look_at([0.0, 0.0, -1.0], [0.0, 0.0, -2.0], [0.0, -1.0, 0.0]);
    assert!(random_points(&[away, other], 10, 1).is_empty());
}
