//! Depth on surfaces that are known.

use super::*;

const WIDTH: usize = 64;
const HEIGHT: usize = 48;

/// A slanted plane, z = SLOPE x, seen from 4 away. Between -0.5 and 0.5 along x it has no texture.
const SLOPE: f64 = 0.5;

fn camera(eye: [f64; 2]) -> Camera {
    let eye = DVec3::new(eye[0], eye[1], -4.0);
    Camera::new(60.0, 60.0, 32.0, 24.0, WIDTH, HEIGHT).look_at(
        eye,
        DVec3::new(0.3 * eye.x, eye.y, 0.0),
        -DVec3::Y,
    )
}

/// Where the ray of a place in the picture meets the plane.
fn on_plane(camera: &Camera, u: f64, v: f64) -> DVec3 {
    let origin = DVec3::from(camera.position());
    let ray = DVec3::from(camera.unproject([u, v], 1.0)) - origin;
    let normal = DVec3::new(SLOPE, 0.0, -1.0);
    origin - ray * (normal.dot(origin) / normal.dot(ray))
}

/// Exposed by a factor.
fn picture(camera: &Camera, is_flat: impl Fn(DVec3) -> bool, exposure: f64) -> Picture {
    let mut rgb = Vec::new();
    for pixel in 0..WIDTH * HEIGHT {
        let (x, y) = (pixel % WIDTH, pixel / WIDTH);
        let mut sum = DVec3::ZERO;
        for (u, v) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
            let at = on_plane(camera, x as f64 + u, y as f64 + v);
            let wave =
                |k: f64, phase: f64| 0.5 + 0.35 * (k * at.x + phase).sin() * (k * at.y).cos();
            sum += match is_flat(at) {
                true => DVec3::splat(0.5),
                false => DVec3::new(wave(6.0, 0.0), wave(9.0, 1.0), wave(5.0, 2.0)),
            };
        }
        rgb.extend((sum / 4.0 * exposure).to_array().map(|c| c as f32));
    }
    Picture::new(camera.clone(), &rgb, false)
}

fn cameras() -> Vec<Camera> {
    let places = [-0.9, -0.3, 0.3, 0.9].iter();
    places
        .flat_map(|&x| [-0.4, 0.4].map(|y| camera([x, y])))
        .collect()
}

fn pictures() -> Vec<Picture> {
    let is_flat = |at: DVec3| at.x.abs() < 0.5;
    let exposures = [1.0, 0.9, 1.1, 1.0, 0.95, 1.05, 1.0, 0.9];
    let cameras = cameras().into_iter().zip(exposures);
    cameras
        .map(|(camera, exposure)| picture(&camera, is_flat, exposure))
        .collect()
}

#[test]
fn a_slanted_plane_is_found_where_it_has_no_texture_too() {
    let pictures = pictures();
    let (mut textured, mut flat) = (Vec::new(), Vec::new());
    for (picture, points) in pictures.iter().zip(points(&pictures, DVec3::ZERO)) {
        for (pixel, point) in points.into_iter().enumerate() {
            let (x, y) = (pixel % WIDTH, pixel / WIDTH);
            let expected = on_plane(&picture.camera, x as f64 + 0.5, y as f64 + 0.5);
            let Some(point) = point else {
                continue;
            };
            let found = DVec3::from(point.map(f64::from));
            let off = (found.z - SLOPE * found.x).abs();
            match expected.x.abs() {
                x if x < 0.4 => flat.push(off),
                x if x > 0.6 => textured.push(off),
                _ => {}
            }
        }
    }
    // A plane of the sweep is 2 % of the depth wide: 0.08.
    for (name, mut off, at_least, median, tail) in [
        ("textured", textured, 8_000, 0.02, 0.1),
        ("flat", flat, 3_000, 0.16, 0.3),
    ] {
        off.sort_by(f64::total_cmp);
        let at = |share: f64| off[(share * off.len() as f64) as usize];
        let n = off.len();
        assert!(n > at_least, "{name}: {n}");
        assert!(
            at(0.5) < median && at(0.95) < tail,
            "{name}: {} {}",
            at(0.5),
            at(0.95)
        );
    }
}

