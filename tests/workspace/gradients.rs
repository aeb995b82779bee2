//! The gradient of a whole frame against central differences: from the photometric loss through rasterization,
//! projection and the deformation field to every parameter of a scene. Single operations have tests of their own in
//! `dash-kernels`; this test checks how they are composed.
//!
//! The differences are taken in double precision, through a second implementation of the model in this file: the
//! kernels' references, composed by plain loops instead of Burn.

use std::collections::BTreeMap;

use burn::module::{ModuleVisitor, Param};
use burn::tensor::{Device, Gradients, Tensor, TensorData};
use dash_kernels::hash_encode;
use dash_kernels::mlp::{self, MlpLayout};
use dash_kernels::project::{self, Activation, ProjectOptions, ShSlices, View};
use dash_kernels::rasterize::{self, N_CHANNELS};
use dash_kernels::splats::NEAR_PLANE;
use dash_kernels::ssim::{self, ssim};
use dash_kernels::testing::{finite_values, named_devices, to_f64};
use dash_model::parameters::{Path, named_parameters, with_parameters};
use dash_model::{
    Camera, DeformationConfig, DeformationField, DynamicPart, DynamicScene, Gaps, GaussianRows,
    Gaussians, HashEncoderConfig, Heads, OffsetPlacement, Representation, SceneSettings, SpaceBox,
    SpaceTimeEncoder, TrajectoryBasis,
};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// Largest relative error (of the Euclidean norm) of the gradient of a parameter tensor.
const TOLERANCE: f64 = 1e-4;
/// The same between two backends, which share the kernels and differ in their matrix products.
const TOLERANCE_BETWEEN_BACKENDS: f64 = 1e-5;
/// Half the distance of central differences. It is small because a picture jumps where a splat's alpha reaches
/// 1/255.
const STEP: f64 = 1e-6;

const SIZE: [usize; 2] = [26, 19];
const BACKGROUND: [f32; 3] = [0.2, 0.4, 0.1];
const TIME: f32 = 0.37;
const SH_DEGREE: usize = 1;
/// Share of D-SSIM in the loss.
const DSSIM: f32 = 0.2;
const BASIS: TrajectoryBasis = TrajectoryBasis::polyline(2);

/// Where offsets are added and how features are interpolated: ours, and as released.
const FORMS: [(OffsetPlacement, bool); 2] = [
    (OffsetPlacement::BeforeActivation, false),
    (OffsetPlacement::AfterActivation, true),
];

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
        representation: Representation::Hash,
        heads: Heads::default(),
        temporal: None,
        encoder: HashEncoderConfig {
            n_levels: 2,
            n_features_per_level: 2,
            log2_hashmap_size: 5,
            base_resolution: vec![2; 4],
            finest_resolution: vec![5, 5, 5, 4],
            smoothstep,
            reference_sizing: false,
            pruned_levels: Vec::new(),
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
            near_plane: NEAR_PLANE,
            trajectory_basis: BASIS,
            offsets,
            gaps: Gaps::default(),
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

/// All parameters of a scene by name, in double precision.
type Parameters = BTreeMap<String, Vec<f64>>;

/// The same model in double precision: what is learnt comes as `Parameters`, the rest from `scene`.
struct Reference<'a> {
    scene: &'a DynamicScene,
}

