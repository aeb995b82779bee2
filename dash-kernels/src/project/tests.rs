use burn::tensor::{Device, Tensor};
use rand::Rng;

use super::{
    Activation, GaussianGradients, Gaussians, ProjectOptions, View, cpu, project, reference,
};
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
            sh_coeffs: &self.sh_coeffs,
            n_coeffs: self.n_coeffs,
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
    let degree = super::check_degree(n_coeffs, options.sh_degree).expect("the tests' are valid");
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
        let GaussianGradients {
            v_means,
            v_quats,
            v_scales,
            v_opacities,
            v_sh_coeffs,
        } = reference::project_vjp(&set.gaussians(), &view, &v_splats);
        let gradients = [v_means, v_quats, v_scales, v_opacities, v_sh_coeffs];
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
        let view = view::<f64>(&options, n_coeffs);
        let mut v_splats = cotangents(seed, n);
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
                .project(&camera(), &options)
                .expect("valid input");
            let got = values(out.clone().inner());
            for column in 0..N_COLUMNS {
                let pick = |values: &[f64]| -> Vec<f64> {
                    values
                        .iter()
                        .skip(column)
                        .step_by(N_COLUMNS)
                        .copied()
                        .collect()
                };
                let name = format!("seed {seed}, column {column}");
                assert_agrees(&name, &to_f32(&pick(&to_f64(&got))), &pick(&expected));
            }
            let v_out = tensor(&to_f32(&v_splats), [n, N_COLUMNS], &device);
            let gradients = (out * v_out).sum().backward();
            let e = &expected_gradients;
            let check = |name: &str, got: Vec<f32>, expected: &[f64]| {
                assert_agrees(&format!("seed {seed}, {name}"), &got, expected);
            };
            let missing = "the input was tracked";
            check(
                "v_means",
                values(inputs.means.grad(&gradients).expect(missing)),
                &e.v_means,
            );
            check(
                "v_quats",
                values(inputs.quats.grad(&gradients).expect(missing)),
                &e.v_quats,
            );
            check(
                "v_scales",
                values(inputs.scales.grad(&gradients).expect(missing)),
                &e.v_scales,
            );
            check(
                "v_opacities",
                values(inputs.opacities.grad(&gradients).expect(missing)),
                &e.v_opacities,
            );
            check(
                "v_sh_coeffs",
                values(inputs.sh_coeffs.grad(&gradients).expect(missing)),
                &e.v_sh_coeffs,
            );
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
            sh_coeffs,
            n_coeffs: self.n_coeffs,
        }
    }
}

#[test]
fn edges_of_size_and_layout() {
    let options = ProjectOptions::default();
    for device in devices() {
        for n in [0, 1] {
            let set = Set::random(30, n, 4);
            let out = set
                .tensors(&device)
                .project(&camera(), &options)
                .expect("valid");
            assert_eq!(out.dims(), [n, N_COLUMNS]);
        }
        let empty = Set::random(30, 0, 4).tensors(&device.clone().autodiff());
        let means = empty.means.clone().require_grad();
        let empty = Tensors {
            means: means.clone(),
            ..empty
        };
        let out = empty.project(&camera(), &options).expect("valid");
        let gradient = means.grad(&out.sum().backward()).expect("tracked");
        assert_eq!(gradient.dims(), [0, 3]);

        let set = Set::random(31, 40, 4);
        let expected = values(
            set.tensors(&device)
                .project(&camera(), &options)
                .expect("valid"),
        );
        let mut strided = set.tensors(&device);
        let by_axis: Vec<f64> = (0..3)
            .flat_map(|axis| set.means.iter().skip(axis).step_by(3).copied())
            .collect();
        strided.means = tensor(&to_f32(&by_axis), [3, 40], &device).transpose();
        let got = values(strided.project(&camera(), &options).expect("valid"));
        assert_eq!(got, expected, "a transposed tensor gives the same splats");
    }
}

