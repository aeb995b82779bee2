//! A model of your own from dash's modules: a hash encoder and a small network fitted to an image.
//!
//! `cargo run --release --example compose`

use burn::module::Module;
use burn::optim::{AdamConfig, GradientsParams};
use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Tensor, TensorData};
use dash_model::mlp::Mlp;
use dash_model::{HashEncoder, HashEncoderConfig, ModelError};
use rand::SeedableRng;
use rand_pcg::Pcg64;

const SIZE: usize = 96;

/// Colour as a function of the position in an image.
#[derive(Module, Debug)]
struct ImageField {
    encoder: HashEncoder,
    decoder: Mlp,
}

impl ImageField {
    /// `positions [N, 2]` in [0, 1] -> `[N, 3]`
    fn forward(&self, positions: Tensor<2>) -> Result<Tensor<2>, ModelError> {
        let features = self.encoder.forward(positions)?;
        Ok(sigmoid(self.decoder.forward(features)?))
    }
}

/// Rings whose colour turns with the angle.
fn color(x: f32, y: f32) -> [f32; 3] {
    let (dx, dy) = (x - 0.5, y - 0.45);
    let ring = (40.0 * dx.hypot(dy)).sin();
    [0.0, 2.1, 4.2].map(|phase| 0.5 + 0.25 * ring + 0.25 * (3.0 * dy.atan2(dx) + phase).cos())
}

fn main() -> Result<(), ModelError> {
    let device = Device::flex().autodiff();
    let mut rng = Pcg64::seed_from_u64(0);
    let encoder = HashEncoderConfig {
        n_levels: 8,
        n_features_per_level: 2,
        log2_hashmap_size: 12,
        base_resolution: vec![4, 4],
        finest_resolution: vec![SIZE as u32, SIZE as u32],
        smoothstep: false,
        reference_sizing: false,
        pruned_levels: Vec::new(),
    }
    .init(&mut rng, &device)?;
    let decoder = Mlp::new(&[encoder.n_output_features(), 32, 3], &mut rng, &device);
    let mut model = ImageField { encoder, decoder };

    let centre = |i: usize| (i as f32 + 0.5) / SIZE as f32;
    let pixels: Vec<[f32; 2]> = (0..SIZE * SIZE)
        .map(|i| [centre(i % SIZE), centre(i / SIZE)])
        .collect();
    let colors: Vec<f32> = pixels.iter().flat_map(|[x, y]| color(*x, *y)).collect();
    let upload = |values: &[f32], width| {
        Tensor::<2>::from_data(
            TensorData::new(values.to_vec(), [SIZE * SIZE, width]),
            &device,
        )
    };
    let (positions, target) = (upload(pixels.as_flattened(), 2), upload(&colors, 3));

    let mut optimizer = AdamConfig::new().init();
    for step in 0..=300 {
        let loss = (model.forward(positions.clone())? - target.clone())
            .powi_scalar(2)
            .mean();
        if step % 50 == 0 {
            let mse: f32 = loss.clone().into_scalar();
            println!("step {step:3}   PSNR {:5.2} dB", -10.0 * mse.log10());
        }
        let gradients = GradientsParams::from_grads(loss.backward(), &model);
        model = optimizer.step(1e-2, model, gradients);
    }
    Ok(())
}