impl Reference<'_> {
    /// [`loss`].
    fn loss(&self, parameters: &Parameters) -> f64 {
        let splats = [
            splats(&Set::of("static_set", parameters), Activation::Exp),
            self.dynamic_splats(parameters),
        ]
        .concat();
        let image: Vec<f64> =
            rasterize::reference::rasterize(&splats, SIZE, BACKGROUND.map(f64::from))
                .chunks_exact(N_CHANNELS)
                .flat_map(|pixel| [pixel[0], pixel[1], pixel[2]])
                .collect();
        let target = to_f64(&target());
        let n = target.len() as f64;
        let l1: f64 = image.iter().zip(&target).map(|(a, b)| (a - b).abs()).sum();
        let similarity = ssim::reference::ssim(&image, &target, [SIZE[1], SIZE[0], 3]);
        let dssim = f64::from(DSSIM);
        (1.0 - dssim) * l1 / n + dssim * (1.0 - similarity.iter().sum::<f64>() / n)
    }

    fn dynamic_splats(&self, parameters: &Parameters) -> Vec<f64> {
        let field = &self.scene.dynamic.as_ref().expect("has one").field;
        let mut set = Set::of("dynamic.gaussians", parameters);
        let (space, time) = (field.space(), f64::from(TIME));
        let unit: Vec<f64> = set
            .means
            .chunks_exact(3)
            .flat_map(|mean| {
                let [x, y, z] = std::array::from_fn(|axis| {
                    let (low, high) = (f64::from(space.min[axis]), f64::from(space.max[axis]));
                    (mean[axis] - low) / (high - low)
                });
                [x, y, z, time]
            })
            .collect();
        let table = &parameters["dynamic.field.encoder.table"];
        let SpaceTimeEncoder::Hash(encoder) = field.encoder() else {
            panic!("the field is a hash grid");
        };
        let layout = encoder.layout();
        let features = hash_encode::reference::hash_encode(&unit, table, layout);
        // Heads side by side: positions, rotations, scales.
        let mut widths = vec![layout.n_features()];
        widths.extend([field.config().hidden].repeat(field.config().layers));
        widths.push(3 + 4 + 3);
        let network = MlpLayout::new(&widths).expect("good widths");
        let decoder = &parameters["dynamic.field.decoder.parameters"];
        let decoded = mlp::reference::mlp(&features, decoder, &network);
        let head = |first: usize, width: usize| -> Vec<f64> {
            let rows = decoded.chunks_exact(3 + 4 + 3);
            rows.flat_map(|row| &row[first..first + width])
                .copied()
                .collect()
        };
        let offsets = head(0, 3);
        // The world units of the position head, as in `deformation.rs`.
        let unit = 0.1 * f64::from(space.diagonal());
        let shares = BASIS.at(TIME);
        let trajectories = &parameters["dynamic.gaussians.trajectories"];
        for (row, mean) in set.means.chunks_exact_mut(3).enumerate() {
            for (axis, value) in mean.iter_mut().enumerate() {
                *value += unit * offsets[3 * row + axis];
                for (span, share) in shares.iter().enumerate() {
                    let at = (row * shares.len() + span) * 3 + axis;
                    *value += f64::from(*share) * trajectories[at];
                }
            }
        }
        let activation = match self.scene.settings.offsets {
            OffsetPlacement::BeforeActivation => Activation::Exp,
            OffsetPlacement::AfterActivation => {
                for quat in set.quats.chunks_exact_mut(4) {
                    let norm = (quat.iter().map(|q| q * q).sum::<f64>() + 1e-12).sqrt();
                    quat.iter_mut().for_each(|q| *q /= norm);
                }
                set.scales.iter_mut().for_each(|scale| *scale = scale.exp());
                let sigmoid = |logit: f64| 1.0 / (1.0 + (-logit).exp());
                set.opacities.iter_mut().for_each(|o| *o = sigmoid(*o));
                Activation::Linear
            }
        };
        for (values, offsets) in [(&mut set.quats, head(3, 4)), (&mut set.scales, head(7, 3))] {
            for (value, offset) in values.iter_mut().zip(offsets) {
                *value += offset;
            }
        }
        splats(&set, activation)
    }

    /// Slopes of the loss along every parameter.
    fn slopes(&self, parameters: &Parameters) -> Parameters {
        let mut at = parameters.clone();
        let mut slope = |name: &str, i: usize| {
            let centre = parameters[name][i];
            let [low, high] = [-STEP, STEP].map(|step| {
                at.get_mut(name).expect("listed")[i] = centre + step;
                self.loss(&at)
            });
            at.get_mut(name).expect("listed")[i] = centre;
            (high - low) / (2.0 * STEP)
        };
        parameters
            .iter()
            .map(|(name, values)| {
                let slopes = (0..values.len()).map(|i| slope(name, i)).collect();
                (name.clone(), slopes)
            })
            .collect()
    }
}