#[test]
fn depths_that_no_other_view_confirms_are_left_out() {
    let mut pictures = pictures();
    let mut confirmed = |spoiled: &[usize]| {
        for (n, &view) in spoiled.iter().enumerate() {
            // Another scene: noise.
            for (pixel, color) in pictures[view].colors.iter_mut().enumerate() {
                let noise =
                    |k: usize| (((pixel * 7919 + k * 104_729 + n * 31) % 1009) as f32) / 1009.0;
                *color = [noise(1), noise(2), noise(3), noise(4) - 0.5];
            }
        }
        let found = points(&pictures, DVec3::ZERO);
        found[0].iter().flatten().count()
    };
    let all = WIDTH * HEIGHT;
    assert!(confirmed(&[]) > all / 2);
    assert!(confirmed(&[1, 2, 3, 4, 5, 6, 7]) < all / 10);
}

/// The cost of a plane at a pixel in double precision, straight from its definition.
fn reference_cost(own: &Picture, others: &[&Picture], inverse: f64, [x, y]: [usize; 2]) -> f64 {
    let mut costs = Vec::new();
    for other in others {
        // A pixel and what the other view shows there; colours and luma.
        let pair = |x: isize, y: isize| -> ([f64; 4], Option<[f64; 4]>) {
            let x = x.clamp(0, WIDTH as isize - 1) as usize;
            let y = y.clamp(0, HEIGHT as isize - 1) as usize;
            let centre = [x as f64 + 0.5, y as f64 + 0.5];
            let point = own.camera.unproject(centre, 1.0 / inverse);
            let shown = other.camera.project_inside(point).map(|([u, v], _)| {
                let (u, v) = (u - 0.5, v - 0.5);
                let at = |x: f64, y: f64| {
                    let x = x.clamp(0.0, WIDTH as f64 - 1.0) as usize;
                    let y = y.clamp(0.0, HEIGHT as f64 - 1.0) as usize;
                    other.colors[y * WIDTH + x].map(f64::from)
                };
                let (left, top) = (u.floor(), v.floor());
                let mut color = [0.0; 4];
                for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                    let weight = (1.0 - (u - left - dx).abs()) * (1.0 - (v - top - dy).abs());
                    for (sum, value) in color.iter_mut().zip(at(left + dx, top + dy)) {
                        *sum += weight * value;
                    }
                }
                color
            });
            (own.colors[y * WIDTH + x].map(f64::from), shown)
        };
        let (a, Some(b)) = pair(x as isize, y as isize) else {
            continue;
        };
        let window: Vec<(f64, f64)> = (-2..=2)
            .flat_map(|dy| (-2..=2).map(move |dx| (dx, dy)))
            .map(|(dx, dy)| pair(x as isize + dx, y as isize + dy))
            .map(|(a, b)| (a[3], b.map_or(0.0, |b| b[3])))
            .collect();
        let mean = |of: &dyn Fn(&(f64, f64)) -> f64| window.iter().map(of).sum::<f64>() / 25.0;
        let means = [mean(&|p| p.0), mean(&|p| p.1)];
        let covariance = mean(&|p| (p.0 - means[0]) * (p.1 - means[1]));
        let variances = [
            mean(&|p| (p.0 - means[0]).powi(2)),
            mean(&|p| (p.1 - means[1]).powi(2)),
        ]
        .map(|variance| variance + f64::from(cost::NOISE));
        let correlation = covariance / (variances[0] * variances[1]).sqrt();
        let difference = (0..3).map(|c| (a[c] - b[c]).abs()).sum::<f64>() / 3.0;
        let difference = (difference / f64::from(cost::MOST_DIFFERENCE)).min(1.0);
        let share = f64::from(cost::CORRELATION);
        costs.push(share * 0.5 * (1.0 - correlation) + (1.0 - share) * difference);
    }
    if costs.is_empty() {
        return f64::from(cost::UNSEEN);
    }
    costs.sort_by(f64::total_cmp);
    let half = costs.len().div_ceil(2);
    costs[..half].iter().sum::<f64>() / half as f64
}

