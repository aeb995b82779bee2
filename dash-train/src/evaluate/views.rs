//! Scores of a scene over the training or test views.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use dash_model::{DynamicScene, Layer};

use super::perceptual::Perceptual;
use super::scores::{DecompositionScores, Evaluation, MetricSettings, ViewScores};
use crate::Error;
use crate::SceneOverTime;
use crate::dataset::{Dataset, Partition, View};
use crate::metrics::{
    DecompositionCounts, corrected, decomposition_counts, masked_psnr, moving_pixels_by_bands,
    ms_ssim, n_bands, psnr, ssim,
};
use crate::render::{Picture, render_timed};

/// Above this a mask is set.
const MASK_HALF: u8 = 127;

/// Steps of an 8-bit channel.
const LEVELS: f32 = 255.0;

/// What is scored.
#[derive(Clone, Copy)]
pub struct Scored<'a> {
    /// Draws it.
    pub scene: &'a dyn SceneOverTime,
    /// Its static and dynamic Gaussians.
    pub counts: (usize, usize),
    /// Its background.
    pub background: [f32; 3],
}

impl<'a> From<&'a DynamicScene> for Scored<'a> {
    fn from(scene: &'a DynamicScene) -> Self {
        Self {
            scene,
            counts: scene.counts(),
            background: scene.settings.background,
        }
    }
}

/// Scores a scene against the training or test views. `downscale` is the factor at which the dataset was
/// loaded, for the record; `perceptual` holds what LPIPS needs, by default nothing.
///
/// # Errors
/// When there are no such views, or a kernel refuses its input.
pub fn evaluate<'a>(
    scored: impl Into<Scored<'a>>,
    dataset: &Dataset,
    partition: Partition,
    downscale: f64,
    perceptual: &Perceptual,
) -> Result<Evaluation, Error> {
    let views: Vec<&View> = dataset.views_of(partition).collect();
    if views.is_empty() {
        return Err(Error::run(
            &dataset.root,
            format!("expected {partition} views, found none; choose --split or --test-cameras"),
        ));
    }
    evaluate_views(
        scored.into(),
        dataset,
        (partition, &views),
        &mut BTreeMap::new(),
        (downscale, perceptual),
    )
}

/// [`evaluate`] over some of these views, at least one. `masks` holds which pixels move, by camera,
/// and keeps those that are worked out here.
pub(super) fn evaluate_views(
    scored: Scored<'_>,
    dataset: &Dataset,
    (partition, views): (Partition, &[&View]),
    masks: &mut BTreeMap<usize, Vec<bool>>,
    (downscale, perceptual): (f64, &Perceptual),
) -> Result<Evaluation, Error> {
    let first = views[0];
    let Scored {
        scene, background, ..
    } = scored;
    // A group of pictures of a video is decoded once for all of its frames.
    dataset.announce(views.iter().copied());
    // The first rendering pays for what later ones find ready.
    render_timed(scene, &first.camera, first.time, Layer::Full)?;
    let (mut per_view, mut seconds) = (Vec::with_capacity(views.len()), 0.0);
    let mut counts: Option<DecompositionCounts> = None;
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
            *counts.get_or_insert_default() += decomposition_counts(&dynamic.alpha, &truth);
        }
    }
    let (n_static, n_dynamic) = scored.counts;
    let camera = &first.camera;
    Ok(Evaluation {
        partition,
        n_static,
        n_dynamic,
        psnr: mean_of_all(per_view.iter().map(|view| view.psnr)),
        psnr_dynamic: mean_of_some(per_view.iter().filter_map(|view| view.psnr_dynamic)),
        psnr_corrected: mean_of_all(per_view.iter().map(|view| view.psnr_corrected)),
        psnr_dynamic_corrected: mean_of_some(
            per_view
                .iter()
                .filter_map(|view| view.psnr_dynamic_corrected),
        ),
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
            ..MetricSettings::of(background, downscale, [camera.width, camera.height])
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
) -> Result<ViewScores, Error> {
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
    let over_counted = |image: &[f32]| match &counted {
        None => finite(psnr(image, &truth)),
        Some(counted) => masked_psnr(image, &truth, counted).and_then(finite),
    };
    let over_moving = |image: &[f32]| masked_psnr(image, &truth, &moving).and_then(finite);
    let corrected = corrected(&image, &truth, counted.as_deref());
    Ok(ViewScores {
        camera: view.camera_name.clone(),
        frame: view.frame,
        time: view.time,
        psnr: over_counted(&image),
        psnr_dynamic: over_moving(&image),
        psnr_corrected: over_counted(&corrected),
        psnr_dynamic_corrected: over_moving(&corrected),
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
) -> Result<Vec<bool>, Error> {
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
