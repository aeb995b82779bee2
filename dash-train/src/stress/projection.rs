//! Gaussians that are hard to project.

use std::ops::Range;

use burn::tensor::Device;
use dash_kernels::project::{ProjectOptions, View};
use dash_kernels::splats::{CONIC_A, N_COLUMNS, NEAR_PLANE, RADIUS_X, RADIUS_Y};
use rand::Rng;

use super::Case;
use super::inputs::{rng, uniform};
use super::measured::{Measured, worst_of};
use super::projected::{Set, camera, compare};
use crate::Error;

const FAMILY: &str = "projection";

/// Relative error of the 2D covariance's determinant: measured at most 1.6e-5 for needles of any
/// ratio up to 65,000 px when it is a sum that cannot cancel; 0.15 and more when it is `ac - b^2`.
const DETERMINANT: f64 = 5e-5;
/// Relative error of a packed splat: single precision's 6e-8 over the fifty operations of a
/// projection, and the determinant's own.
const SPLAT: f64 = DETERMINANT;
/// Relative error of a Gaussian's gradient where nothing cancels.
const GRADIENT: f64 = 1e-3;
/// Error of the gradient of a needle as a share of its length, or of [`NEEDLE_FLOOR`] where that is more.
const NEEDLE_GRADIENT: f64 = 0.01;
/// What counts as a gradient of a needle, for cotangents of 1: that of its length falls with the square
/// of it, to nothing.
const NEEDLE_FLOOR: f64 = 1e-2;

pub(super) const CASES: &[Case] = &[
    Case {
        family: FAMILY,
        name: "needles",
        extreme: "axis ratios of 1e2 to 1e8, lengths of 1 to 65,000 px",
        measure: needles,
    },
    Case {
        family: FAMILY,
        name: "scales",
        extreme: "scales of e^-30 to e^40 world units",
        measure: scales,
    },
    Case {
        family: FAMILY,
        name: "quaternions",
        extreme: "quaternions of length 0, 1e-5 to 1e18, and 1e30",
        measure: quaternions,
    },
    Case {
        family: FAMILY,
        name: "near plane",
        extreme: "z at the near plane and one step beside it, at 0, behind the camera, at 1e10",
        measure: near_plane,
    },
    Case {
        family: FAMILY,
        name: "borders",
        extreme: "centres on and beside the image's border and the Jacobian's",
        measure: borders,
    },
    Case {
        family: FAMILY,
        name: "opacities",
        extreme: "opacity logits of -100 to 100, and 1e30",
        measure: opacities,
    },
    Case {
        family: FAMILY,
        name: "view direction",
        extreme: "distances to the camera of 1 down to 0, degree 3",
        measure: view_direction,
    },
];

/// Needles of axis ratios of 1e2 to 1e8.
fn needles_of(lengths_px: Range<f64>) -> Set {
    let mut set = Set::ordinary(1, 1000, 0);
    let mut rng = rng(2);
    for (mean, scale) in set
        .means
        .chunks_exact(3)
        .zip(set.scales.chunks_exact_mut(3))
    {
        let exponents = lengths_px.start.log10()..lengths_px.end.log10();
        let length_px = 10f64.powf(rng.random_range(exponents));
        let ratio = 10f64.powf(rng.random_range(2.0..8.0));
        let length = length_px * f64::from(mean[2]) / camera().fx;
        scale.copy_from_slice(&[length, length / ratio, length / ratio].map(|s| s.ln() as f32));
    }
    set.opacities.fill(2.0);
    set
}

