//! `dash synth`: a synthetic dataset.

use std::path::PathBuf;

use clap::Args;
use dash_train::synth::{SceneKind, SynthConfig, SynthLayout, write};

use crate::failure::Failure;
use crate::values::Size;

/// Render a synthetic multi-view clip with exact cameras and truth, as a dataset
#[derive(Args)]
#[command(
    after_help = "Example:\n  dash synth out/room --scene bounce --cameras 12 --frames 24 --size 160x120"
)]
pub struct SynthArgs {
    /// Folder to make; must not exist, or be empty
    out: PathBuf,
    /// What to render
    #[arg(long, value_enum, default_value_t)]
    scene: SceneKind,
    /// How the files are laid out
    #[arg(long, value_enum, default_value_t)]
    layout: SynthLayout,
    /// Number of cameras [default: 12]
    #[arg(long, value_name = "N")]
    cameras: Option<usize>,
    /// Number of frames [default: 24]
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// Picture size [default: 160x120]
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// Varies colours, textures and places
    #[arg(long, value_name = "S", default_value_t)]
    seed: u64,
    /// Write one MP4 per camera instead of PNG frames (needs ffmpeg)
    #[arg(long)]
    video: bool,
}

pub fn run(args: &SynthArgs) -> Result<String, Failure> {
    let base = SynthConfig::default();
    let size = args.size.unwrap_or(Size {
        width: base.width,
        height: base.height,
    });
    let config = SynthConfig {
        scene: args.scene,
        layout: args.layout,
        cameras: args.cameras.unwrap_or(base.cameras),
        frames: args.frames.unwrap_or(base.frames),
        width: size.width,
        height: size.height,
        seed: args.seed,
        video: args.video,
    };
    Ok(write(&args.out, &config)?.to_string())
}
