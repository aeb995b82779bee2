mod edges;

use burn::tensor::{Device, Tensor};
use rand::Rng;

use super::{Activation, Gaussians, ProjectOptions, ShSlices, View, cpu, project, reference};
use crate::Camera;
use crate::KernelError;
use crate::splats::{self, N_COLUMNS, N_DIFFERENTIABLE};
use crate::testing::{
    assert_agrees, assert_close, assert_finite, assert_same_for_any_thread_count,
    central_differences, devices, normals, rng, tensor, to_f32, to_f64, values,
};

/// Gaussians in double precision.
#[derive(Clone)]
struct Set {
    means: Vec<f64>,
    quats: Vec<f64>,
    scales: Vec<f64>,
    opacities: Vec<f64>,
    sh_coeffs: Vec<f64>,
    n_coeffs: usize,
}

impl Set {
    /// In front of [`camera`], some beyond its border, opacities and scales as logits and
    /// logarithms; rounded to single precision, so that every kernel sees the same.
    fn random(seed: u64, n: usize, n_coeffs: usize) -> Self {
        let mut rng = rng(seed);
        let means = (0..n).flat_map(|_| {
            let z: f64 = rng.random_range(1.0..6.0);
            [
                z * rng.random_range(-0.9..0.9),
                z * rng.random_range(-0.7..0.7),
                z,
            ]
        });
        let means = means.collect();
        let scales = normals(&mut rng, 3 * n)
            .iter()
            .map(|v| v * 0.5 - 3.0)
            .collect();
        let rounded = |values: Vec<f64>| to_f64(&to_f32(&values));
        Self {
            means: rounded(means),
            quats: rounded(normals(&mut rng, 4 * n)),
            scales: rounded(scales),
            opacities: rounded(normals(&mut rng, n)),
            sh_coeffs: rounded(
                normals(&mut rng, 3 * n_coeffs * n)
                    .iter()
                    .map(|v| 0.3 * v)
                    .collect(),
            ),
            n_coeffs,
        }
    }

    fn gaussians(&self) -> Gaussians<'_, f64> {
        Gaussians {
            means: &self.means,
            quats: &self.quats,
            scales: &self.scales,
            opacities: &self.opacities,
            sh_coeffs: ShSlices::joined(&self.sh_coeffs, self.n_coeffs),
        }
    }

    fn len(&self) -> usize {
        self.opacities.len()
    }

    fn parts(&mut self) -> [&mut Vec<f64>; 5] {
        [
            &mut self.means,
            &mut self.quats,
            &mut self.scales,
            &mut self.opacities,
            &mut self.sh_coeffs,
        ]
    }

    fn tensors(&self, device: &Device) -> Tensors {
        let (n, k) = (self.len(), self.n_coeffs);
        Tensors {
            means: tensor(&to_f32(&self.means), [n, 3], device),
            quats: tensor(&to_f32(&self.quats), [n, 4], device),
            scales: tensor(&to_f32(&self.scales), [n, 3], device),
            opacities: tensor(&to_f32(&self.opacities), [n], device),
            sh_coeffs: tensor(&to_f32(&self.sh_coeffs), [n, k, 3], device),
        }
    }
}

#[derive(Clone)]
struct Tensors {
    means: Tensor<2>,
    quats: Tensor<2>,
    scales: Tensor<2>,
    opacities: Tensor<1>,
    sh_coeffs: Tensor<3>,
}

impl Tensors {
    fn project(self, camera: &Camera, options: &ProjectOptions) -> Result<Tensor<2>, KernelError> {
        project(
            self.means,
            self.quats,
            self.scales,
            self.opacities,
            self.sh_coeffs,
            camera,
            options,
        )
    }
}

/// A camera off the axes, with a principal point off the centre.
fn camera() -> Camera {
    Camera::new(90.0, 95.0, 70.0, 41.0, 128, 96).look_at(
        [0.2, -0.1, -0.3],
        [0.1, 0.1, 3.0],
        [0.05, -1.0, 0.0],
    )
}

