//! `dash config`: the values of a preset, or the reference of all keys.

use clap::Args;
use dash_train::train::config::deviations;
use dash_train::train::reference;
use dash_train::train::{Preset, TrainConfig};

use crate::failure::Failure;

/// Print the values of a preset, to change them in a file for --config
#[derive(Args)]
#[command(after_help = "Examples:
  dash config --preset quick > mine.toml
  dash train out/room --out runs/room --config mine.toml
  dash config --markdown
  dash config --deviations")]
pub struct ConfigArgs {
    /// The preset
    #[arg(long, value_enum, default_value = "default")]
    preset: Preset,
    /// Print the reference of all keys instead
    #[arg(long)]
    markdown: bool,
    /// Print how every preset deviates from the paper, 3DGS or the released code instead
    #[arg(long, conflicts_with = "markdown")]
    deviations: bool,
}

pub fn run(args: &ConfigArgs) -> Result<String, Failure> {
    if args.markdown {
        return Ok(reference());
    }
    if args.deviations {
        return Ok(deviations());
    }
    let config = TrainConfig::preset(args.preset);
    toml::to_string(&config).map_err(|e| Failure::new(e.to_string()))
}
