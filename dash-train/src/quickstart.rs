//! The quick start: a synthetic clip, trained, scored, and shown in pictures and a video.

use std::path::Path;

use crate::Error;
use crate::dataset::Partition;
use crate::device::DeviceChoice;
use crate::reconstruct::{ReconstructConfig, Reconstruction, reconstruct};
use crate::render::{
    FRAME_RATE, PictureFormat, PictureLayer, RenderJob, spiral_shots, test_shots, write_overview,
    write_pictures, write_video,
};
use crate::synth::{self, SceneKind, SynthConfig};
use crate::train::{Preset, StepReport, TrainConfig};
use crate::video::ffmpeg_available;

/// Frames of the video along a path between the cameras.
const VIDEO_FRAMES: usize = 60;

/// What [`quickstart`] trains, and how.
#[derive(Debug, Clone)]
pub struct QuickstartConfig {
    /// The scene.
    pub scene: SceneKind,
    /// Where to compute.
    pub device: DeviceChoice,
    /// The training.
    pub train: TrainConfig,
}

impl Default for QuickstartConfig {
    fn default() -> Self {
        Self {
            scene: SceneKind::default(),
            device: DeviceChoice::Auto,
            train: TrainConfig::preset(Preset::Quick),
        }
    }
}

/// Writes a synthetic clip to `out/data`, trains on it, scores the camera that was held out, and writes pictures and,
/// where ffmpeg is there, a video to `out/run`.
///
/// `on_step` is called after every step with the seconds trained so far.
///
/// # Errors
/// When `out` holds files already or can't be written, the device is missing, or training fails.
pub fn quickstart(
    out: &Path,
    config: &QuickstartConfig,
    on_step: &mut dyn FnMut(&StepReport, f64),
) -> Result<Reconstruction, Error> {
    let data = out.join("data");
    let clip = SynthConfig {
        scene: config.scene,
        ..SynthConfig::default()
    };
    let written = synth::write(&data, &clip)?;
    tracing::info!("{written}");
    let train = ReconstructConfig {
        device: config.device,
        train: config.train.clone(),
        ..ReconstructConfig::default()
    };
    let done = reconstruct(&data, &out.join("run"), &train, on_step)?;
    show(&done)?;
    Ok(done)
}

/// Pictures of the test views by layer, an overview and a video.
fn show(done: &Reconstruction) -> Result<(), Error> {
    let (scene, root) = (&done.scene, done.run.root());
    let layers = [
        PictureLayer::Full,
        PictureLayer::Static,
        PictureLayer::Dynamic,
        PictureLayer::Depth,
    ];
    let pictures = RenderJob {
        scene,
        shots: &test_shots(&done.dataset),
        on_shot: &mut |_| {},
    };
    write_pictures(pictures, &layers, PictureFormat::Png, &root.join("renders"))?;
    let views: Vec<_> = done.dataset.views_of(Partition::Test).collect();
    write_overview(scene, &views, &root.join("overview.png"))?;
    if ffmpeg_available() {
        let video = RenderJob {
            scene,
            shots: &spiral_shots(&done.dataset, VIDEO_FRAMES),
            on_shot: &mut |_| {},
        };
        write_video(
            video,
            PictureLayer::Full,
            FRAME_RATE,
            &root.join("spiral.mp4"),
        )?;
    } else {
        tracing::warn!("no ffmpeg on this machine: no video");
    }
    Ok(())
}
