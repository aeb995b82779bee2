//! Projection of Gaussians of a few pixels.

use burn::tensor::Tensor;
use dash_kernels::Camera;
use dash_kernels::project::{
    Activation, Gaussians, ProjectOptions, ShSlices, View, project, reference,
};
use dash_kernels::splats::{N_COLUMNS, N_DIFFERENTIABLE};
use rand::Rng;

use super::{
    Bench, Errors, Measurement, Op, Pass, Target, generator, gradient, time, to_f64, uniform,
    values,
};
use crate::Error;
use crate::numbers::standard_normal;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
const FOCAL_PX: f64 = 280.0;
const N_COEFFS: usize = 16;
const SH_DEGREE: usize = 3;
/// Standard deviation of the splats, pixels.
const SIGMA_PX: f32 = 2.0;

/// Gaussians in the memory of the host.
#[derive(Debug, Clone, Default)]
pub(super) struct Cloud {
    pub(super) means: Vec<f32>,
    pub(super) quats: Vec<f32>,
    pub(super) scales: Vec<f32>,
    pub(super) opacities: Vec<f32>,
    pub(super) sh_coeffs: Vec<f32>,
}

/// What a cloud is seen with.
#[derive(Debug, Clone)]
pub(super) struct Sight {
    pub(super) camera: Camera,
    pub(super) options: ProjectOptions,
}

/// The yardsticks' camera.
pub(super) fn sight(activation: Activation) -> Sight {
    Sight {
        camera: Camera::new(
            FOCAL_PX,
            FOCAL_PX,
            WIDTH as f64 / 2.0,
            HEIGHT as f64 / 2.0,
            WIDTH,
            HEIGHT,
        ),
        options: ProjectOptions {
            activation,
            ..ProjectOptions::default()
        },
    }
}

impl Cloud {
    /// Gaussians all over the picture of [`sight`], with scales and opacities as they are.
    pub(super) fn random(n: usize, salt: u64) -> Self {
        let mut rng = generator(salt);
        let mut cloud = Self::default();
        for _ in 0..n {
            let z: f32 = rng.random_range(2.0..6.0);
            let focal = FOCAL_PX as f32;
            for half in [WIDTH as f32 / 2.0, HEIGHT as f32 / 2.0] {
                cloud
                    .means
                    .push(rng.random_range(-1.0..1.0) * z * half / focal);
            }
            cloud.means.push(z);
            let size = SIGMA_PX * z / focal;
            let scales = (0..3).map(|_| size * (0.6 * standard_normal::<f32>(&mut rng)).exp());
            cloud.scales.extend(scales);
            cloud
                .quats
                .extend((0..4).map(|_| standard_normal::<f32>(&mut rng)));
            cloud.opacities.push(rng.random_range(0.05..0.95));
            cloud
                .sh_coeffs
                .extend((0..3).map(|_| 0.8 * standard_normal::<f32>(&mut rng)));
            let rest = (3..3 * N_COEFFS).map(|_| 0.05 * standard_normal::<f32>(&mut rng));
            cloud.sh_coeffs.extend(rest);
        }
        cloud
    }

    pub(super) fn len(&self) -> usize {
        self.opacities.len()
    }

    /// Packed splats `[N, C]` from the f64 reference.
    pub(super) fn expected(&self, sight: &Sight) -> Vec<f64> {
        self.with_f64(|gaussians| reference::project(gaussians, &view(sight)))
    }

    fn with_f64<R>(&self, f: impl FnOnce(&Gaussians<f64>) -> R) -> R {
        let own = [
            &self.means,
            &self.quats,
            &self.scales,
            &self.opacities,
            &self.sh_coeffs,
        ]
        .map(|values| to_f64(values));
        let [means, quats, scales, opacities, sh_coeffs] = &own;
        f(&Gaussians {
            means,
            quats,
            scales,
            opacities,
            sh_coeffs: ShSlices::joined(sh_coeffs, N_COEFFS),
        })
    }

    /// Packed splats `[N, C]` from a device's kernel.
    pub(super) fn projected(&self, target: Target, sight: &Sight) -> Result<Vec<f32>, Error> {
        values(self.on(target, false).project(sight)?)
    }

