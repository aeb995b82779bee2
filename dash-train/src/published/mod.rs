//! How the field measures on its datasets, and what it has published.
//!
//! A [`Protocol`] pins a dataset's scenes, views, frames and sizes; a [`Published`] holds a system's figures on it, with
//! their source. [`crate::benchmark`] runs protocols; [`crate::report`] shows figures beside ours.

mod protocol;
mod protocols;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

pub use protocol::{Protocol, ProtocolName, Scene};
pub use protocols::PROTOCOLS;

/// The key of figures that are means over all scenes of a dataset.
pub const MEAN: &str = "mean";

/// The figures that others have published; read once.
static FIGURES: LazyLock<Vec<Published>> = LazyLock::new(|| {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct File {
        published: Vec<Published>,
    }
    let file: File = toml::from_str(include_str!("figures.toml")).expect("tested: it parses");
    file.published
});

/// What a source states of a system on a dataset.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// On which dataset.
    pub dataset: ProtocolName,
    /// The system's name.
    pub system: String,
    /// The paper and its tables, or the page.
    pub source: String,
    /// Whether others than the system's authors state it.
    #[serde(default)]
    pub second_hand: bool,
    /// On which hardware times were taken, where the source states it.
    pub hardware: Option<String>,
    /// In what it differs from the protocol, or what its scores are.
    pub note: Option<String>,
    /// The figures by scene, and under [`MEAN`].
    pub scenes: BTreeMap<String, Figures>,
}

/// Scores of a system and what it costs. What was not measured or is not stated is absent.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Figures {
    /// dB.
    pub psnr: Option<f64>,
    /// In [-1, 1].
    pub ssim: Option<f64>,
    /// In [0, 1].
    pub ms_ssim: Option<f64>,
    /// (1 - SSIM) / 2.
    pub dssim: Option<f64>,
    /// With AlexNet.
    pub lpips_alex: Option<f64>,
    /// With VGG16.
    pub lpips_vgg: Option<f64>,
    /// With a network that the source does not state.
    pub lpips: Option<f64>,
    /// Minutes of training.
    pub minutes: Option<f64>,
    /// Pictures per second.
    pub fps: Option<f64>,
    /// Size on disk, in millions of bytes.
    pub megabytes: Option<f64>,
    /// Number of Gaussians.
    pub gaussians: Option<f64>,
}

impl Figures {
    /// Each figure of several, put together by `join`; absent where one lacks it.
    pub fn together(all: &[Self], join: impl Fn(&[f64]) -> f64) -> Self {
        let of = |figure: fn(&Self) -> Option<f64>| {
            let values: Option<Vec<f64>> = all.iter().map(figure).collect();
            values
                .filter(|values| !values.is_empty())
                .map(|values| join(&values))
        };
        Self {
            psnr: of(|f| f.psnr),
            ssim: of(|f| f.ssim),
            ms_ssim: of(|f| f.ms_ssim),
            dssim: of(|f| f.dssim),
            lpips_alex: of(|f| f.lpips_alex),
            lpips_vgg: of(|f| f.lpips_vgg),
            lpips: of(|f| f.lpips),
            minutes: of(|f| f.minutes),
            fps: of(|f| f.fps),
            megabytes: of(|f| f.megabytes),
            gaussians: of(|f| f.gaussians),
        }
    }

    /// The mean of each figure over scenes that all have it.
    pub fn mean(all: &[Self]) -> Self {
        Self::together(all, |values| {
            values.iter().sum::<f64>() / values.len() as f64
        })
    }
}

/// What is published on a dataset, in the order of the file.
pub fn published(dataset: ProtocolName) -> impl Iterator<Item = &'static Published> {
    FIGURES.iter().filter(move |entry| entry.dataset == dataset)
}

/// The protocol and scene of a dataset's folder of this name, spelt as it was published.
///
/// ```
/// use dash_train::published::{ProtocolName, published, scene_called};
///
/// let (protocol, _) = scene_called("flame_steak").expect("a scene of Neural 3D Video");
/// assert_eq!(protocol.name, ProtocolName::N3dv);
/// assert!(published(protocol.name).count() > 1);
/// ```
pub fn scene_called(name: &str) -> Option<(&'static Protocol, &'static Scene)> {
    PROTOCOLS.iter().find_map(|protocol| {
        let scene = protocol.scenes.iter().find(|scene| scene.name == name)?;
        Some((protocol, scene))
    })
}