#[test]
fn refuses_what_does_not_fit() {
    let device = devices().remove(0);
    let camera = camera();
    let options = ProjectOptions::default();
    let good = Set::random(32, 5, 4).tensors(&device);
    let mut bad = good.clone();
    bad.quats = tensor(&[0.0; 12], [4, 3], &device);
    let error = bad
        .project(&camera, &options)
        .expect_err("quats are [4, 3]");
    assert!(
        error
            .to_string()
            .contains("`quats` has shape [4, 3], expected [5, 4]"),
        "{error}"
    );
    let mut bad = good.clone();
    bad.sh_coeffs = tensor(&[0.0; 75], [5, 5, 3], &device);
    let error = bad.project(&camera, &options).expect_err("5 coefficients");
    assert!(
        error.to_string().contains("5 coefficients per channel"),
        "{error}"
    );
    let too_high = ProjectOptions {
        sh_degree: Some(2),
        ..options.clone()
    };
    let error = good
        .clone()
        .project(&camera, &too_high)
        .expect_err("degree 2 of 4");
    assert!(error.to_string().contains("at most 1"), "{error}");
    let broken = Camera {
        fx: f64::NAN,
        ..camera.clone()
    };
    let error = good
        .project(&broken, &options)
        .expect_err("NaN focal length");
    assert!(error.to_string().contains("not finite"), "{error}");
}

#[test]
fn culls_what_is_not_drawn() {
    let set = Set::random(33, 1, 1);
    let mut centred = set.clone();
    centred.means = vec![0.1, 0.1, 3.0];
    centred.opacities = vec![0.0];
    let options = ProjectOptions::default();
    let view = view::<f32>(&options, 1);
    let project = |set: &Set| cpu::project(&Narrow::new(set).gaussians(), &view);
    assert!(
        project(&centred)[splats::RADIUS_X] > 0.0,
        "the case itself is drawn"
    );
    let changes: [(&str, fn(&mut Set)); 5] = [
        ("zero quaternion", |set| set.quats = vec![0.0; 4]),
        ("behind the camera", |set| set.means[2] = -4.0),
        ("nearer than the near plane", |set| {
            set.means = vec![0.2, -0.1, -0.15]
        }),
        ("transparent", |set| set.opacities = vec![-6.0]),
        ("beside the image", |set| set.means[0] = 30.0),
    ];
    for (name, change) in changes {
        let mut set = centred.clone();
        change(&mut set);
        assert_eq!(project(&set), [0.0; N_COLUMNS], "{name}");
        let narrow = Narrow::new(&set);
        let splats = cpu::project(&narrow.gaussians(), &view);
        let v = cpu::project_vjp(&narrow.gaussians(), &view, &splats, &[1.0; N_COLUMNS], true);
        let all = [
            v.v_means,
            v.v_quats,
            v.v_scales,
            v.v_opacities,
            v.v_sh_coeffs,
        ]
        .concat();
        assert!(all.iter().all(|&value| value == 0.0), "{name}: {all:?}");
    }
}

#[test]
fn poison_gives_finite_splats_and_gradients() {
    let poison = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        f32::MIN,
        f32::MIN_POSITIVE,
        1e-40,
        -1e-40,
        0.0,
        -0.0,
        1e-20,
        1e10,
        -1e10,
        1e20,
        -1e20,
        88.0,
        -88.0,
        40.0,
        -40.0,
        20.0,
    ];
    for activation in [Activation::Exp, Activation::Linear] {
        let options = ProjectOptions {
            activation,
            ..ProjectOptions::default()
        };
        let view = view::<f32>(&options, 4);
        let set = Narrow::new(&Set::random(34, 1, 4));
        for part in 0..5 {
            for slot in 0..set.parts[part].len() {
                for value in poison {
                    let mut parts = set.parts.clone();
                    parts[part][slot] = value;
                    let bad = Narrow { parts, n_coeffs: 4 };
                    let splats = cpu::project(&bad.gaussians(), &view);
                    let name = format!("{activation:?}, input {part}, slot {slot}, {value}");
                    assert_finite(&name, &splats);
                    let v_splats = [1.0; N_COLUMNS];
                    let v = cpu::project_vjp(&bad.gaussians(), &view, &splats, &v_splats, true);
                    let all = [
                        v.v_means,
                        v.v_quats,
                        v.v_scales,
                        v.v_opacities,
                        v.v_sh_coeffs,
                    ];
                    assert_finite(&name, &all.concat());
                }
            }
        }
    }
}

