//! Gaussians that are hard to project.

use burn::tensor::Device;
use dash_kernels::Camera;
use dash_kernels::project::{Gaussians, ProjectOptions, View, project, reference, sh};
use dash_kernels::splats::{CONIC_A, N_COLUMNS, N_DIFFERENTIABLE, NEAR_PLANE, RADIUS_X, RADIUS_Y};
use rand::Rng;

use super::Case;
use super::inputs::{gradient, rng, tensor, to_host, tracked, uniform, widen};
use super::measured::Measured;
use crate::TrainError;

const FAMILY: &str = "projection";

/// Relative error of the 2D covariance's determinant: measured at most 1.6e-5 for needles of any
/// ratio up to 65,000 px when it is a sum that cannot cancel; 0.15 and more when it is `ac - b^2`.
const DETERMINANT: f64 = 5e-5;
/// Relative error of a packed splat: single precision's 6e-8 over the fifty operations of a
/// projection, and the determinant's own.
const SPLAT: f64 = DETERMINANT;
/// Error of a centre as a share of the picture's width or of its own place, whichever is more: a few
/// roundings.
const CENTRE: f64 = 1e-6;
/// Relative error of a Gaussian's gradient where nothing cancels.
const GRADIENT: f64 = 1e-3;
pub(super) const CASES: &[Case] = &[
    Case {
        family: FAMILY,
        name: "needles",
        extreme: "axis ratios of 1e2 to 1e8, lengths of 10 to 65,000 px",
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

/// A set of Gaussians in the precision of the kernels.
struct Set {
    means: Vec<f32>,
    quats: Vec<f32>,
    scales: Vec<f32>,
    opacities: Vec<f32>,
    sh_coeffs: Vec<f32>,
    sh_degree: usize,
}

impl Set {
    /// Ordinary ones, at depths of 1 to 6 in front of [`camera`].
    fn ordinary(seed: u64, n: usize, sh_degree: usize) -> Self {
        let mut rng = rng(seed);
        let mut means = Vec::with_capacity(3 * n);
        for _ in 0..n {
            let z: f32 = rng.random_range(1.0..6.0);
            means.extend([
                z * rng.random_range(-0.3..0.3),
                z * rng.random_range(-0.2..0.2),
                z,
            ]);
        }
        Self {
            means,
            quats: uniform(&mut rng, 4 * n, -1.0, 1.0),
            scales: uniform(&mut rng, 3 * n, -5.0, -2.0),
            opacities: uniform(&mut rng, n, -1.0, 3.0),
            sh_coeffs: uniform(&mut rng, 3 * n * sh::N_COEFFS[sh_degree], -0.3, 0.3),
            sh_degree,
        }
    }

    fn len(&self) -> usize {
        self.opacities.len()
    }
}

fn camera() -> Camera {
    Camera::new(1000.0, 1000.0, 320.0, 240.0, 640, 480)
}

/// What came out for each Gaussian, and what should have.
struct Compared {
    splats: Vec<f32>,
    expected: Vec<f64>,
    /// Rows that the device and the reference both draw.
    both: Vec<usize>,
    /// Rows that one of them draws.
    either_alone: usize,
    /// Of means, quaternions, scales, opacities, colours: width, gradient, expected.
    gradients: Vec<(&'static str, usize, Vec<f32>, Vec<f64>)>,
}

/// Projects on the device and in `f64`, with random cotangents.
fn compare(set: &Set, near_plane: f64, device: &Device) -> Result<Compared, TrainError> {
    let (n, k) = (set.len(), sh::N_COEFFS[set.sh_degree]);
    let options = ProjectOptions {
        near_plane,
        ..ProjectOptions::default()
    };
    let means = tracked(&set.means, [n, 3], device);
    let quats = tracked(&set.quats, [n, 4], device);
    let scales = tracked(&set.scales, [n, 3], device);
    let opacities = tracked(&set.opacities, [n], device);
    let sh_coeffs = tracked(&set.sh_coeffs, [n, k, 3], device);
    let out = project(
        means.clone(),
        quats.clone(),
        scales.clone(),
        opacities.clone(),
        sh_coeffs.clone(),
        &camera(),
        &options,
    )?;
    let splats = to_host(out.clone().inner());
    let v_splats = uniform(&mut rng(7), n * N_COLUMNS, -1.0, 1.0);
    let v_out = tensor(&v_splats, [n, N_COLUMNS], &device.clone().autodiff());
    let gradients = (out * v_out).sum().backward();

    let wide = [
        &set.means,
        &set.quats,
        &set.scales,
        &set.opacities,
        &set.sh_coeffs,
    ]
    .map(|v| widen(v));
    let gaussians = Gaussians {
        means: &wide[0],
        quats: &wide[1],
        scales: &wide[2],
        opacities: &wide[3],
        sh_coeffs: &wide[4],
        n_coeffs: k,
    };
    let view = View::<f64>::new(&camera(), &options, set.sh_degree);
    let expected = reference::project(&gaussians, &view);
    let v = reference::project_vjp(&gaussians, &view, &widen(&v_splats));
    let drawn = |row: usize| {
        let at = row * N_COLUMNS + RADIUS_X;
        [splats[at] > 0.0, expected[at] > 0.0]
    };
    let gradients = vec![
        ("means", 3, gradient(&means, &gradients), v.v_means),
        ("quats", 4, gradient(&quats, &gradients), v.v_quats),
        ("scales", 3, gradient(&scales, &gradients), v.v_scales),
        (
            "opacities",
            1,
            gradient(&opacities, &gradients),
            v.v_opacities,
        ),
        (
            "sh_coeffs",
            3 * k,
            gradient(&sh_coeffs, &gradients),
            v.v_sh_coeffs,
        ),
    ];
    Ok(Compared {
        both: (0..n).filter(|&row| drawn(row) == [true, true]).collect(),
        either_alone: (0..n).filter(|&row| drawn(row)[0] != drawn(row)[1]).count(),
        splats,
        expected,
        gradients,
    })
}

impl Compared {
    /// Everything that came out is finite; rows that both draw agree.
    fn judge(&self, splat: f64, gradient: f64) -> Measured {
        let mut measured = Measured::default();
        measured.saw(&self.splats);
        let pick = |got: &[f32], expected: &[f64], width: usize, used: usize| {
            let rows = self.both.iter();
            let (mut a, mut b) = (Vec::new(), Vec::new());
            for at in rows.map(|row| row * width) {
                a.extend_from_slice(&got[at..at + used]);
                b.extend_from_slice(&expected[at..at + used]);
            }
            (a, b)
        };
        // Columns differ in size and unit: each is judged by itself.
        let (got, expected) = pick(&self.splats, &self.expected, N_COLUMNS, N_DIFFERENTIABLE);
        // A centre is off by roundings of its own size and of the principal point's.
        let rows = got.chunks_exact(N_DIFFERENTIABLE);
        let rows = rows.zip(expected.chunks_exact(N_DIFFERENTIABLE));
        let centres = rows.flat_map(|(got, expected)| {
            let width = camera().width as f64;
            [0, 1].map(|k| (f64::from(got[k]) - expected[k]).abs() / (expected[k].abs() + width))
        });
        measured.judge("centres", centres.fold(0.0, f64::max), CENTRE);
        for (name, columns) in [("conics", 2..5), ("colours", 5..9)] {
            let (mut a, mut b) = (Vec::new(), Vec::new());
            for at in (0..got.len()).step_by(N_DIFFERENTIABLE) {
                a.extend_from_slice(&got[at + columns.start..at + columns.end]);
                b.extend_from_slice(&expected[at + columns.start..at + columns.end]);
            }
            measured.agree_by_row(name, &a, &b, columns.len(), splat);
        }
        for (name, width, got, expected) in &self.gradients {
            measured.saw(got);
            let (got, expected) = pick(got, expected, *width, *width);
            let name = format!("gradient of {name}");
            measured.agree_by_row(&name, &got, &expected, *width, gradient);
        }
        measured
    }
}

fn needles(device: &Device) -> Result<Measured, TrainError> {
    let n = 1000;
    let mut set = Set::ordinary(1, n, 0);
    let mut rng = rng(2);
    for (mean, scale) in set
        .means
        .chunks_exact(3)
        .zip(set.scales.chunks_exact_mut(3))
    {
        let length_px = 10f64.powf(rng.random_range(1.0..65_000f64.log10()));
        let ratio = 10f64.powf(rng.random_range(2.0..8.0));
        let length = length_px * f64::from(mean[2]) / camera().fx;
        scale.copy_from_slice(&[length, length / ratio, length / ratio].map(|s| s.ln() as f32));
    }
    set.opacities.fill(2.0);
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
    // The gradient of a needle's scales and rotation is rounding, in single precision, from about 10 px on:
    // conic v_conic conic cancels. It has to be finite.
    for (_, _, got, _) in &compared.gradients {
        measured.saw(got);
    }
    Ok(measured)
}

fn scales(device: &Device) -> Result<Measured, TrainError> {
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

fn quaternions(device: &Device) -> Result<Measured, TrainError> {
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

fn near_plane(device: &Device) -> Result<Measured, TrainError> {
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

fn borders(device: &Device) -> Result<Measured, TrainError> {
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

fn opacities(device: &Device) -> Result<Measured, TrainError> {
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

fn view_direction(device: &Device) -> Result<Measured, TrainError> {
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
