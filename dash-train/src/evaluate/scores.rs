//! Scores and the rules behind them, as `results.json` holds them.

use serde::{Deserialize, Serialize};

use super::perceptual::Perceptual;
use crate::dataset::Partition;
use crate::metrics::{
    CORRECTION_RULE, DECOMPOSITION_RULE, MOVING_PIXELS_RULE, MS_SSIM_RULE, PSNR_RULE, SSIM_RULE,
    ms_ssim_scales,
};

/// How rendered values were rounded.
pub(crate) const ROUNDING_RULE: &str =
    "rendered values clamped to [0, 1] and rounded to 8 bits, as a saved PNG";

/// Scores of one view. A score is absent where it is not defined or not finite.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViewScores {
    /// The camera's name.
    pub camera: String,
    /// Index of the time among the dataset's.
    pub frame: usize,
    /// Time in [0, 1].
    pub time: f32,
    /// dB.
    pub psnr: Option<f64>,
    /// dB, over the moving pixels of this camera's video.
    pub psnr_dynamic: Option<f64>,
    /// dB, with the exposure of the captured picture.
    pub psnr_corrected: Option<f64>,
    /// dB, over the moving pixels, with the exposure of the captured picture.
    pub psnr_dynamic_corrected: Option<f64>,
    /// In [-1, 1].
    pub ssim: Option<f64>,
    /// In [0, 1].
    pub ms_ssim: Option<f64>,
    /// 0 for the same picture.
    pub lpips_vgg: Option<f64>,
    /// 0 for the same picture.
    pub lpips_alex: Option<f64>,
}

/// How well the dynamic Gaussians cover the truly moving pixels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DecompositionScores {
    /// Share of the covered pixels that move.
    pub precision: f64,
    /// Share of the moving pixels that are covered.
    pub recall: f64,
    /// Harmonic mean of both.
    pub f1: f64,
}

/// What a reader must know to compare the scores with others'.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MetricSettings {
    /// How the ground truth got its size.
    pub resize: String,
    /// How rendered values were rounded.
    pub rounding: String,
    /// Colour behind everything, in both pictures, sRGB in [0, 1].
    pub background: [f32; 3],
    /// How PSNR is taken.
    pub psnr: String,
    /// How the moving pixels are found.
    pub moving_pixels: String,
    /// How the exposure is corrected.
    #[serde(default)]
    pub correction: String,
    /// How SSIM is taken.
    pub ssim: String,
    /// How MS-SSIM is taken.
    pub ms_ssim: String,
    /// Scales that MS-SSIM had at the size of the first view.
    pub ms_ssim_scales: usize,
    /// How `decomposition` is scored.
    pub decomposition: String,
    /// With which networks and how LPIPS is taken.
    pub lpips: String,
    /// Why LPIPS is absent though there are weights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lpips_missing: Option<String>,
    /// How rendering was timed.
    pub render_fps: String,
    /// Which process `peak_memory_bytes` belongs to.
    pub peak_memory: String,
}

/// Scores of a scene over the training or test views: their means, and every view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Which views.
    #[serde(rename = "split")]
    pub partition: Partition,
    /// Static Gaussians.
    pub n_static: usize,
    /// Dynamic Gaussians.
    pub n_dynamic: usize,
    /// Mean over views, dB.
    pub psnr: Option<f64>,
    /// Mean over the views of cameras in which something moves, dB.
    pub psnr_dynamic: Option<f64>,
    /// Mean over views, each with the exposure of its captured picture, dB.
    pub psnr_corrected: Option<f64>,
    /// The same of `psnr_dynamic`.
    pub psnr_dynamic_corrected: Option<f64>,
    /// Mean over views.
    pub ssim: Option<f64>,
    /// Mean over views.
    pub ms_ssim: Option<f64>,
    /// Mean over views; absent without weights.
    pub lpips_vgg: Option<f64>,
    /// Mean over views; absent without weights.
    pub lpips_alex: Option<f64>,
    /// Pictures per second at the views' size.
    pub render_fps: Option<f64>,
    /// Against the true masks, where the dataset has them.
    pub decomposition: Option<DecompositionScores>,
    /// What the scores mean.
    pub metric_settings: MetricSettings,
    /// Every view.
    pub per_view: Vec<ViewScores>,
}

/// How images got their size.
pub(crate) fn resize_rule(downscale: f64) -> String {
    if downscale == 1.0 {
        return "none: the images' own size".into();
    }
    format!(
        "images made smaller by {downscale} on loading, averaging over the area of each new pixel (weighted by alpha where \
         there is any) and rounding to 8 bits"
    )
}

impl MetricSettings {
    /// Those of an evaluation without LPIPS.
    pub(super) fn of(background: [f32; 3], downscale: f64, [width, height]: [usize; 2]) -> Self {
        Self {
            resize: resize_rule(downscale),
            rounding: ROUNDING_RULE.into(),
            background,
            psnr: PSNR_RULE.into(),
            moving_pixels: MOVING_PIXELS_RULE.into(),
            correction: CORRECTION_RULE.into(),
            ssim: SSIM_RULE.into(),
            ms_ssim: MS_SSIM_RULE.into(),
            ms_ssim_scales: ms_ssim_scales(width, height),
            decomposition: DECOMPOSITION_RULE.into(),
            lpips: Perceptual::default().rule(),
            lpips_missing: None,
            render_fps:
                "each of the split's views once at its own size, after one unmeasured rendering, \
                     device synchronised before the clock stops, copying to the host excluded"
                    .into(),
            peak_memory: "not recorded".into(),
        }
    }
}