#[test]
fn costs_are_those_of_the_reference() {
    let mut pictures = pictures();
    for (n_others, is_cut_out) in [
        (0, false),
        (1, false),
        (2, true),
        (3, false),
        (5, false),
        (6, true),
    ] {
        pictures[0].is_cut_out = is_cut_out;
        let nearness = if is_cut_out {
            0.0
        } else {
            f64::from(cost::NEARNESS)
        };
        let others: Vec<&Picture> = pictures[1..=n_others].iter().collect();
        let planes = Planes::of(&pictures[0].camera, DVec3::ZERO);
        let volume = cost::volume(&pictures[0], &others, planes);
        let (mut worst, mut seen) = (0.0f64, 0);
        for pixel in (0..WIDTH * HEIGHT).step_by(37) {
            let at = [pixel % WIDTH, pixel / WIDTH];
            for plane in (0..PLANES).step_by(13) {
                let inverse = planes.inverse(plane as f64);
                let expected = reference_cost(&pictures[0], &others, inverse, at);
                let found = f64::from(volume[pixel * PLANES + plane]);
                let nearer = nearness * plane as f64 / PLANES as f64;
                let whole = expected.clamp(0.0, 1.0) * 255.0 + nearer;
                worst = worst.max((found - whole.min(255.0)).abs());
                seen += usize::from((expected - f64::from(cost::UNSEEN)).abs() > 1e-9);
            }
        }
        // Rounded down to whole numbers.
        assert!(worst < 1.05, "{n_others}: {worst}");
        assert_eq!(seen > 0, n_others > 0);
    }
}

#[test]
fn neighbours_meet_at_fair_angles_and_look_along() {
    let flat = |camera: &Camera| picture(camera, |_| true, 1.0);
    // From 4 away: 1, 9, 14 and 45 degrees, one at the same place, one that looks back.
    let places = [0.0, 0.07, 0.63, 1.0, 4.0, 0.0];
    let mut pictures: Vec<Picture> = places.iter().map(|&x| flat(&camera([x, 0.0]))).collect();
    let back = Camera::new(60.0, 60.0, 32.0, 24.0, WIDTH, HEIGHT);
    let back = back.look_at(
        DVec3::new(0.5, 0.0, -4.0),
        DVec3::new(0.5, 0.0, -9.0),
        -DVec3::Y,
    );
    pictures.push(flat(&back));
    assert_eq!(neighbours(&pictures, 0, DVec3::ZERO), [3, 2, 4, 1]);
}

#[test]
fn one_pixel_takes_the_plane_of_those_around_it() {
    let camera = camera([0.0, 0.0]);
    let alike = picture(&camera, |_| true, 1.0);
    let (clear, odd) = (90, HEIGHT / 2 * WIDTH + WIDTH / 2);
    let mut volume = vec![128u8; WIDTH * HEIGHT * PLANES];
    for pixel in 0..WIDTH * HEIGHT {
        volume[pixel * PLANES + clear] = 20;
    }
    volume[odd * PLANES + clear] = 60;
    volume[odd * PLANES + 30] = 10;
    let planes = semi_global::planes(&volume, &alike);
    assert!(
        planes
            .iter()
            .all(|plane| (plane - clear as f32).abs() < 0.5)
    );
}

#[test]
fn what_nothing_tells_apart_is_far() {
    // Black but for the texture of a narrow strip.
    let is_strip = |at: DVec3| at.x.abs() < 0.3;
    let pictures: Vec<Picture> = cameras()
        .iter()
        .map(|camera| {
            let mut picture = picture(camera, |_| false, 1.0);
            for pixel in 0..WIDTH * HEIGHT {
                let (x, y) = (pixel % WIDTH, pixel / WIDTH);
                let at = on_plane(camera, x as f64 + 0.5, y as f64 + 0.5);
                if !is_strip(at) {
                    picture.colors[pixel] = [0.0, 0.0, 0.0, -0.5];
                }
            }
            picture
        })
        .collect();
    let (mut near, mut all, mut on_strip) = (0, 0, 0);
    for (picture, points) in pictures.iter().zip(points(&pictures, DVec3::ZERO)) {
        for (pixel, point) in points.iter().enumerate() {
            let (x, y) = (pixel % WIDTH, pixel / WIDTH);
            let at = on_plane(&picture.camera, x as f64 + 0.5, y as f64 + 0.5);
            let Some(point) = point else { continue };
            if at.x.abs() < 0.2 {
                on_strip += usize::from((f64::from(point[2]) - at.z).abs() < 0.2);
            } else if at.x.abs() > 0.8 {
                all += 1;
                near += usize::from(point[2] < 1.0);
            }
        }
    }
    assert!(on_strip > 500, "{on_strip}");
    assert!(10 * near < all, "{near} of {all} are as near as the strip");
}
