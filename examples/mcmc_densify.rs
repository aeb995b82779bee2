//! A densification strategy of your own: relocation as in 3DGS-MCMC (Kheradmand et al. 2024). Dead Gaussians move to where
//! live ones are, drawn by opacity; both then have the opacity and the scale that leave the picture unchanged (Eq. 9).
//!
//! `cargo run --release --example mcmc_densify -- [FOLDER RUN [DOWNSCALE]]`

#[expect(dead_code, reason = "each example uses its part")]
mod common;

use std::sync::Arc;

use common::{Failure, print_step, task};
use dash_model::{GaussianRows, logit};
use dash_train::dataset::{self, LoadOptions};
use dash_train::process;
use dash_train::synth::SynthLayout;
use dash_train::train::core::{Edit, Round};
use dash_train::train::{Additions, Densify, Trainer};
use rand::distr::{Distribution, weighted::WeightedIndex};
use rand_pcg::Pcg64;

/// Opacity up to which a Gaussian is dead.
const DEAD: f32 = 0.005;
/// Growth of a set in a round.
const GROWTH: f32 = 1.05;

struct Relocation;

impl Densify for Relocation {
    fn round(&mut self, round: &Round<'_>, rng: &mut Pcg64) -> Edit {
        let n = round.rows.len();
        let opacity = |row: usize| 1.0 / (1.0 + (-round.rows.opacity_logits[row]).exp());
        let is_dead = |row: usize| opacity(row).is_nan() || opacity(row) <= DEAD;
        let grown = ((GROWTH * n as f32) as usize)
            .min(round.max_gaussians)
            .max(n);
        let mut sources: Vec<usize> = (0..grown).collect();
        let live: Vec<usize> = (0..n).filter(|&row| !is_dead(row)).collect();
        let Ok(by_opacity) = WeightedIndex::new(live.iter().map(|&row| opacity(row))) else {
            return unchanged(round.rows);
        };
        for (row, source) in sources.iter_mut().enumerate() {
            if row >= n || is_dead(row) {
                *source = live[by_opacity.sample(rng)];
            }
        }
        let mut copies = vec![0; n];
        sources.iter().for_each(|&source| copies[source] += 1);
        let mut rows = round.rows.gather(&sources);
        for (row, &source) in sources.iter().enumerate().filter(|(_, s)| copies[**s] > 1) {
            let (new, factor) = shared(opacity(source).min(0.999), copies[source]);
            rows.opacity_logits[row] = logit(new.max(DEAD));
            rows.log_scales[row] = round.rows.log_scales[source].map(|scale| scale + factor.ln());
        }
        let fresh = sources.iter().map(|&source| copies[source] > 1).collect();
        Edit {
            rows,
            sources,
            fresh,
        }
    }
}

/// The opacity of each of `n` Gaussians in one place that together show one of `opacity`, and the factor of its scale.
fn shared(opacity: f32, n: usize) -> (f32, f32) {
    let new = 1.0 - (1.0 - opacity).powf(1.0 / n as f32);
    let mut sum = 0.0;
    for i in 1..=n {
        let mut binomial = 1.0;
        for k in 0..i {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            sum += sign * binomial * new.powi(k as i32 + 1) / ((k + 1) as f32).sqrt();
            binomial *= (i - 1 - k) as f32 / (k + 1) as f32;
        }
    }
    (new, opacity / sum)
}

fn unchanged(rows: &GaussianRows) -> Edit {
    Edit {
        rows: rows.clone(),
        sources: (0..rows.len()).collect(),
        fresh: vec![false; rows.len()],
    }
}

fn main() -> Result<(), Failure> {
    process::run(run)
}

fn run() -> Result<(), Failure> {
    let mut task = task(SynthLayout::N3dv)?;
    let set = ["densify.interval=20", "densify.opacity_reset_interval=none"];
    for assignment in set {
        task.config.train.set(assignment)?;
    }
    let dataset = Arc::new(dataset::load(&task.folder, &LoadOptions::default())?);
    let device = task.config.device.device()?;
    let additions = Additions {
        densify: Some(Box::new(Relocation)),
        ..Default::default()
    };
    let mut trainer = Trainer::with(task.config.train, dataset, &device, additions)?;
    let before = trainer.scene().counts();
    while !trainer.is_finished() {
        print_step(&trainer.step()?, 0.0);
    }
    let psnr = trainer.training_psnr()?;
    let after = trainer.scene().counts();
    println!("{before:?} Gaussians became {after:?}, training views {psnr:.2} dB");
    Ok(())
}
