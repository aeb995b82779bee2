//! Scenes that are hard to render: empty, tiny, huge, all of one kind.

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Gradients, Tensor};
use dash_kernels::project::{self, ProjectOptions, View};
use dash_kernels::rasterize::{N_CHANNELS, reference};
use dash_kernels::splats::NEAR_PLANE;
use dash_model::{
    Camera, DeformationConfig, DeformationField, DynamicPart, DynamicScene, Gaps, GaussianRows,
    Gaussians, HashEncoderConfig, Heads, OffsetPlacement, Representation, SceneSettings, SpaceBox,
    TrajectoryBasis,
};
use rand::Rng;

use super::Case;
use super::inputs::{rng, tensor, to_host, uniform, widen};
use super::measured::{Measured, largest_difference};
use crate::Error;

const FAMILY: &str = "scenes";

/// Difference of a colour or an alpha: projection and blending in single precision, also of a scene
/// whose coordinates are rounded at another size.
const PIXEL: f64 = 1e-4;
/// Pixels nearer to a threshold of drawing than this are not judged (relative distance).
const BAND: f64 = 1e-3;
const SIZE: [usize; 2] = [48, 36];
const BACKGROUND: [f32; 3] = [0.2, 0.4, 0.1];
const BASIS: TrajectoryBasis = TrajectoryBasis::polyline(2);

pub(super) const CASES: &[Case] = &[
    Case {
        family: FAMILY,
        name: "no Gaussians",
        extreme: "neither static nor dynamic ones",
        measure: |device| pictures(&[Make::new(0, None)], device),
    },
    Case {
        family: FAMILY,
        name: "one Gaussian",
        extreme: "a single static, a single dynamic one",
        measure: |device| pictures(&[Make::new(1, None), Make::new(0, Some(1))], device),
    },
    Case {
        family: FAMILY,
        name: "only dynamic Gaussians",
        extreme: "60 dynamic and no static ones",
        measure: |device| pictures(&[Make::new(0, Some(60))], device),
    },
    Case {
        family: FAMILY,
        name: "empty dynamic part",
        extreme: "60 static Gaussians and a field for none",
        measure: empty_dynamic_part,
    },
    Case {
        family: FAMILY,
        name: "huge scene",
        extreme: "extent 1e4",
        measure: |device| pictures(&[Make::new(60, Some(30)).at_scale(1e4)], device),
    },
    Case {
        family: FAMILY,
        name: "minute scene",
        extreme: "extent 1e-4",
        measure: |device| pictures(&[Make::new(60, Some(30)).at_scale(1e-4)], device),
    },
];

/// What a scene is made of.
#[derive(Clone, Copy)]
struct Make {
    n_static: usize,
    n_dynamic: Option<usize>,
    scale: f32,
}

impl Make {
    fn new(n_static: usize, n_dynamic: Option<usize>) -> Self {
        Self {
            n_static,
            n_dynamic,
            scale: 1.0,
        }
    }

    fn at_scale(self, scale: f32) -> Self {
        Self { scale, ..self }
    }

    fn camera(self) -> Camera {
        let [width, height] = SIZE;
        let scale = f64::from(self.scale);
        Camera::new(44.0, 45.0, 24.6, 17.8, width, height).look_at(
            [0.2 * scale, -0.3 * scale, -3.0 * scale],
            [0.0; 3],
            [0.1, -1.0, 0.0],
        )
    }

    fn scene(self, device: &Device) -> Result<DynamicScene, Error> {
        let mut rng = rng(71);
        let mut rows = |n: usize, trajectory_width: usize| {
            let mut triples = |low: f32, high: f32, scale: f32| -> Vec<[f32; 3]> {
                let triple = |_| std::array::from_fn(|_| scale * rng.random_range(low..high));
                (0..n).map(triple).collect()
            };
            let (means, colors) = (triples(-0.9, 0.9, self.scale), triples(0.2, 0.8, 1.0));
            let mut rows = GaussianRows::from_points(&means, &colors, 1, 0.2 * self.scale);
            for (quat, axis) in rows.quats.iter_mut().zip(triples(-1.0, 1.0, 1.0)) {
                *quat = [0.5, axis[0], axis[1], axis[2]];
            }
            rows.log_scales = triples(-2.5, -1.5, 1.0);
            for scale in rows.log_scales.as_flattened_mut() {
                *scale += self.scale.ln();
            }
            rows.opacity_logits.fill(1.0);
            rows.sh_rest = uniform(&mut rng, rows.sh_rest.len(), -0.2, 0.2);
            rows.trajectory_width = trajectory_width;
            let n_values = n * trajectory_width;
            rows.trajectories = uniform(&mut rng, n_values, -0.2 * self.scale, 0.2 * self.scale);
            rows
        };
        let still = rows(self.n_static, 0);
        let moving = self.n_dynamic.map(|n| rows(n, 3 * BASIS.len()));
        let device = device.clone().autodiff();
        let dynamic = match &moving {
            None => None,
            Some(moving) => Some(DynamicPart {
                gaussians: Gaussians::from_rows(moving, &device),
                field: field(self.scale, &device)?,
            }),
        };
        Ok(DynamicScene {
            static_set: Gaussians::from_rows(&still, &device),
            dynamic,
            settings: SceneSettings {
                background: BACKGROUND,
                sh_degree: 1,
                near_plane: NEAR_PLANE * f64::from(self.scale),
                trajectory_basis: BASIS,
                offsets: OffsetPlacement::BeforeActivation,
                gaps: Gaps::default(),
            },
        })
    }
}

