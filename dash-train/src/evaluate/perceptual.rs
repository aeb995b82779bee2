//! LPIPS of the views, with the networks whose weights the user named.

use std::path::PathBuf;

use burn::tensor::Device;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::dataset::View;
use crate::metrics::lpips::{LPIPS_RULE, Lpips, Network};

/// What `metric_settings` says where no weights were named.
const NO_WEIGHTS: &str = "not measured: no weights";

/// The networks that LPIPS is measured with; by default none.
#[derive(Debug, Default)]
pub struct Perceptual {
    vgg: Option<Lpips>,
    alex: Option<Lpips>,
}

/// LPIPS of one view; absent without weights, for pictures smaller than the network needs, or where
/// it is not finite.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct PerceptualScores {
    pub vgg: Option<f64>,
    pub alex: Option<f64>,
}

/// Weight files by network; a network without files is not measured.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PerceptualFiles {
    /// Those that together hold VGG16's features and LPIPS's weights for them.
    pub vgg: Vec<PathBuf>,
    /// Those that together hold AlexNet's features and LPIPS's weights for them.
    pub alex: Vec<PathBuf>,
}

impl PerceptualFiles {
    /// Checks that the files hold every tensor, without reading a value: before training, not after it.
    ///
    /// # Errors
    /// As [`Lpips::check`].
    pub fn check(&self) -> Result<(), Error> {
        for (network, files) in self.by_network() {
            if !files.is_empty() {
                Lpips::check(network, files)?;
            }
        }
        Ok(())
    }

    /// Reads the weights.
    ///
    /// # Errors
    /// As [`Lpips::load`].
    pub fn load(&self, device: &Device) -> Result<Perceptual, Error> {
        let [vgg, alex] = self.by_network().map(|(network, files)| {
            let load = || Lpips::load(network, files, device);
            (!files.is_empty()).then(load).transpose()
        });
        Ok(Perceptual {
            vgg: vgg?,
            alex: alex?,
        })
    }

    fn by_network(&self) -> [(Network, &[PathBuf]); 2] {
        [(Network::Vgg16, &self.vgg), (Network::AlexNet, &self.alex)]
    }
}

impl Perceptual {
    /// Scores a picture `[H, W, 3]` against the true one.
    pub(super) fn score(
        &self,
        image: &[f32],
        truth: &[f32],
        [width, height]: [usize; 2],
    ) -> Result<PerceptualScores, Error> {
        let score = |lpips: &Option<Lpips>| -> Result<Option<f64>, Error> {
            let Some(lpips) = lpips else {
                return Ok(None);
            };
            match lpips.distance(image, truth, width, height) {
                Ok(distance) => Ok(Some(distance).filter(|d| d.is_finite())),
                // Told once for all views, see `missing`.
                Err(Error::PictureTooSmall { .. }) => Ok(None),
                Err(error) => Err(error),
            }
        };
        Ok(PerceptualScores {
            vgg: score(&self.vgg)?,
            alex: score(&self.alex)?,
        })
    }

    /// How LPIPS was taken.
    pub(super) fn rule(&self) -> String {
        let names: Vec<String> = self.networks().map(|network| network.to_string()).collect();
        if names.is_empty() {
            return NO_WEIGHTS.into();
        }
        format!("{}: {LPIPS_RULE}", names.join(" and "))
    }

    /// Why LPIPS is absent though there are weights.
    pub(super) fn missing(&self, views: &[&View]) -> Option<String> {
        let reasons: Vec<String> = self
            .networks()
            .filter_map(|network| {
                let min = network.min_side_px();
                let small = views
                    .iter()
                    .map(|view| &view.camera)
                    .find(|camera| camera.width.min(camera.height) < min)?;
                Some(format!(
                    "not defined with {network}, which needs {min}x{min} pixels; the views have {}x{}",
                    small.width, small.height
                ))
            })
            .collect();
        (!reasons.is_empty()).then(|| reasons.join("; "))
    }

    fn networks(&self) -> impl Iterator<Item = Network> {
        [&self.vgg, &self.alex]
            .into_iter()
            .flatten()
            .map(Lpips::network)
    }
}
