//! A deformation field on Gaussians of your own: a ring of them ripples, the field learns the motion
//! from their places at eleven instants, and is asked for times in between.
//!
//! `cargo run --release --example deform_gaussians`

use std::f32::consts::{PI, TAU};

use burn::optim::{AdamConfig, GradientsParams};
use burn::tensor::{Device, Tensor};
use dash_model::{
    DeformationConfig, DeformationField, GaussianRows, Gaussians, HashEncoderConfig, Heads,
    ModelError, SpaceBox,
};
use rand::SeedableRng;
use rand_pcg::Pcg64;

const COUNT: usize = 48;

/// Places on the ring at `time`; a circle in the middle of the clip.
fn ring(time: f32) -> Vec<[f32; 3]> {
    let angles = (0..COUNT).map(|i| TAU * i as f32 / COUNT as f32);
    let ripple = |angle: f32| 0.25 * (PI * (2.0 * time - 1.0)).sin() * (3.0 * angle).cos();
    let place = |a: f32| {
        [
            (1.0 + ripple(a)) * a.cos(),
            (1.0 + ripple(a)) * a.sin(),
            0.0,
        ]
    };
    angles.map(place).collect()
}

fn main() -> Result<(), ModelError> {
    let device = Device::flex().autodiff();
    let canonical = GaussianRows::from_points(&ring(0.5), &[[0.9, 0.6, 0.2]; COUNT], 0, 0.05);
    let gaussians = Gaussians::from_rows(&canonical, &device);

    // Positions only; `rotation` and `scale` are further heads of the decoder.
    let config = DeformationConfig {
        representation: Default::default(),
        hidden: 32,
        layers: 2,
        encoder: HashEncoderConfig {
            n_levels: 4,
            n_features_per_level: 2,
            log2_hashmap_size: 12,
            base_resolution: vec![4, 4, 2, 4],
            finest_resolution: vec![16, 16, 2, 8],
            smoothstep: true,
            reference_sizing: false,
            pruned_levels: Vec::new(),
        },
        temporal: None,
        heads: Heads {
            rotation: false,
            scale: false,
            appearance: false,
            sh_rest: 0,
        },
    };
    let space = SpaceBox::around(&canonical.means, 0.0, 0.3);
    let mut field = DeformationField::new(&config, space, &mut Pcg64::seed_from_u64(0), &device)?;
    let mut optimizer = AdamConfig::new().init();
    for step in 0..=1000 {
        let is_test = step % 200 == 0;
        let time = if is_test {
            0.35
        } else {
            (step % 11) as f32 / 10.0
        };
        let truth = ring(time).into_flattened();
        let truth = Tensor::<1>::from_floats(truth.as_slice(), &device).reshape([COUNT, 3]);
        let means = gaussians.means.val().detach();
        let offsets = field.decode(field.features(means.clone(), None, time)?)?;
        let loss = (means + offsets.means - truth).powi_scalar(2).mean();
        if is_test {
            let squared: f32 = loss.into_scalar();
            println!(
                "step {step:4}   at time 0.35 off by {:.4}",
                (3.0 * squared).sqrt()
            );
            continue;
        }
        let gradients = GradientsParams::from_grads(loss.backward(), &field);
        field = optimizer.step(1e-3, field, gradients);
    }
    Ok(())
}
