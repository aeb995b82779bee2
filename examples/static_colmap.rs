//! A static capture in COLMAP's layout (`images/` and `sparse/0/`): trains plain 3DGS, scores every
//! eighth view, and writes the Gaussians as a PLY file that any 3DGS viewer reads.
//!
//! `cargo run --release --example static_colmap -- [FOLDER RUN [DOWNSCALE]]`

mod common;

use common::{Failure, print_scores, print_step, task};
use dash_model::write_splat_ply;
use dash_train::process;
use dash_train::reconstruct::reconstruct;
use dash_train::synth::SynthLayout;

fn main() -> Result<(), Failure> {
    process::run(run)
}

fn run() -> Result<(), Failure> {
    let task = task(SynthLayout::Colmap)?;
    let done = reconstruct(&task.folder, &task.run, &task.config, &mut print_step)?;
    print_scores(done.scores());

    let (path, rows) = (task.run.join("scene.ply"), done.scene.at(0.0)?);
    write_splat_ply(&path, &rows, done.scene.settings.near_plane)?;
    println!("{} Gaussians in {}", rows.len(), path.display());
    Ok(())
}
