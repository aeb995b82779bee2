//! The gradient of a whole frame, from the photometric loss through rasterization, projection and
//! the deformation field to every parameter of a scene, against central differences. Single
//! operations have tests of their own in `dash-kernels`; this one shows that they are joined rightly.
//!
//! The differences are taken in two steps: of the loss by what is projected, in double precision by
//! the references, and of what is projected by the parameters. A picture jumps where a splat reaches
//! 1/255, so that only the smallest steps show its slope; the field, in single precision, needs large
//! ones.

mod common;

use std::collections::BTreeMap;

use burn::module::{ModuleVisitor, Param};
use burn::tensor::{Device, Gradients, Tensor, TensorData};
use common::{devices, host, widen};
use dash_kernels::project::{self, Activation, ProjectOptions, View};
use dash_kernels::rasterize::{self, N_CHANNELS};
use dash_kernels::ssim::{self, ssim};
use dash_model::parameters::{Path, named_parameters, with_parameters};
use dash_model::{
    Camera, DeformationConfig, DeformationField, DynamicPart, DynamicScene, GaussianRows,
    Gaussians, HashEncoderConfig, OffsetPlacement, SceneSettings, SpaceBox, TrajectoryBasis,
};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// Largest relative error (of the Euclidean norm) of the gradient of a parameter tensor of the
/// Gaussians, and of one of the field. Found are 9e-5 and 6e-4, nearly all of it rounding of the
/// differences: what does not pass through the field is right to 1e-6.
const TOLERANCES: [f64; 2] = [3e-4, 2e-3];
/// The same between two backends, which share the kernels and differ in how they multiply matrices.
const TOLERANCE_BETWEEN_BACKENDS: f64 = 1e-5;
/// Half the distance of differences of the loss, in double precision.
const LOSS_STEP: f64 = 1e-6;
/// Half the distance of differences of what is projected, in single precision, by a parameter of the
/// Gaussians and by one of the field.
const STEPS: [f32; 2] = [5e-4, 3e-3];

const SIZE: [usize; 2] = [26, 19];
const BACKGROUND: [f32; 3] = [0.2, 0.4, 0.1];
const TIME: f32 = 0.37;
const SH_DEGREE: usize = 1;
/// Share of D-SSIM in the loss.
const DSSIM: f32 = 0.2;
const BASIS: TrajectoryBasis = TrajectoryBasis::Polyline { spans: 2 };

type Slopes = BTreeMap<String, Vec<f64>>;

/// Where offsets are added and how features are interpolated: ours, and as released.
const FORMS: [(OffsetPlacement, bool); 2] = [
    (OffsetPlacement::BeforeActivation, false),
    (OffsetPlacement::AfterActivation, true),
];

/// 0 for a parameter of the Gaussians, 1 for one of the field.
fn kind(name: &str) -> usize {
    usize::from(name.starts_with("dynamic.field."))
}

fn camera() -> Camera {
    let [width, height] = SIZE;
    Camera::new(24.0, 25.0, 12.6, 9.8, width, height).look_at(
        [0.2, -0.3, -3.0],
        [0.0; 3],
        [0.1, -1.0, 0.0],
    )
}

fn target() -> Vec<f32> {
    let mut rng = Pcg64::seed_from_u64(9);
    (0..SIZE[0] * SIZE[1] * 3).map(|_| rng.random()).collect()
}

/// Ten static and eight dynamic Gaussians, all parameters of a size that matters.
fn scene((offsets, smoothstep): (OffsetPlacement, bool), device: &Device) -> DynamicScene {
    let mut rng = Pcg64::seed_from_u64(4);
    let mut rows = |n: usize, trajectory_width: usize| {
        let mut triples = |low: f32, high: f32| -> Vec<[f32; 3]> {
            (0..n)
                .map(|_| std::array::from_fn(|_| rng.random_range(low..high)))
                .collect()
        };
        let (means, colors) = (triples(-0.9, 0.9), triples(0.2, 0.8));
        GaussianRows {
            trajectory_width,
            trajectories: vec![0.0; n * trajectory_width],
            ..GaussianRows::from_points(&means, &colors, SH_DEGREE, 0.2)
        }
    };
    let (still, moving) = (rows(10, 0), rows(8, 3 * BASIS.len()));
    let config = DeformationConfig {
        encoder: HashEncoderConfig {
            n_levels: 2,
            n_features_per_level: 2,
            log2_hashmap_size: 5,
            base_resolution: vec![2; 4],
            finest_resolution: vec![5, 5, 5, 4],
            smoothstep,
            reference_sizing: false,
        },
        hidden: 8,
        layers: 1,
    };
    let space = SpaceBox::around(&moving.means, 0.0, 0.1);
    let field = DeformationField::new(&config, space, &mut rng, device).expect("valid");
    let scene = DynamicScene {
        static_set: Gaussians::from_rows(&still, device),
        dynamic: Some(DynamicPart {
            gaussians: Gaussians::from_rows(&moving, device),
            field,
        }),
        settings: SceneSettings {
            background: BACKGROUND,
            sh_degree: SH_DEGREE,
            trajectory_basis: BASIS,
            offsets,
        },
    };
    let mut parameters = named_parameters(&scene);
    for (name, tensor) in &mut parameters {
        let (centre, width) = match name.rsplit('.').next() {
            Some("means" | "sh_dc") => continue,
            Some("log_scales") => (-1.6, 0.4),
            Some("opacity_logits") => (0.5, 1.5),
            Some("quats") => (0.0, 1.0),
            Some("sh_rest" | "trajectories") => (0.0, 0.2),
            Some("table") => (0.0, 1.0),
            _ => (0.0, 0.3),
        };
        for value in &mut tensor.values {
            *value = centre + width * rng.random_range(-1.0..1.0);
        }
    }
    with_parameters(scene, parameters).expect("its own parameters")
}