/// `a c - b^2` of the covariance loses 15 % here; the sum does not.
#[test]
fn needles_keep_their_determinant() {
    /// What the sum holds up to a ratio of 1e8, as measured for the project.
    const RELATIVE: f64 = 5e-5;
    let mut rng = rng(35);
    let n = 500;
    let mut set = Set::random(35, n, 1);
    for (scale, opacity) in set.scales.chunks_exact_mut(3).zip(&mut set.opacities) {
        let length: f64 = rng.random_range(1.0..30.0);
        let ratio = 10f64.powf(rng.random_range(2.0..8.0));
        scale.copy_from_slice(&to_f64(&to_f32(&[
            length.ln(),
            (length / ratio).ln(),
            (length / ratio).ln(),
        ])));
        *opacity = 2.0;
    }
    let options = ProjectOptions::default();
    let expected = reference::project(&set.gaussians(), &view(&options, 1));
    let got = cpu::project(&Narrow::new(&set).gaussians(), &view(&options, 1));
    let mut n_drawn = 0;
    for (i, (got, expected)) in got
        .chunks_exact(N_COLUMNS)
        .zip(expected.chunks_exact(N_COLUMNS))
        .enumerate()
    {
        let drawn = [f64::from(got[splats::RADIUS_X]), expected[splats::RADIUS_X]].map(|r| r > 0.0);
        assert_eq!(drawn[0], drawn[1], "needle {i}: drawn by one of them");
        if !drawn[0] {
            continue;
        }
        n_drawn += 1;
        // Radius^2 is proportional to the covariance's diagonal, and conic a = yy / det.
        let det = |radius_y: f64, a: f64| radius_y * radius_y / a;
        let got = det(
            f64::from(got[splats::RADIUS_Y]),
            f64::from(got[splats::CONIC_A]),
        );
        let expected = det(expected[splats::RADIUS_Y], expected[splats::CONIC_A]);
        let error = (got / expected - 1.0).abs();
        assert!(
            error <= RELATIVE,
            "needle {i}: relative error {error:e} of the determinant"
        );
    }
    assert!(n_drawn > n / 2, "the case is too poor: {n_drawn} drawn");
}

#[test]
fn jacobian_stops_at_the_border() {
    let camera = Camera::new(100.0, 100.0, 20.0, 50.0, 100, 100);
    let view = View::<f64>::new(&camera, &ProjectOptions::default(), 0);
    // 0.3 of half the field of view beyond each side, which is 0.2 and 0.8 from the axis.
    assert_close("lowest", &view.lowest, &[-0.35, -0.65], 1e-12, 0.0);
    assert_close("highest", &view.highest, &[0.95, 0.65], 1e-12, 0.0);
    let conic = |x: f64| {
        let set = Set {
            means: vec![x, 0.0, 1.0],
            quats: vec![1.0, 0.2, 0.3, 0.4],
            scales: vec![-0.5, -1.0, -0.2],
            opacities: vec![2.0],
            sh_coeffs: vec![0.0; 3],
            n_coeffs: 1,
        };
        let row = reference::project(&set.gaussians(), &view);
        assert!(row[splats::RADIUS_X] > 0.0, "drawn");
        let v_row: Vec<f64> = (0..N_COLUMNS)
            .map(|k| f64::from(u8::from(k == splats::CONIC_A)))
            .collect();
        (
            row[splats::CONIC_A],
            reference::project_vjp(&set.gaussians(), &view, &v_row).v_means[0],
        )
    };
    let (inside, slope_inside) = conic(0.9499);
    let (outside, slope_outside) = conic(0.9501);
    let (far, _) = conic(1.2);
    assert!(slope_inside.abs() > 1e-6, "{slope_inside}");
    assert_eq!(slope_outside, 0.0);
    assert!((inside - outside).abs() < 1e-3 * inside && outside == far);
}

#[test]
fn same_bits_for_any_thread_count() {
    let narrow = Narrow::new(&Set::random(36, 5000, 9));
    let view = view::<f32>(&ProjectOptions::default(), 9);
    let v_splats = to_f32(&cotangents(36, 5000));
    assert_same_for_any_thread_count("project", || {
        let mut all = cpu::project(&narrow.gaussians(), &view);
        let v = cpu::project_vjp(&narrow.gaussians(), &view, &all, &v_splats, true);
        for part in [
            v.v_means,
            v.v_quats,
            v.v_scales,
            v.v_opacities,
            v.v_sh_coeffs,
        ] {
            all.extend(part);
        }
        all
    });
}

/// Only the SH coefficients may be left out: they are what costs.
#[test]
fn untracked_inputs_get_no_gradient() {
    for device in devices() {
        let device = device.autodiff();
        let set = Set::random(37, 50, 16).tensors(&device);
        let opacities = set.opacities.clone().require_grad();
        let inputs = Tensors {
            opacities: opacities.clone(),
            ..set.clone()
        };
        let out = inputs
            .project(&camera(), &ProjectOptions::default())
            .expect("valid");
        let gradients = out.sum().backward();
        assert!(opacities.grad(&gradients).is_some());
        assert!(set.sh_coeffs.grad(&gradients).is_none());
    }
}
