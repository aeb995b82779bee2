//! Scenes for the tests, and what they compare.

use burn::tensor::{Device, Tensor};
pub use dash_kernels::testing::devices;
use dash_model::parameters::{named_parameters, with_parameters};
use dash_model::{
    Camera, DeformationConfig, DeformationField, DynamicPart, DynamicScene, GaussianRows,
    Gaussians, HashEncoderConfig, Layer, OffsetPlacement, SceneSettings, SpaceBox, TrajectoryBasis,
};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

const SIZE: usize = 40;
const BASIS: TrajectoryBasis = TrajectoryBasis::polyline(4);
pub const BACKGROUND: [f32; 3] = [0.1, 0.2, 0.3];

pub fn camera() -> Camera {
    Camera::new(45.0, 45.0, 20.0, 20.0, SIZE, SIZE).look_at(
        [0.0, 0.0, -4.0],
        [0.0; 3],
        [0.0, 1.0, 0.0],
    )
}

pub fn rows(n: usize, seed: u64, sh_degree: usize) -> GaussianRows {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut triple = |low: f32, high: f32| -> Vec<[f32; 3]> {
        (0..n)
            .map(|_| std::array::from_fn(|_| rng.random_range(low..high)))
            .collect()
    };
    let mut rows = GaussianRows::from_points(&triple(-1.0, 1.0), &triple(0.0, 1.0), sh_degree, 0.1);
    rows.opacity_logits.fill(2.0);
    rows
}

/// Three levels in space and time.
pub fn field_config() -> DeformationConfig {
    let grid = HashEncoderConfig::new(3, 8, [4; 4], [16, 16, 16, 8]);
    DeformationConfig::new(grid, 8)
}

/// A scene of so many static and dynamic Gaussians; `None` for no dynamic part.
pub fn scene(
    n_static: usize,
    n_dynamic: Option<usize>,
    offsets: OffsetPlacement,
    device: &Device,
) -> DynamicScene {
    let dynamic = n_dynamic.map(|n| {
        let mut canonical = rows(n, 2, 1);
        canonical.trajectory_width = 3 * BASIS.len();
        canonical.trajectories = (0..n * canonical.trajectory_width)
            .map(|i| 0.1 * (i as f32).sin())
            .collect();
        let space = SpaceBox::around(&canonical.means, 0.0, 0.1);
        let mut rng = Pcg64::seed_from_u64(3);
        DynamicPart {
            gaussians: Gaussians::from_rows(&canonical, device),
            field: DeformationField::new(&field_config(), space, &mut rng, device).expect("valid"),
        }
    });
    DynamicScene {
        static_set: Gaussians::from_rows(&rows(n_static, 1, 1), device),
        dynamic,
        settings: SceneSettings {
            background: BACKGROUND,
            sh_degree: 1,
            trajectory_basis: BASIS,
            offsets,
            ..SceneSettings::default()
        },
    }
}

pub fn pixels(scene: &DynamicScene, time: f32, layer: Layer) -> Vec<f32> {
    let image = scene
        .render_layer(&camera(), time, layer)
        .expect("renders")
        .image;
    assert_eq!(image.dims(), [SIZE, SIZE, 5]);
    let values = image.into_data().try_into_vec::<f32>().expect("f32");
    assert!(values.iter().all(|v| v.is_finite()));
    values
}

pub fn largest_difference(one: &[f32], other: &[f32]) -> f32 {
    assert_eq!(one.len(), other.len());
    let differences = one.iter().zip(other).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f32::max)
}

/// Means, quaternions, scales, opacities and colours of the dynamic Gaussians at a time.
pub fn deformed(scene: &DynamicScene, time: f32) -> [Vec<f32>; 5] {
    let part = scene.dynamic.as_ref().expect("a dynamic part");
    let deformed = part.deform(&scene.settings, time).expect("fits");
    let flat = |tensor: Tensor<1>| tensor.into_data().try_into_vec().expect("f32");
    [
        flat(deformed.means.reshape([-1])),
        flat(deformed.quats.reshape([-1])),
        flat(deformed.scales.reshape([-1])),
        flat(deformed.opacities),
        flat(deformed.sh_coeffs.joined().reshape([-1])),
    ]
}

/// A scene whose field has a head for opacities and colours, too.
pub fn with_appearance(mut scene: DynamicScene, device: &Device) -> DynamicScene {
    let mut config = field_config();
    config.heads.appearance = true;
    let dynamic = scene.dynamic.as_mut().expect("a dynamic part");
    let space = *dynamic.field.space();
    let mut rng = Pcg64::seed_from_u64(4);
    dynamic.field = DeformationField::new(&config, space, &mut rng, device).expect("valid");
    scene
}

/// The scene with larger offsets of its field, so that they differ by far more than rounding.
pub fn with_large_offsets(scene: DynamicScene) -> DynamicScene {
    let mut parameters = named_parameters(&scene);
    let field = &scene.dynamic.as_ref().expect("a dynamic part").field;
    // Positions, rotations and scales, and opacities with colours, the last of the decoder's layers.
    let of_appearance = if field.config().heads.appearance {
        4
    } else {
        0
    };
    let heads = (field.config().hidden + 1) * (3 + 4 + 3 + of_appearance);
    for (name, n, factor) in [
        ("dynamic.field.encoder.table", usize::MAX, 1e4),
        ("dynamic.field.decoder.parameters", heads, 1e2),
    ] {
        let values = &mut parameters.get_mut(name).expect("the field's").values;
        let first = values.len().saturating_sub(n);
        for value in &mut values[first..] {
            *value *= factor;
        }
    }
    with_parameters(scene, parameters).expect("the same parameters")
}