/// `(1 - DSSIM) L1 + DSSIM (1 - SSIM)` of the frame as the trainer takes it.
fn loss(scene: &DynamicScene, dssim: f32, device: &Device) -> Tensor<1> {
    let shape = [SIZE[1], SIZE[0], 3];
    let image = scene.render(&camera(), TIME).expect("renders").rgb();
    let target = Tensor::<3>::from_data(TensorData::new(target(), shape), device);
    let l1 = (image.clone() - target.clone()).abs().mean();
    let similarity = ssim(image, target).expect("one shape").mean();
    l1 * (1.0 - dssim) + (-similarity + 1.0) * dssim
}

/// Means, quaternions, scales, opacities and colours as they are projected: those of the static
/// Gaussians, then those of the dynamic ones.
type Projected<T> = [Vec<T>; 10];

fn projected(scene: &DynamicScene) -> Projected<f32> {
    let set = &scene.static_set;
    let dynamic = scene.dynamic.as_ref().expect("has one");
    let deformed = dynamic.deform(&scene.settings, TIME).expect("deforms");
    [
        host(set.means.val()),
        host(set.quats.val()),
        host(set.log_scales.val()),
        host(set.opacity_logits.val()),
        host(set.sh_coeffs()),
        host(deformed.means),
        host(deformed.quats),
        host(deformed.scales),
        host(deformed.opacities),
        host(dynamic.gaussians.sh_coeffs()),
    ]
}

/// [`loss`] by the references.
fn reference_loss(projected: &Projected<f64>, offsets: OffsetPlacement) -> f64 {
    let moving = match offsets {
        OffsetPlacement::BeforeActivation => Activation::Exp,
        OffsetPlacement::AfterActivation => Activation::Linear,
    };
    let splats = |parts: &[Vec<f64>], activation: Activation| {
        let gaussians = project::Gaussians {
            means: &parts[0],
            quats: &parts[1],
            scales: &parts[2],
            opacities: &parts[3],
            sh_coeffs: &parts[4],
            n_coeffs: (SH_DEGREE + 1).pow(2),
        };
        let options = ProjectOptions {
            activation,
            ..Default::default()
        };
        let view = View::new(&camera(), &options, SH_DEGREE);
        project::reference::project(&gaussians, &view)
    };
    let (still_parts, moving_parts) = projected.split_at(5);
    let rows = [
        splats(still_parts, Activation::Exp),
        splats(moving_parts, moving),
    ]
    .concat();
    let image: Vec<f64> = rasterize::reference::rasterize(&rows, SIZE, BACKGROUND.map(f64::from))
        .chunks_exact(N_CHANNELS)
        .flat_map(|pixel| [pixel[0], pixel[1], pixel[2]])
        .collect();
    let target = widen(&target());
    let n = target.len() as f64;
    let l1: f64 = image.iter().zip(&target).map(|(a, b)| (a - b).abs()).sum();
    let similarity = ssim::reference::ssim(&image, &target, [SIZE[1], SIZE[0], 3]);
    let dssim = f64::from(DSSIM);
    (1.0 - dssim) * l1 / n + dssim * (1.0 - similarity.iter().sum::<f64>() / n)
}