fn view<T: num_traits::Float>(options: &ProjectOptions, n_coeffs: usize) -> View<T> {
    let degree = super::check_degree(1, n_coeffs, options.sh_degree).expect("the tests' are valid");
    View::new(&camera(), options, degree)
}

fn cotangents(seed: u64, n: usize) -> Vec<f64> {
    to_f64(&to_f32(&normals(&mut rng(seed), n * N_COLUMNS)))
}

/// A loss over the columns that carry a gradient.
fn loss(splats: &[f64], v_splats: &[f64]) -> f64 {
    splats
        .chunks_exact(N_COLUMNS)
        .zip(v_splats.chunks_exact(N_COLUMNS))
        .flat_map(|(row, v)| row.iter().zip(v).take(N_DIFFERENTIABLE))
        .map(|(value, v)| value * v)
        .sum()
}

#[test]
fn one_gaussian_by_hand() {
    // On the axis at depth 4, focal length 100, sigma 0.08 x 0.04: 2 and 1 pixels.
    let camera = Camera::new(100.0, 100.0, 32.0, 24.0, 64, 48);
    let options = ProjectOptions {
        activation: Activation::Linear,
        ..ProjectOptions::default()
    };
    let (sh_0, opacity) = (0.282_094_8f32, 0.8f32);
    for device in devices() {
        let splats = project(
            tensor(&[0.0, 0.0, 4.0], [1, 3], &device),
            tensor(&[2.0, 0.0, 0.0, 0.0], [1, 4], &device),
            tensor(&[0.08, 0.04, 0.5], [1, 3], &device),
            tensor(&[opacity], [1], &device),
            tensor(&[1.0, 0.0, -4.0], [1, 1, 3], &device),
            &camera,
            &options,
        )
        .expect("valid input");
        let extent = 2.0 * f64::from(255.0 * opacity).ln();
        let expected = [
            32.0,
            24.0,
            1.0 / 4.3,
            0.0,
            1.0 / 1.3,
            f64::from(opacity),
            0.5 + f64::from(sh_0),
            0.5,
            0.0,
            4.0,
            (extent * 4.3).sqrt(),
            (extent * 1.3).sqrt(),
            0.0,
            0.0,
            0.0,
            0.0,
        ];
        assert_close("splat", &to_f64(&values(splats)), &expected, 1e-6, 1e-6);
    }
}

#[test]
fn reference_gradient_against_central_differences() {
    /// Truncation and cancellation of differences with a step of 1e-6 in double precision.
    const RELATIVE: f64 = 1e-6;
    for (seed, n_coeffs, sh_degree, activation) in [
        (1, 16, None, Activation::Exp),
        (2, 16, Some(1), Activation::Exp),
        (3, 9, None, Activation::Linear),
        (4, 1, None, Activation::Exp),
    ] {
        let options = ProjectOptions {
            sh_degree,
            activation,
            ..ProjectOptions::default()
        };
        let mut set = Set::random(seed, 12, n_coeffs);
        if activation == Activation::Linear {
            set.scales
                .iter_mut()
                .for_each(|s| *s = s.exp() * if *s > -3.0 { -1.0 } else { 1.0 });
            set.opacities
                .iter_mut()
                .for_each(|o| *o = 1.0 / (1.0 + (-*o).exp()));
        }
        let view = view::<f64>(&options, n_coeffs);
        let v_splats = cotangents(seed, set.len());
        let n_drawn = reference::project(&set.gaussians(), &view)
            .chunks_exact(N_COLUMNS)
            .filter(|row| row[splats::RADIUS_X] > 0.0)
            .count();
        assert!(n_drawn >= 8, "the case is too poor: {n_drawn} drawn");
        let v = reference::project_vjp(&set.gaussians(), &view, &v_splats);
        let v_sh_coeffs = v.v_sh_coeffs();
        let gradients = [v.v_means, v.v_quats, v.v_scales, v.v_opacities, v_sh_coeffs];
        for (part, gradient) in gradients.iter().enumerate() {
            let at = set.clone().parts()[part].clone();
            let expected = central_differences(&at, 1e-6, |moved| {
                let mut set = set.clone();
                *set.parts()[part] = moved.to_vec();
                loss(&reference::project(&set.gaussians(), &view), &v_splats)
            });
            let scale = expected.iter().fold(0.0f64, |most, v| most.max(v.abs()));
            let name = format!("seed {seed}, input {part}");
            assert_close(&name, gradient, &expected, RELATIVE * scale, RELATIVE);
        }
    }
}