/// What is projected.
struct Set {
    means: Vec<f64>,
    quats: Vec<f64>,
    scales: Vec<f64>,
    opacities: Vec<f64>,
    sh_dc: Vec<f64>,
    sh_rest: Vec<f64>,
}

impl Set {
    fn of(name: &str, parameters: &Parameters) -> Self {
        let part = |part: &str| parameters[&format!("{name}.{part}")].clone();
        Self {
            means: part("means"),
            quats: part("quats"),
            scales: part("log_scales"),
            opacities: part("opacity_logits"),
            sh_dc: part("sh_dc"),
            sh_rest: part("sh_rest"),
        }
    }
}

fn splats(set: &Set, activation: Activation) -> Vec<f64> {
    let gaussians = project::Gaussians {
        means: &set.means,
        quats: &set.quats,
        scales: &set.scales,
        opacities: &set.opacities,
        sh_coeffs: ShSlices::apart(&set.sh_dc, &set.sh_rest, (SH_DEGREE + 1).pow(2)),
    };
    let options = ProjectOptions {
        activation,
        ..Default::default()
    };
    let view = View::new(&camera(), &options, SH_DEGREE);
    project::reference::project(&gaussians, &view)
}

/// Gradients of every parameter by autodiff, and the loss.
fn gradients(form: (OffsetPlacement, bool), dssim: f32, device: &Device) -> (Parameters, f64) {
    struct Collector<'a> {
        path: Path,
        gradients: &'a Gradients,
        found: Parameters,
    }
    impl ModuleVisitor for Collector<'_> {
        fn enter_module(&mut self, name: &str, container_type: &str) {
            self.path.enter(name, container_type);
        }
        fn exit_module(&mut self, _name: &str, container_type: &str) {
            self.path.exit(container_type);
        }
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let name = self.path.name();
            let gradient = param.val().grad(self.gradients);
            let gradient = gradient.unwrap_or_else(|| panic!("{name} has no gradient"));
            self.found.insert(name, to_f64(&finite_values(gradient)));
        }
    }
    let device = device.clone().autodiff();
    let scene = scene(form, &device);
    let loss = loss(&scene, dssim, &device);
    let gradients = loss.backward();
    let mut collector = Collector {
        path: Path::default(),
        gradients: &gradients,
        found: Parameters::new(),
    };
    burn::module::Module::visit(&scene, &mut collector);
    (collector.found, f64::from(finite_values(loss)[0]))
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
    let mut worst = 0.0f64;
    for form in FORMS {
        for (backend, device) in named_devices() {
            let scene = scene(form, &device);
            let (got, loss) = gradients(form, DSSIM, &device);
            let parameters: Parameters = named_parameters(&scene)
                .into_iter()
                .map(|(name, tensor)| (name, to_f64(&tensor.values)))
                .collect();
            let reference = Reference { scene: &scene };
            let expected_loss = reference.loss(&parameters);
            assert!(
                (loss - expected_loss).abs() < 1e-6,
                "{backend}, {form:?}: loss {loss}, expected {expected_loss}"
            );
            let expected = reference.slopes(&parameters);
            assert!(
                got.keys().eq(expected.keys()),
                "{backend}: {:?}",
                got.keys()
            );
            for (name, expected) in &expected {
                let error = relative_error(&got[name], expected);
                assert!(
                    error <= TOLERANCE,
                    "{backend}, {form:?}: the gradient of {name} is off by {error:e} of its norm"
                );
                worst = worst.max(error);
            }
        }
    }
    eprintln!("largest relative error: {worst:.1e}");
}

#[test]
#[cfg(all(feature = "ndarray", feature = "flex"))]
fn backends_agree_on_the_gradient() {
    let mut worst = 0.0f64;
    for form in FORMS {
        let all: Vec<_> = named_devices()
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
    for (backend, device) in named_devices() {
        let (right, _) = gradients(FORMS[0], DSSIM, &device);
        let (wrong, _) = gradients(FORMS[0], 0.95 * DSSIM, &device);
        for (name, right) in &right {
            let error = relative_error(&wrong[name], right);
            assert!(error > TOLERANCE, "{backend}: {name} differs by {error:e}");
        }
    }
}