fn needles(device: &Device) -> Result<Measured, Error> {
    let set = needles_of(1.0..65_000.0);
    let n = set.len();
    let compared = compare(&set, NEAR_PLANE, device)?;
    let mut measured = Measured::default();
    measured.saw(&compared.splats);
    // Radius^2 is proportional to the covariance's diagonal, and conic a = yy / det.
    let det = |radius_y: f64, a: f64| radius_y * radius_y / a;
    let errors = compared.both.iter().map(|row| {
        let (y, a) = (row * N_COLUMNS + RADIUS_Y, row * N_COLUMNS + CONIC_A);
        let got = det(f64::from(compared.splats[y]), f64::from(compared.splats[a]));
        (got / det(compared.expected[y], compared.expected[a]) - 1.0).abs()
    });
    measured.judge("determinant", errors.fold(0.0, f64::max), DETERMINANT);
    measured.none("drawn by one alone", compared.either_alone);
    measured.none("not drawn", usize::from(compared.both.len() < n / 2));
    for (name, width, got, expected) in &compared.gradients {
        measured.saw(got);
        let rows = got.chunks(*width).zip(expected.chunks(*width));
        let errors = rows.map(|(got, expected)| {
            let differences = got.iter().zip(expected);
            let difference = differences.map(|(&g, e)| (f64::from(g) - e).powi(2));
            let size: f64 = expected.iter().map(|e| e * e).sum();
            (difference.sum::<f64>() / size.max(NEEDLE_FLOOR * NEEDLE_FLOOR)).sqrt()
        });
        let name = format!("gradient of {name}");
        measured.judge(name, worst_of(errors), NEEDLE_GRADIENT);
    }
    Ok(measured)
}

fn scales(device: &Device) -> Result<Measured, Error> {
    let n = 1000;
    let mut set = Set::ordinary(3, n, 1);
    set.scales = uniform(&mut rng(4), 3 * n, -30.0, 40.0);
    let mut measured = Measured::default();
    let compared = compare(&set, NEAR_PLANE, device)?;
    measured.saw(&compared.splats);
    for (_, _, got, _) in &compared.gradients {
        measured.saw(got);
    }
    // What single precision can hold: the fourth power of the projected size, here up to 1e9 px.
    let mut round = Set::ordinary(3, n, 1);
    for (row, scale) in round.scales.chunks_exact_mut(3).enumerate() {
        scale.fill(-30.0 + 43.0 * row as f32 / n as f32);
    }
    let compared = compare(&round, NEAR_PLANE, device)?;
    measured.none("round: drawn by one alone", compared.either_alone);
    let mut judged = compared.judge(SPLAT, GRADIENT);
    // A turn does not change what is round: its gradient is rounding.
    judged.parts.retain(|part| part.name != "gradient of quats");
    measured.finite &= judged.finite;
    measured.parts.extend(judged.parts);
    Ok(measured)
}

fn quaternions(device: &Device) -> Result<Measured, Error> {
    let lengths = [0.0, 1e-7, 1e-5, 1e-3, 1.0, 1e5, 1e10, 1e15, 1e18];
    let n = 20 * lengths.len();
    let mut set = Set::ordinary(5, n, 1);
    for (row, quat) in set.quats.chunks_exact_mut(4).enumerate() {
        let norm = quat.iter().map(|q| q * q).sum::<f32>().sqrt();
        for q in quat {
            *q *= lengths[row % lengths.len()] / norm;
        }
    }
    let compared = compare(&set, NEAR_PLANE, device)?;
    let mut measured = compared.judge(SPLAT, GRADIENT);
    measured.none("drawn by one alone", compared.either_alone);
    let culled = |row: usize| compared.splats[row * N_COLUMNS + RADIUS_X] == 0.0;
    let wrong = (0..n)
        .filter(|row| culled(*row) != (row % lengths.len() < 2))
        .count();
    measured.none("not culled below 1e-6", wrong);
    set.quats.iter_mut().for_each(|q| *q *= 1e30);
    let compared = compare(&set, NEAR_PLANE, device)?;
    measured.saw(&compared.splats);
    for (_, _, got, _) in &compared.gradients {
        measured.saw(got);
    }
    Ok(measured)
}

fn near_plane(device: &Device) -> Result<Measured, Error> {
    let near = NEAR_PLANE as f32;
    let depths = [
        near.next_down(),
        near,
        near.next_up(),
        0.0,
        -0.0,
        f32::MIN_POSITIVE,
        -near,
        -1.0,
        -1e10,
        1e10,
    ];
    let n = depths.len();
    let mut set = Set::ordinary(6, n, 1);
    for (mean, z) in set.means.chunks_exact_mut(3).zip(depths) {
        mean.copy_from_slice(&[0.1 * z, -0.1 * z, z]);
    }
    for (scale, z) in set.scales.chunks_exact_mut(3).zip(depths) {
        let size = (0.01 * z.abs().max(1e-3)).ln();
        scale.copy_from_slice(&[size, size + 0.7, size - 0.5]);
    }
    let compared = compare(&set, NEAR_PLANE, device)?;
    let mut measured = compared.judge(SPLAT, GRADIENT);
    let wrong = (0..n).filter(|row| compared.both.contains(row) != (depths[*row] >= near));
    measured.none("on the wrong side", wrong.count());
    Ok(measured)
}

