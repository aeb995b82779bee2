//! Scores of a scene over the views of one split.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use dash_model::{DynamicScene, Layer};
use serde::{Deserialize, Serialize};

use super::perceptual::Perceptual;
use crate::TrainError;
use crate::dataset::{Dataset, Partition, View};
use crate::metrics::{
    MOVING_PIXELS_RULE, MS_SSIM_RULE, PSNR_RULE, SPLIT_RULE, SSIM_RULE, SplitCounts, masked_psnr,
    moving_pixels_by_bands, ms_ssim, ms_ssim_scales, n_bands, psnr, split_scores, ssim,
};
use crate::render::{Picture, render_timed};

/// Above this a mask is set.
const MASK_HALF: u8 = 127;

/// Steps of an 8-bit channel.
const LEVELS: f32 = 255.0;

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
    /// dB, over the pixels that move in this camera's video.
    pub psnr_dynamic: Option<f64>,
    /// In [-1, 1].
    pub ssim: Option<f64>,
    /// In [0, 1].
    pub ms_ssim: Option<f64>,
    /// 0 for the same picture.
    pub lpips_vgg: Option<f64>,
    /// 0 for the same picture.
    pub lpips_alex: Option<f64>,
}

/// How well the dynamic Gaussians cover what really moves.
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

/// Scores of a scene over one split: means over its views, and every view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// The split.
    pub split: Partition,
    /// Static Gaussians.
    pub n_static: usize,
    /// Dynamic Gaussians.
    pub n_dynamic: usize,
    /// Mean over views, dB.
    pub psnr: Option<f64>,
    /// Mean over the views of cameras in which something moves, dB.
    pub psnr_dynamic: Option<f64>,
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

/// Scores `scene` against the views of a split. `downscale` is the factor at which the dataset was
/// loaded, for the record; `perceptual` holds what LPIPS needs, by default nothing.
///
/// # Errors
/// When the split has no views, or a kernel refuses its input.
pub fn evaluate(
    scene: &DynamicScene,
    dataset: &Dataset,
    split: Partition,
    downscale: f64,
    perceptual: &Perceptual,
) -> Result<Evaluation, TrainError> {
    let views: Vec<&View> = dataset.views_of(split).collect();
    if views.is_empty() {
        return Err(TrainError::run(
            &dataset.root,
            format!(
                "expected views of the {split} split, found none; choose --split or --test-cameras"
            ),
        ));
    }
    evaluate_views(
        scene,
        dataset,
        (split, &views),
        &mut BTreeMap::new(),
        (downscale, perceptual),
    )
}

/// [`evaluate`] over some views of a split, at least one. `masks` holds which pixels move, by camera,
/// and keeps those that are worked out here.
pub(super) fn evaluate_views(
    scene: &DynamicScene,
    dataset: &Dataset,
    (split, views): (Partition, &[&View]),
    masks: &mut BTreeMap<usize, Vec<bool>>,
    (downscale, perceptual): (f64, &Perceptual),
) -> Result<Evaluation, TrainError> {
    let first = views[0];
    let background = scene.settings.background;
    // A group of pictures of a video is decoded once for all of its frames.
    dataset.announce(views.iter().copied());
    // The first rendering pays for what later ones find ready.
    render_timed(scene, &first.camera, first.time, Layer::Full)?;
    let (mut per_view, mut seconds) = (Vec::with_capacity(views.len()), 0.0);
    let mut counts: Option<SplitCounts> = None;
    for (place, view) in views.iter().enumerate() {
        let (picture, secs) = render_timed(scene, &view.camera, view.time, Layer::Full)?;
        seconds += secs;
        let moving = match masks.entry(view.camera_index) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => {
                let moving = new.insert(camera_moving_pixels(dataset, view, background)?);
                dataset.announce(views[place..].iter().copied());
                moving
            }
        };
        per_view.push(score(view, &picture, moving, background, perceptual)?);
        if let Some(truth) = view.motion_mask()? {
            let (dynamic, _) = render_timed(scene, &view.camera, view.time, Layer::Dynamic)?;
            let truth: Vec<bool> = truth.iter().map(|&m| m > MASK_HALF).collect();
            *counts.get_or_insert_default() += split_scores(&dynamic.alpha, &truth);
        }
    }
    let (n_static, n_dynamic) = scene.counts();
    let camera = &first.camera;
    Ok(Evaluation {
        split,
        n_static,
        n_dynamic,
        psnr: mean_of_all(per_view.iter().map(|view| view.psnr)),
        psnr_dynamic: mean_of_some(per_view.iter().filter_map(|view| view.psnr_dynamic)),
        ssim: mean_of_all(per_view.iter().map(|view| view.ssim)),
        ms_ssim: mean_of_all(per_view.iter().map(|view| view.ms_ssim)),
        lpips_vgg: mean_of_all(per_view.iter().map(|view| view.lpips_vgg)),
        lpips_alex: mean_of_all(per_view.iter().map(|view| view.lpips_alex)),
        render_fps: finite(views.len() as f64 / seconds),
        decomposition: counts.map(|counts| DecompositionScores {
            precision: counts.precision(),
            recall: counts.recall(),
            f1: counts.f1(),
        }),
        metric_settings: MetricSettings {
            lpips: perceptual.rule(),
            lpips_missing: perceptual.missing(views),
            ..settings(background, downscale, camera.width, camera.height)
        },
        per_view,
    })
}