fn field(scale: f32, device: &Device) -> Result<DeformationField, Error> {
    let config = DeformationConfig {
        representation: Representation::Hash,
        heads: Heads::default(),
        temporal: None,
        encoder: HashEncoderConfig {
            n_levels: 4,
            n_features_per_level: 2,
            log2_hashmap_size: 8,
            base_resolution: vec![2; 4],
            finest_resolution: vec![2048; 4],
            smoothstep: false,
            reference_sizing: false,
            pruned_levels: Vec::new(),
        },
        hidden: 8,
        layers: 1,
    };
    let corners = [[-scale; 3], [scale; 3]];
    let space = SpaceBox::around(&corners, 0.0, 0.1);
    Ok(DeformationField::new(&config, space, &mut rng(72), device)?)
}

/// Pictures at several times against references of the Gaussians as they are then, and every gradient.
fn pictures(makes: &[Make], device: &Device) -> Result<Measured, Error> {
    let mut measured = Measured::default();
    for make in makes {
        let (scene, camera) = (make.scene(device)?, make.camera());
        let [width, height] = SIZE;
        for time in [0.0, 1.0 / 3.0, 0.5, 1.0] {
            let rendering = scene.render(&camera, time)?.image;
            let image = to_host(rendering.clone().inner());
            measured.saw(&image);
            let splats = reference_splats(&scene.at(time)?, &scene, &camera);
            let expected = reference::rasterize(&splats, SIZE, BACKGROUND.map(f64::from));
            let (mut worst, mut n_judged) = (0.0f64, 0);
            for pixel in 0..width * height {
                if reference::margin(&splats, pixel % width, pixel / width) < BAND {
                    continue;
                }
                n_judged += 1;
                // Depth comes in world units.
                let at = pixel * N_CHANNELS..(pixel + 1) * N_CHANNELS - 1;
                let error = largest_difference(&image[at.clone()], &expected[at]);
                worst = if error > worst || error.is_nan() {
                    error
                } else {
                    worst
                };
            }
            let n = scene.counts();
            measured.judge(format!("{n:?} at {time:.2}: pixels"), worst, PIXEL);
            let few = n_judged < width * height / 2;
            measured.none(
                format!("{n:?} at {time:.2}: mostly at a threshold"),
                usize::from(few),
            );
            let v = uniform(&mut rng(73), image.len(), -1.0, 1.0);
            let v = tensor(&v, [height, width, N_CHANNELS], &device.clone().autodiff());
            see_gradients(&mut measured, &scene, &(rendering * v).sum().backward());
        }
    }
    Ok(measured)
}

fn reference_splats(rows: &GaussianRows, scene: &DynamicScene, camera: &Camera) -> Vec<f64> {
    let n_coeffs = 1 + rows.sh_rest_width / 3;
    let (dc, rest) = (widen(rows.sh_dc.as_flattened()), widen(&rows.sh_rest));
    let options = ProjectOptions {
        near_plane: scene.settings.near_plane,
        ..ProjectOptions::default()
    };
    let view = View::<f64>::new(camera, &options, scene.settings.sh_degree);
    project::reference::project(
        &project::Gaussians {
            means: &widen(rows.means.as_flattened()),
            quats: &widen(rows.quats.as_flattened()),
            scales: &widen(rows.log_scales.as_flattened()),
            opacities: &widen(&rows.opacity_logits),
            sh_coeffs: project::ShSlices::apart(&dc, &rest, n_coeffs),
        },
        &view,
    )
}

/// Looks at the gradient of every parameter.
fn see_gradients<M: Module>(measured: &mut Measured, module: &M, gradients: &Gradients) {
    struct See<'a>(&'a mut Measured, &'a Gradients);
    impl ModuleVisitor for See<'_> {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            if let Some(gradient) = param.val().grad(self.1) {
                self.0.saw(&to_host(gradient));
            }
        }
    }
    module.visit(&mut See(measured, gradients));
}

fn empty_dynamic_part(device: &Device) -> Result<Measured, Error> {
    let make = Make::new(60, Some(0));
    let with_field = make.scene(device)?;
    let mut without = with_field.clone();
    without.dynamic = None;
    let camera = make.camera();
    let mut measured = pictures(&[make], device)?;
    for time in [0.0, 0.7] {
        let [a, b] = [&with_field, &without].map(|scene| scene.render(&camera, time));
        let (a, b) = (to_host(a?.image.inner()), to_host(b?.image.inner()));
        let other = a
            .iter()
            .zip(&b)
            .filter(|(a, b)| a.to_bits() != b.to_bits())
            .count();
        measured.none(format!("other bits than without, at {time}"), other);
    }
    Ok(measured)
}
