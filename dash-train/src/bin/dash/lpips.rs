//! Options that name the weights of LPIPS.

use std::path::PathBuf;

use clap::Args;
use dash_train::evaluate::PerceptualFiles;

/// Weight files of LPIPS by network.
#[derive(Args)]
pub struct LpipsArgs {
    /// Measure LPIPS with VGG16: torchvision's vgg16 and LPIPS's vgg.pth, or one file with both
    #[arg(long, value_name = "FILE", num_args = 1..)]
    lpips_vgg: Vec<PathBuf>,
    /// Measure LPIPS with AlexNet: torchvision's alexnet and LPIPS's alex.pth, or one file with both
    #[arg(long, value_name = "FILE", num_args = 1..)]
    lpips_alex: Vec<PathBuf>,
}

impl LpipsArgs {
    /// The files, not looked at yet.
    pub fn files(&self) -> PerceptualFiles {
        PerceptualFiles {
            vgg: self.lpips_vgg.clone(),
            alex: self.lpips_alex.clone(),
        }
    }
}
