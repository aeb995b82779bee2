//! `dash export`: one instant as a standard 3DGS PLY.

use std::path::PathBuf;

use clap::Args;
use dash_model::write_splat_ply;
use dash_train::train::RunFolder;

use crate::Shared;
use crate::failure::Failure;
use crate::values;

/// Write the scene at one instant as a standard 3DGS PLY file
#[derive(Args)]
#[command(after_help = "Example:
  dash export runs/room --time 0.5 --out room_at_half.ply

A 3DGS PLY can't say that a run leaves out of its pictures what is nearer to a camera than anything that was
seen. The file names this limit in a comment, which dash render FILE.ply heeds. Other viewers don't: what hangs
before the training cameras may show there. There are as many f_rest_* columns as the scene's degree of colours
needs (0, 9, 24 or 45); the viewers of the 3DGS authors read 45 only: --sh-degree 3.")]
pub struct ExportArgs {
    /// A run's folder
    run: PathBuf,
    /// The instant, from 0 (the clip's start) to 1 (its end)
    #[arg(long, value_name = "T", value_parser = values::time)]
    time: f32,
    /// File to write; one that exists is replaced
    #[arg(long, value_name = "FILE.ply")]
    out: PathBuf,
    /// Colour coefficients up to this degree, zeros where the scene has none [default: the scene's degree]
    #[arg(long, value_name = "0..3", value_parser = clap::value_parser!(u8).range(0..=3))]
    sh_degree: Option<u8>,
}

pub fn run(args: &ExportArgs, shared: &Shared) -> Result<String, Failure> {
    if !values::has_extension(&args.out, "ply") {
        return Err(Failure::usage(format!(
            "--out {}: expected a name that ends in .ply",
            args.out.display()
        )));
    }
    let device = shared.device.unwrap_or_default().device()?;
    let scene = RunFolder::open(&args.run)?.scene(&device)?;
    let mut rows = scene.at(args.time)?;
    if let Some(degree) = args.sh_degree.map(usize::from) {
        let least = rows.sh_degree();
        if degree < least {
            return Err(Failure::usage(format!(
                "--sh-degree {degree}: {} has colours of degree {least}; expected {least} to 3",
                args.run.display()
            )));
        }
        rows = rows.with_sh_degree(degree);
    }
    write_splat_ply(&args.out, &rows, scene.settings.near_plane)?;
    let (n_static, n_dynamic) = scene.counts();
    Ok(format!(
        "{}: {} Gaussians ({n_static} static, {n_dynamic} dynamic) at time {}",
        args.out.display(),
        rows.len(),
        args.time
    ))
}
