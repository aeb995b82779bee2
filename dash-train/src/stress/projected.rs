//! Gaussians projected on a device and in `f64`.

use burn::tensor::Device;
use dash_kernels::Camera;
use dash_kernels::project::{Gaussians, ProjectOptions, ShSlices, View, project, reference, sh};
use dash_kernels::splats::{N_COLUMNS, N_DIFFERENTIABLE, RADIUS_X};
use rand::Rng;

use super::inputs::{gradient, rng, tensor, to_host, tracked, uniform, widen};
use super::measured::Measured;
use crate::Error;

/// Error of a centre as a share of the picture's width or of its own place, whichever is more: a few
/// roundings.
const CENTRE: f64 = 1e-6;

/// A set of Gaussians in the precision of the kernels.
pub(super) struct Set {
    pub(super) means: Vec<f32>,
    pub(super) quats: Vec<f32>,
    pub(super) scales: Vec<f32>,
    pub(super) opacities: Vec<f32>,
    pub(super) sh_coeffs: Vec<f32>,
    pub(super) sh_degree: usize,
}

impl Set {
    /// Ordinary ones, at depths of 1 to 6 in front of [`camera`].
    pub(super) fn ordinary(seed: u64, n: usize, sh_degree: usize) -> Self {
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

    /// How many.
    pub(super) fn len(&self) -> usize {
        self.opacities.len()
    }
}

/// Where all of them are seen from.
pub(super) fn camera() -> Camera {
    Camera::new(1000.0, 1000.0, 320.0, 240.0, 640, 480)
}

/// What came out for each Gaussian, and what should have.
pub(super) struct Compared {
    pub(super) splats: Vec<f32>,
    pub(super) expected: Vec<f64>,
    /// Rows that the device and the reference both draw.
    pub(super) both: Vec<usize>,
    /// Rows that one of them draws.
    pub(super) either_alone: usize,
    /// Of means, quaternions, scales, opacities, colours: width, gradient, expected.
    pub(super) gradients: Vec<(&'static str, usize, Vec<f32>, Vec<f64>)>,
}

/// Projects on the device and in `f64`, with random cotangents.
pub(super) fn compare(set: &Set, near_plane: f64, device: &Device) -> Result<Compared, Error> {
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
    let mut v_splats = uniform(&mut rng(7), n * N_COLUMNS, -1.0, 1.0);
    for v_row in v_splats.chunks_exact_mut(N_COLUMNS) {
        v_row[N_DIFFERENTIABLE..].fill(0.0);
    }
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
        sh_coeffs: ShSlices::joined(&wide[4], k),
    };
    let view = View::<f64>::new(&camera(), &options, set.sh_degree);
    let expected = reference::project(&gaussians, &view);
    let v = reference::project_vjp(&gaussians, &view, &widen(&v_splats));
    let v_sh_coeffs = v.v_sh_coeffs();
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
            v_sh_coeffs,
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
    /// Every value is finite, and rows that both draw agree.
    pub(super) fn judge(&self, splat: f64, gradient: f64) -> Measured {
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