fn score(
    view: &View,
    picture: &Picture,
    moving: &[bool],
    background: [f32; 3],
    perceptual: &Perceptual,
) -> Result<ViewScores, TrainError> {
    let (width, height) = (view.camera.width, view.camera.height);
    let (mut truth, counted) = view.rgb_and_counted(background)?;
    let mut image: Vec<f32> = picture.rgb.iter().copied().map(as_saved).collect();
    let counted: Option<Vec<bool>> =
        counted.map(|counted| counted.iter().map(|&c| c > 0.0).collect());
    let mut moving = moving.to_vec();
    if let Some(counted) = &counted {
        for picture in [&mut image, &mut truth] {
            blacken(picture, counted);
        }
        for (moves, counts) in moving.iter_mut().zip(counted) {
            *moves &= counts;
        }
    }
    let lpips = perceptual.score(&image, &truth, [width, height])?;
    let over_counted = |counted: &Vec<bool>| masked_psnr(&image, &truth, counted);
    Ok(ViewScores {
        camera: view.camera_name.clone(),
        frame: view.frame,
        time: view.time,
        psnr: match &counted {
            None => finite(psnr(&image, &truth)),
            Some(counted) => over_counted(counted).and_then(finite),
        },
        psnr_dynamic: masked_psnr(&image, &truth, &moving).and_then(finite),
        ssim: finite(ssim(&image, &truth, width, height)),
        ms_ssim: finite(ms_ssim(&image, &truth, width, height)),
        lpips_vgg: lpips.vgg,
        lpips_alex: lpips.alex,
    })
}

/// Makes the pixels of a picture black that don't count.
fn blacken(picture: &mut [f32], counted: &[bool]) {
    for (pixel, _) in picture
        .chunks_exact_mut(3)
        .zip(counted)
        .filter(|(_, counts)| !**counts)
    {
        pixel.fill(0.0);
    }
}

/// The value that an 8-bit picture would hold; NaN stays NaN.
fn as_saved(value: f32) -> f32 {
    (value.clamp(0.0, 1.0) * LEVELS).round() / LEVELS
}

/// Which pixels move in the video of this view's camera, over all its frames; of a single picture,
/// those that the dataset's mask of it marks.
pub(super) fn camera_moving_pixels(
    dataset: &Dataset,
    view: &View,
    background: [f32; 3],
) -> Result<Vec<bool>, TrainError> {
    let camera = &view.camera;
    // Views of one camera differ in size only if the dataset's images do.
    let same = |other: &&View| {
        other.camera_index == view.camera_index
            && (other.camera.width, other.camera.height) == (camera.width, camera.height)
    };
    let mut video: Vec<&View> = dataset.views.iter().filter(same).collect();
    video.sort_by_key(|view| view.frame);
    if let ([_], Some(mask)) = (video.as_slice(), view.motion_mask()?) {
        return Ok(mask.iter().map(|&m| m > MASK_HALF).collect());
    }
    // Frames on demand are asked for again for every band of rows.
    let size = [camera.width, camera.height];
    let bands = n_bands(video.len(), size);
    dataset.announce((0..bands).flat_map(|_| video.iter().copied()));
    let moving = moving_pixels_by_bands(video.len(), size, |frame, rows| {
        video[frame].rgb_rows(background, rows)
    })?;
    Ok(moving)
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

fn settings(background: [f32; 3], downscale: f64, width: usize, height: usize) -> MetricSettings {
    MetricSettings {
        resize: resize_rule(downscale),
        rounding: ROUNDING_RULE.into(),
        background,
        psnr: PSNR_RULE.into(),
        moving_pixels: MOVING_PIXELS_RULE.into(),
        ssim: SSIM_RULE.into(),
        ms_ssim: MS_SSIM_RULE.into(),
        ms_ssim_scales: ms_ssim_scales(width, height),
        decomposition: SPLIT_RULE.into(),
        lpips: Perceptual::default().rule(),
        lpips_missing: None,
        render_fps:
            "each of the split's views once at its own size, after one unmeasured rendering, \
                     device synchronised before the clock stops, copying to the host excluded"
                .into(),
        peak_memory: "not recorded".into(),
    }
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// The mean when every view has a score: one broken view must not go unnoticed.
fn mean_of_all(scores: impl ExactSizeIterator<Item = Option<f64>>) -> Option<f64> {
    let n = scores.len();
    let sum: f64 = scores.sum::<Option<f64>>()?;
    finite(sum / n as f64)
}

/// The mean of the scores there are.
fn mean_of_some(scores: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = scores.fold((0.0, 0), |(sum, n), score| (sum + score, n + 1));
    finite(sum / f64::from(n))
}

#[cfg(test)]
mod tests;
