//! A loss term of your own, from outside the crate: a room has no holes, so pixels through which the background shows
//! cost something.
//!
//! `cargo run --release --example own_loss -- [FOLDER RUN [DOWNSCALE]]`

#[expect(dead_code, reason = "each example uses its part")]
mod common;

use std::sync::Arc;

use burn::tensor::Tensor;
use common::{Failure, print_step, task};
use dash_train::dataset::{self, LoadOptions, View};
use dash_train::process;
use dash_train::synth::SynthLayout;
use dash_train::train::core::{Forward, Run};
use dash_train::train::{Additions, Extension, Trainer};

/// Weight of the mean transparency of a picture.
struct NoHoles(f32);

impl<M> Extension<M> for NoHoles {
    fn name(&self) -> &'static str {
        "no_holes"
    }

    fn loss_terms(
        &mut self,
        _run: &mut Run<M>,
        _view: &View,
        forward: &Forward,
    ) -> Result<Vec<Tensor<1>>, dash_train::Error> {
        let alpha = forward.image.clone().narrow(2, 3, 1); // [H, W, 1]
        Ok(vec![(-alpha + 1.0).mean() * self.0])
    }
}

fn main() -> Result<(), Failure> {
    process::run(run)
}

fn run() -> Result<(), Failure> {
    let task = task(SynthLayout::N3dv)?;
    let dataset = Arc::new(dataset::load(&task.folder, &LoadOptions::default())?);
    let device = task.config.device.device()?;
    for weight in [0.0, 1.0] {
        let additions = Additions {
            extensions: vec![Box::new(NoHoles(weight))],
            ..Default::default()
        };
        let config = task.config.train.clone();
        let mut trainer = Trainer::with(config, dataset.clone(), &device, additions)?;
        while !trainer.is_finished() {
            print_step(&trainer.step()?, 0.0);
        }
        let view = &dataset.views[0];
        let picture = trainer.scene().render(&view.camera, view.time)?;
        let alpha: f32 = picture.alpha().mean().into_scalar();
        println!("weight {weight}: mean alpha {alpha:.4}");
    }
    Ok(())
}