#[test]
fn kernels_against_the_reference() {
    for (seed, n, n_coeffs, activation) in [
        (10, 3000, 16, Activation::Exp),
        (11, 700, 9, Activation::Exp),
        (12, 700, 4, Activation::Exp),
        (13, 513, 1, Activation::Linear),
    ] {
        let options = ProjectOptions {
            activation,
            ..ProjectOptions::default()
        };
        let mut set = Set::random(seed, n, n_coeffs);
        if activation == Activation::Linear {
            let rounded = |v: f64| f64::from(v as f32);
            set.scales.iter_mut().for_each(|s| *s = rounded(s.exp()));
            set.opacities
                .iter_mut()
                .for_each(|o| *o = rounded(1.0 / (1.0 + (-*o).exp())));
        }
        assert_kernels_agree(
            &format!("seed {seed}"),
            &set,
            &options,
            &cotangents(seed, n),
        );
    }
}

/// Compares a needle's columns with what they are by the reference's mean and conic, which has no such columns.
fn assert_needle(name: &str, got: &[f64], expected: &[f64]) {
    let [a, b, c] = [splats::CONIC_A, splats::CONIC_B, splats::CONIC_C].map(|k| expected[k]);
    let (half, middle) = (0.5 * (a - c), 0.5 * (a + c));
    let distance = half.hypot(b);
    let [across, along] = [middle + distance, (a * c - b * b) / (middle + distance)];
    let ratio = across / along / splats::NEEDLE;
    let is_needle = got[splats::ALONG] > 0.0;
    assert!(
        is_needle || ratio.is_nan() || ratio < 1.01,
        "{name}: no needle at {ratio}"
    );
    if !is_needle {
        assert_eq!(got[splats::ACROSS_X..], [0.0; 4], "{name}");
        return;
    }
    assert!(ratio > 0.99, "{name}: a needle at {ratio}");
    let angle = 0.5 * b.atan2(half);
    let side = (angle.cos() * got[splats::ACROSS_X] + angle.sin() * got[splats::ACROSS_Y]).signum();
    let [nx, ny] = [side * angle.cos(), side * angle.sin()];
    let offset = nx * expected[splats::MEAN_X] + ny * expected[splats::MEAN_Y];
    for (column, expected, tolerance) in [
        (splats::ACROSS_X, nx, 1e-4),
        (splats::ACROSS_Y, ny, 1e-4),
        (splats::ACROSS_OFFSET, offset, 1e-2 + 1e-4 * offset.abs()),
        (splats::ALONG, along, 1e-3 * along),
    ] {
        let off = (got[column] - expected).abs();
        assert!(
            off <= tolerance,
            "{name}, column {column}: {} is not {expected}",
            got[column]
        );
    }
}