    fn on(&self, target: Target, differentiable: bool) -> OnDevice {
        let n = self.len();
        let place = |values: &[f32], width: usize| -> Tensor<2> {
            if differentiable {
                target.leaf(values, [n, width])
            } else {
                target.tensor(values, [n, width])
            }
        };
        OnDevice {
            means: place(&self.means, 3),
            quats: place(&self.quats, 4),
            scales: place(&self.scales, 3),
            opacities: place(&self.opacities, 1),
            sh_coeffs: place(&self.sh_coeffs, 3 * N_COEFFS),
        }
    }
}

struct OnDevice {
    means: Tensor<2>,
    quats: Tensor<2>,
    scales: Tensor<2>,
    opacities: Tensor<2>,
    sh_coeffs: Tensor<2>,
}

impl OnDevice {
    fn project(&self, sight: &Sight) -> Result<Tensor<2>, Error> {
        let n = self.means.dims()[0];
        Ok(project(
            self.means.clone(),
            self.quats.clone(),
            self.scales.clone(),
            self.opacities.clone().reshape([n]),
            self.sh_coeffs.clone().reshape([n, N_COEFFS, 3]),
            &sight.camera,
            &sight.options,
        )?)
    }
}

fn view(sight: &Sight) -> View<f64> {
    View::new(&sight.camera, &sight.options, SH_DEGREE)
}

pub(super) fn measure(bench: &mut Bench, target: Target, n: usize) -> Result<(), Error> {
    let sight = sight(Activation::Linear);
    let cloud = Cloud::random(n, 3);
    let got = cloud.projected(target, &sight)?;
    let on_device = cloud.on(target, false);
    let timing = time(Some(target.device), || on_device.project(&sight).map(drop))?;
    bench.add(Measurement {
        error: columns_apart(&got, &cloud.expected(&sight), 0..N_COLUMNS),
        time: Some(timing),
        ..target.measurement(Op::Project, "f32", Pass::Forward, n)
    });

    let mut cotangent = uniform(&mut generator(4), n * N_COLUMNS, -1.0, 1.0);
    // The radii carry no gradient.
    for row in cotangent.chunks_exact_mut(N_COLUMNS) {
        row[N_DIFFERENTIABLE..].fill(0.0);
    }
    let expected = cloud.with_f64(|gaussians| {
        reference::project_vjp(gaussians, &view(&sight), &to_f64(&cotangent))
    });
    let cotangent = target.constant(&cotangent, [n, N_COLUMNS]);
    let leaves = cloud.on(target, true);
    let both = || {
        let splats = leaves.project(&sight)?;
        Ok::<_, Error>((splats * cotangent.clone()).sum().backward())
    };
    let gradients = both()?;
    let mut errors = Errors::default();
    for (leaf, expected) in [
        (&leaves.means, &expected.v_means),
        (&leaves.quats, &expected.v_quats),
        (&leaves.scales, &expected.v_scales),
        (&leaves.opacities, &expected.v_opacities),
        (&leaves.sh_coeffs, &expected.v_sh_coeffs()),
    ] {
        errors.add(&gradient(leaf, &gradients)?, expected);
    }
    let timing = time(Some(target.device), || both().map(drop))?;
    bench.add(Measurement {
        error: errors.stats(),
        time: Some(timing),
        ..target.measurement(Op::Project, "f32", Pass::Gradient, n)
    });
    Ok(())
}

/// Errors of these columns of packed splats, each relative to its own values: pixels, colours and
/// inverse areas are not of one size.
pub(super) fn columns_apart(
    got: &[f32],
    expected: &[f64],
    columns: std::ops::Range<usize>,
) -> super::ErrorStats {
    let mut errors = Errors::default();
    for column in columns {
        let got: Vec<f32> = got
            .iter()
            .skip(column)
            .step_by(N_COLUMNS)
            .copied()
            .collect();
        let expected: Vec<f64> = expected
            .iter()
            .skip(column)
            .step_by(N_COLUMNS)
            .copied()
            .collect();
        errors.add(&got, &expected);
    }
    errors.stats()
}