/// Slopes of [`reference_loss`] along every parameter.
fn differences(scene: &DynamicScene) -> Slopes {
    let mut at = projected(scene).map(|part| widen(&part));
    let offsets = scene.settings.offsets;
    let mut slopes = at.clone();
    for (part, slopes) in slopes.iter_mut().enumerate() {
        for (i, slope) in slopes.iter_mut().enumerate() {
            let centre = at[part][i];
            let [low, high] = [-LOSS_STEP, LOSS_STEP].map(|step| {
                at[part][i] = centre + step;
                reference_loss(&at, offsets)
            });
            at[part][i] = centre;
            *slope = (high - low) / (2.0 * LOSS_STEP);
        }
    }
    let slopes = slopes.concat();
    let parameters = named_parameters(scene);
    let along = |name: &str, i: usize, value: f32| {
        let [low, high] = [-1.0, 1.0].map(|side| {
            let mut moved = parameters.clone();
            let at = value + side * STEPS[kind(name)];
            moved.get_mut(name).expect("listed").values[i] = at;
            let scene = with_parameters(scene.clone(), moved).expect("its own parameters");
            (
                f64::from(at),
                projected(&scene).map(|part| widen(&part)).concat(),
            )
        });
        let change = high.1.iter().zip(&low.1).map(|(high, low)| high - low);
        let change: f64 = change.zip(&slopes).map(|(c, s)| c * s).sum();
        change / (high.0 - low.0)
    };
    parameters
        .iter()
        .map(|(name, tensor)| {
            let values = tensor.values.iter().enumerate();
            (
                name.clone(),
                values.map(|(i, &value)| along(name, i, value)).collect(),
            )
        })
        .collect()
}

/// Gradients of every parameter by autodiff, and the loss.
fn gradients(form: (OffsetPlacement, bool), dssim: f32, device: &Device) -> (Slopes, f64) {
    struct Collector<'a> {
        path: Path,
        gradients: &'a Gradients,
        found: Slopes,
    }
    impl ModuleVisitor for Collector<'_> {
        fn enter_module(&mut self, name: &str, _container_type: &str) {
            self.path.push(name);
        }
        fn exit_module(&mut self, _name: &str, _container_type: &str) {
            self.path.pop();
        }
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let name = self.path.name();
            let gradient = param.val().grad(self.gradients);
            let gradient = gradient.unwrap_or_else(|| panic!("{name} has no gradient"));
            self.found.insert(name, widen(&host(gradient)));
        }
    }
    let device = device.clone().autodiff();
    let scene = scene(form, &device);
    let loss = loss(&scene, dssim, &device);
    let gradients = loss.backward();
    let mut collector = Collector {
        path: Path::default(),
        gradients: &gradients,
        found: Slopes::new(),
    };
    burn::module::Module::visit(&scene, &mut collector);
    (collector.found, f64::from(host(loss)[0]))
}

fn relative_error(got: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(got.len(), expected.len(), "sizes");
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
    let error = norm(
        &mut got
            .iter()
            .zip(expected)
            .map(|(got, expected)| got - expected),
    );
    error / norm(&mut expected.iter().copied())
}

#[test]
fn a_frames_gradient_by_every_parameter_against_central_differences() {
    let mut worst = [0.0f64; 2];
    for form in FORMS {
        for (backend, device) in devices() {
            let scene = scene(form, &device);
            let (got, loss) = gradients(form, DSSIM, &device);
            let inputs = projected(&scene).map(|part| widen(&part));
            let expected_loss = reference_loss(&inputs, form.0);
            assert!(
                (loss - expected_loss).abs() < 1e-6,
                "{backend}, {form:?}: loss {loss}, expected {expected_loss}"
            );
            let expected = differences(&scene);
            assert!(
                got.keys().eq(expected.keys()),
                "{backend}: {:?}",
                got.keys()
            );
            for (name, expected) in &expected {
                let error = relative_error(&got[name], expected);
                assert!(
                    error <= TOLERANCES[kind(name)],
                    "{backend}, {form:?}: the gradient of {name} is off by {error:e} of its norm"
                );
                worst[kind(name)] = worst[kind(name)].max(error);
            }
        }
    }
    let [gaussians, field] = worst;
    eprintln!("largest relative error: Gaussians {gaussians:.1e}, field {field:.1e}");
}

#[test]
#[cfg(all(feature = "ndarray", feature = "flex"))]
fn backends_agree_on_the_gradient() {
    let mut worst = 0.0f64;
    for form in FORMS {
        let all: Vec<_> = devices()
            .into_iter()
            .map(|(name, device)| (name, gradients(form, DSSIM, &device).0))
            .collect();
        for pair in all.windows(2) {
            let [(first, expected), (second, got)] = pair else {
                unreachable!("windows of two");
            };
            for (name, expected) in expected {
                let error = relative_error(&got[name], expected);
                assert!(
                    error <= TOLERANCE_BETWEEN_BACKENDS,
                    "{form:?}: {first} and {second} differ in {name} by {error:e} of its norm"
                );
                worst = worst.max(error);
            }
        }
    }
    eprintln!("largest relative difference between backends: {worst:.1e}");
}

/// Gradients of a loss with a twentieth less SSIM in it must not pass.
#[test]
fn the_gradient_of_another_loss_is_told_apart() {
    for (backend, device) in devices() {
        let (right, _) = gradients(FORMS[0], DSSIM, &device);
        let (wrong, _) = gradients(FORMS[0], 0.95 * DSSIM, &device);
        for (name, right) in &right {
            let error = relative_error(&wrong[name], right);
            assert!(
                error > TOLERANCES[kind(name)],
                "{backend}: {name} differs by {error:e}"
            );
        }
    }
}