/// Compares splats and gradients of every backend with the reference's.
fn assert_kernels_agree(name: &str, set: &Set, options: &ProjectOptions, v_splats: &[f64]) {
    let view = view::<f64>(options, set.n_coeffs);
    let mut v_splats = v_splats.to_vec();
    let expected = reference::project(&set.gaussians(), &view);
    for (row, v_row) in expected
        .chunks_exact(N_COLUMNS)
        .zip(v_splats.chunks_exact_mut(N_COLUMNS))
    {
        // Rounding decides whether a colour is clamped here: judged by nobody.
        for channel in splats::RED..=splats::BLUE {
            if row[channel].abs() < 1e-5 {
                v_row[channel] = 0.0;
            }
        }
        // The reference has the whole gradient of the shape in the conic's columns.
        v_row[splats::ACROSS_X..].fill(0.0);
    }
    let expected_gradients = reference::project_vjp(&set.gaussians(), &view, &v_splats);
    for device in devices() {
        let device = device.autodiff();
        let inputs = set.tensors(&device);
        let inputs = Tensors {
            means: inputs.means.require_grad(),
            quats: inputs.quats.require_grad(),
            scales: inputs.scales.require_grad(),
            opacities: inputs.opacities.require_grad(),
            sh_coeffs: inputs.sh_coeffs.require_grad(),
        };
        let out = inputs
            .clone()
            .project(&camera(), options)
            .expect("valid input");
        let got = values(out.clone().inner());
        for column in 0..splats::ACROSS_X {
            let pick = |values: &[f64]| crate::testing::column(values, column, N_COLUMNS);
            assert_agrees(
                &format!("{name}, column {column}"),
                &to_f32(&pick(&to_f64(&got))),
                &pick(&expected),
            );
        }
        for (got, expected) in got
            .chunks_exact(N_COLUMNS)
            .zip(expected.chunks_exact(N_COLUMNS))
        {
            assert_needle(name, &to_f64(got), expected);
        }
        let v_out = tensor(&to_f32(&v_splats), [set.len(), N_COLUMNS], &device);
        let gradients = (out * v_out).sum().backward();
        let e = &expected_gradients;
        for (input, got, expected) in [
            (
                "means",
                inputs.means.grad(&gradients).map(values),
                &e.v_means,
            ),
            (
                "quats",
                inputs.quats.grad(&gradients).map(values),
                &e.v_quats,
            ),
            (
                "scales",
                inputs.scales.grad(&gradients).map(values),
                &e.v_scales,
            ),
            (
                "opacities",
                inputs.opacities.grad(&gradients).map(values),
                &e.v_opacities,
            ),
            (
                "sh_coeffs",
                inputs.sh_coeffs.grad(&gradients).map(values),
                &e.v_sh_coeffs(),
            ),
        ] {
            let got = got.expect("the input was tracked");
            assert_agrees(&format!("{name}, v_{input}"), &got, expected);
        }
    }
}

/// A wrong gradient must not pass for a right one.
#[test]
#[should_panic(expected = "p99")]
fn negative_control() {
    let set = Set::random(20, 400, 4);
    let options = ProjectOptions::default();
    let (view, view_f32) = (view::<f64>(&options, 4), view::<f32>(&options, 4));
    let v_splats = cotangents(20, set.len());
    let expected = reference::project_vjp(&set.gaussians(), &view, &v_splats);
    let narrow = Narrow::new(&set);
    let splats = cpu::project(&narrow.gaussians(), &view_f32);
    let mut wrong = to_f32(&v_splats);
    wrong
        .chunks_exact_mut(N_COLUMNS)
        .for_each(|row| row[splats::CONIC_B] *= 1.01);
    let got = cpu::project_vjp(&narrow.gaussians(), &view_f32, &splats, &wrong, false);
    assert_agrees("v_quats", &got.v_quats, &expected.v_quats);
}

/// The set in single precision.
struct Narrow {
    parts: [Vec<f32>; 5],
    n_coeffs: usize,
}

impl Narrow {
    fn new(set: &Set) -> Self {
        Self {
            parts: set.clone().parts().map(|part| to_f32(part)),
            n_coeffs: set.n_coeffs,
        }
    }

    fn gaussians(&self) -> Gaussians<'_, f32> {
        let [means, quats, scales, opacities, sh_coeffs] = &self.parts;
        Gaussians {
            means,
            quats,
            scales,
            opacities,
            sh_coeffs: ShSlices::joined(sh_coeffs, self.n_coeffs),
        }
    }
}
