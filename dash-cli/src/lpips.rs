//! Options that name the weights of LPIPS.

use std::path::PathBuf;

use clap::Args;
use dash_train::evaluate::PerceptualFiles;

use crate::failure::Failure;
use crate::values;

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

    /// The same by their whole paths, for processes that run elsewhere.
    pub fn absolute_files(&self) -> Result<PerceptualFiles, Failure> {
        let absolute = |files: &[PathBuf]| -> Result<Vec<PathBuf>, Failure> {
            files.iter().map(|file| values::absolute(file)).collect()
        };
        Ok(PerceptualFiles {
            vgg: absolute(&self.lpips_vgg)?,
            alex: absolute(&self.lpips_alex)?,
        })
    }
}
