//! Points are found on what is there, and where it changes.

use rand::{Rng, SeedableRng};

use super::*;

/// A wall at z = 0 whose colour tells its place, seen by cameras 4 units in front of it.
fn wall(eye: [f64; 3]) -> View {
    let camera = Camera::new(60.0, 60.0, 30.0, 24.0, 60, 48).look_at(
        eye,
        [eye[0], eye[1], 0.0],
        [0.0, -1.0, 0.0],
    );
    let mut pixels = Vec::new();
    let position = camera.position();
    for y in 0..48 {
        for x in 0..60 {
            let local = [
                (x as f64 + 0.5 - 30.0) / 60.0,
                (y as f64 + 0.5 - 24.0) / 60.0,
                1.0,
            ];
            let ray: [f64; 3] = std::array::from_fn(|a| {
                (0..3).map(|row| camera.rotation[row][a] * local[row]).sum()
            });
            let depth = -position[2] / ray[2];
            let at = [position[0] + depth * ray[0], position[1] + depth * ray[1]];
            let shade = |v: f64| (127.5 + 127.5 * (2.0 * v).sin()) as u8;
            pixels.extend([shade(at[0]), shade(at[1]), shade(at[0] + at[1])]);
        }
    }
    View::from_rgb8("wall", camera, 0.0, pixels)
}

fn walls() -> Vec<View> {
    [-0.9, -0.3, 0.3, 0.9]
        .iter()
        .flat_map(|&x| [-0.5, 0.5].map(|y| wall([x, y, -4.0])))
        .collect()
}

#[test]
fn a_cloud_of_random_colours_is_told_from_a_reconstruction() {
    let views = walls();
    let views: Vec<&View> = views.iter().collect();
    let seen = InitialViews::new(&views, [0.0; 3]).expect("in memory");
    let mut rng = Pcg64::seed_from_u64(5);
    let mut points = seen.points(300, &mut rng);
    let shows = |points: &InitialPoints| [false, true].map(|of_poses| seen.shows(points, of_poses));
    assert_eq!(shows(&points), [true; 2]);
    for color in &mut points.colors {
        *color = std::array::from_fn(|_| rng.random());
    }
    assert_eq!(shows(&points), [false; 2]);
    points.colors.fill([0.5; 3]);
    assert_eq!(shows(&points), [true; 2], "one colour says nothing");
    assert_eq!(shows(&InitialPoints::default()), [true; 2]);
}

#[test]
fn points_of_what_changes_lie_there() {
    let views = walls();
    let before: Vec<View> = views
        .iter()
        .map(|view| {
            // Something else is where x and y are in [0, 0.5].
            let mut pixels = view.rgb([0.0; 3]).expect("in memory");
            for (k, pixel) in pixels.chunks_exact_mut(3).enumerate() {
                let at = [(k % 60) as f64 + 0.5 - 30.0, (k / 60) as f64 + 0.5 - 24.0];
                let local = [at[0] / 60.0 * 4.0, at[1] / 60.0 * 4.0, 4.0];
                let position = view.camera.position();
                let place = |axis: usize| {
                    let turned: f64 = (0..3)
                        .map(|r| view.camera.rotation[r][axis] * local[r])
                        .sum();
                    position[axis] + turned
                };
                if [0, 1]
                    .iter()
                    .all(|&axis| (0.0..=0.5).contains(&place(axis)))
                {
                    pixel.fill(0.0);
                }
            }
            let bytes = pixels.iter().map(|v| (v * 255.0) as u8).collect();
            View::from_rgb8("before", view.camera.clone(), 0.5, bytes)
        })
        .collect();
    let views: Vec<&View> = views.iter().collect();
    let seen = InitialViews::new(&views, [0.0; 3]).expect("in memory");
    let mut rng = Pcg64::seed_from_u64(5);
    let compared: Vec<(usize, &View)> = before.iter().enumerate().collect();
    let mut points = |others: &[(usize, &View)]| {
        seen.changing_points(100, others, [0.0; 3], &mut rng)
            .expect("in memory")
    };
    let changing = points(&compared);
    let n = changing.positions.len();
    let inside = |p: &&[f32; 3]| [p[0], p[1]].iter().all(|v| (-0.3..=0.8).contains(v));
    let there = changing.positions.iter().filter(inside).count();
    assert!(n > 50 && n <= 100, "{n}");
    assert!(10 * there >= 9 * n, "{there} of {n}");
    let same: Vec<(usize, &View)> = views.iter().copied().enumerate().collect();
    assert!(points(&same).positions.is_empty(), "nothing changes");
    assert!(points(&[]).positions.is_empty(), "nothing to compare with");
}

#[test]
fn points_lie_on_a_textured_wall() {
    let views = walls();
    let views: Vec<&View> = views.iter().collect();
    let seen = InitialViews::new(&views, [0.0; 3]).expect("in memory");
    let points = seen.points(300, &mut Pcg64::seed_from_u64(5));
    assert!(points.positions.len() > 200, "{}", points.positions.len());
    let mut off: Vec<f32> = points.positions.iter().map(|p| p[2].abs()).collect();
    off.sort_by(f32::total_cmp);
    // Planes lie 2 % of the depth apart: 0.08.
    let median = off[off.len() / 2];
    assert!(median < 0.05, "{median}");
}