fn borders(device: &Device) -> Result<Measured, Error> {
    let camera = camera();
    let view = View::<f64>::new(&camera, &ProjectOptions::default(), 0);
    let (w, h) = (camera.width as f64, camera.height as f64);
    // A thousandth beside a border: on it rounding decides which side is taken.
    let beside = |x: f64| [x - 1e-3, x, x + 1e-3];
    let edge = |axis: usize, px: f64| [(px - [320.0, 240.0][axis]) / 1000.0];
    let sides = |axis: usize, size: f64| -> Vec<f64> {
        let jacobian = [view.lowest[axis], view.highest[axis]].into_iter();
        let jacobian = jacobian.flat_map(|x| [x - 1e-3, x + 1e-3, 2.0 * x]);
        let image = [0.0, size].into_iter().flat_map(|px| edge(axis, px));
        image
            .flat_map(beside)
            .chain(jacobian)
            .chain([0.0])
            .collect()
    };
    let (xs, ys) = (sides(0, w), sides(1, h));
    let n = xs.len() * ys.len();
    let mut set = Set::ordinary(8, n, 0);
    for (row, mean) in set.means.chunks_exact_mut(3).enumerate() {
        let z = 2.0;
        let (x, y) = (xs[row % xs.len()] * z, ys[row / xs.len()] * z);
        mean.copy_from_slice(&[x as f32, y as f32, z as f32]);
    }
    // Wide enough to reach the picture from beyond.
    set.scales = uniform(&mut rng(9), 3 * n, -2.0, 0.5);
    let compared = compare(&set, NEAR_PLANE, device)?;
    let mut measured = compared.judge(SPLAT, GRADIENT);
    measured.none("drawn by one alone", compared.either_alone);
    Ok(measured)
}

fn opacities(device: &Device) -> Result<Measured, Error> {
    let logits = [
        -1e30, -100.0, -88.0, -30.0, -17.0, -5.0, 0.0, 5.0, 15.0, 17.0, 30.0, 88.0, 100.0, 1e30,
    ];
    let n = 10 * logits.len();
    let mut set = Set::ordinary(10, n, 1);
    for (row, logit) in set.opacities.iter_mut().enumerate() {
        *logit = logits[row % logits.len()];
    }
    let compared = compare(&set, NEAR_PLANE, device)?;
    let mut measured = compared.judge(SPLAT, f64::INFINITY);
    measured.none("drawn by one alone", compared.either_alone);
    measured
        .parts
        .retain(|part| !part.name.starts_with("gradient"));
    for (name, _, got, expected) in &compared.gradients {
        // One minus an opacity that is rounded to 1 is off by all of it, and next to nothing: all rows
        // are judged together.
        measured.agree(&format!("gradient of {name}"), got, expected, GRADIENT);
    }
    Ok(measured)
}

fn view_direction(device: &Device) -> Result<Measured, Error> {
    let distances = [1.0, 1e-3, 1e-6, 1e-10, 1e-15, 1e-18, 1e-25, 1e-38, 0.0];
    let n = 10 * distances.len();
    let mut set = Set::ordinary(11, n, 3);
    for row in 0..n {
        let z: f32 = distances[row % distances.len()];
        set.means[3 * row..3 * row + 3].copy_from_slice(&[0.1 * z, 0.05 * z, z]);
        set.scales[3 * row..3 * row + 3].fill((0.01 * z).max(1e-30).ln());
    }
    let everything = compare(&set, f64::from(f32::MIN_POSITIVE), device)?;
    let mut measured = Measured::default();
    measured.saw(&everything.splats);
    for (_, _, got, _) in &everything.gradients {
        measured.saw(got);
    }
    // Squares of smaller distances are zero in single precision.
    let compared = compare(&set, 1e-16, device)?;
    measured.none("drawn by one alone", compared.either_alone);
    let mut judged = compared.judge(SPLAT, GRADIENT);
    // With the distance the gradients of means and scales go beyond what a float holds.
    judged
        .parts
        .retain(|part| part.name == "colours" || part.name.ends_with("sh_coeffs"));
    measured.finite &= judged.finite;
    measured.parts.extend(judged.parts);
    Ok(measured)
}
