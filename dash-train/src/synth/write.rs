//! Renders a clip and writes it as a dataset, whole or not at all.

use super::cloud::{cloud, cloud_size};
use super::config::SynthConfig;
use super::files;
use super::render::render_over;
use super::rendered::{Rendered, Rest};
use super::rig::rig;
use super::scene::Scene;
use super::truth::{Truth, ViewStats};
use crate::Error;
use crate::files::free_parent;
use crate::video::{VideoWriter, ffmpeg_program};
use dash_kernels::Camera;
use dash_model::unfinished::{Unfinished, create_dir_all};
use image::ExtendedColorType;
use rayon::prelude::*;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

/// What was written.
#[derive(Debug, Clone, PartialEq)]
pub struct SynthSummary {
    /// The dataset's folder.
    pub path: PathBuf,
    /// Number of cameras.
    pub cameras: usize,
    /// Number of frames of each.
    pub frames: usize,
    /// Points in the cloud.
    pub points: usize,
    /// Share of moving pixels over all views.
    pub moving_share: f64,
}

impl fmt::Display for SynthSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: {} cameras x {} frames, {} points, {:.2} % of the pixels move",
            self.path.display(),
            self.cameras,
            self.frames,
            self.points,
            100.0 * self.moving_share
        )
    }
}

/// Renders the configured clip and writes it to the folder `out`.
///
/// `out` appears when everything is written: a failure leaves nothing behind. The same
/// configuration gives the same bytes, whatever the number of threads.
///
/// # Errors
/// A setting out of range, an `out` that exists and is not an empty folder, a folder that can't
/// be written, or a missing ffmpeg when videos are asked for.
///
/// ```
/// use dash_train::synth::{SceneKind, SynthConfig, write};
///
/// let folder = tempfile::tempdir()?;
/// let clip = folder.path().join("clip");
/// let config = SynthConfig {
///     scene: SceneKind::Static,
///     cameras: 3,
///     frames: 1,
///     width: 32,
///     height: 24,
///     ..Default::default()
/// };
/// write(&clip, &config)?;
/// assert!(clip.join("poses_bounds.npy").exists());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write(out: &Path, config: &SynthConfig) -> Result<SynthSummary, Error> {
    write_with(out, config, &ffmpeg_program().to_string_lossy())
}

pub(super) fn write_with(
    out: &Path,
    config: &SynthConfig,
    ffmpeg: &str,
) -> Result<SynthSummary, Error> {
    config.validate()?;
    let config = &config.as_written();
    let parent = free_parent(out)?;
    if config.video {
        files::check_ffmpeg(ffmpeg)?;
    }
    fs::create_dir_all(&parent).map_err(Error::write(&parent, "create the folder"))?;
    // A sibling of `out`, on the same file system: the rename at the end is one step.
    let scratch =
        Unfinished::folder(out).map_err(Error::write(&parent, "create a scratch folder in it"))?;
    let root = scratch.path().to_path_buf();

    let scene = Scene::new(config.scene, config.seed, config.width, config.height);
    let cameras = rig(config.cameras, config.width, config.height);
    let stats = write_frames(&root, config, &scene, &cameras, ffmpeg)?;
    config
        .layout
        .write_cameras(&root, config, &cameras, &stats)?;
    let count = cloud_size(config.width, config.height);
    let points = cloud(&scene, &cameras, count, config.seed);
    config.layout.write_cloud(&root, &points)?;
    let truth = Truth::new(config, &scene, &cameras, &stats);
    files::write_json(&root.join("truth.json"), &truth)?;

    scratch.finish(|root| {
        if out.exists() {
            // Not every system renames over an empty folder.
            fs::remove_dir(out).map_err(Error::write(out, "replace the empty folder"))?;
        }
        fs::rename(root, out).map_err(Error::write(out, "move the finished dataset there"))
    })?;
    Ok(SynthSummary {
        path: out.to_path_buf(),
        cameras: config.cameras,
        frames: config.frames,
        points: points.len(),
        moving_share: truth.moving_share,
    })
}

/// Renders and writes the frames and masks of all cameras.
///
/// Frame by frame, for as many cameras at a time as there are threads: each camera's video takes
/// its frames in order, and memory holds one frame of each of these cameras.
fn write_frames(
    root: &Path,
    config: &SynthConfig,
    scene: &Scene,
    cameras: &[Camera],
    ffmpeg: &str,
) -> Result<Vec<ViewStats>, Error> {
    let mut stats = Vec::with_capacity(cameras.len());
    let n_together = rayon::current_num_threads().max(1);
    for (chunk, cameras) in cameras.chunks(n_together).enumerate() {
        let mut clips = cameras
            .par_iter()
            .enumerate()
            .map(|(i, camera)| {
                let index = chunk * n_together + i;
                Clip::new(root, config, scene, index, camera, ffmpeg)
            })
            .collect::<Result<Vec<Clip>, Error>>()?;
        for frame in 0..config.frames {
            clips
                .par_iter_mut()
                .try_for_each(|clip| clip.write_frame(root, config, scene, frame))?;
        }
        for clip in clips {
            stats.push(clip.finish(config)?);
        }
    }
    Ok(stats)
}

/// What one camera sees, while it is written.
struct Clip<'a> {
    index: usize,
    camera: &'a Camera,
    has_rest: bool,
    /// What rests, and whether the lamp is on in it.
    rest: Option<(bool, Rest)>,
    view: Rendered,
    video: Option<VideoWriter>,
    /// Sum over the frames so far.
    moving_share: f64,
    depth_range: [f64; 2],
}

impl<'a> Clip<'a> {
    fn new(
        root: &Path,
        config: &SynthConfig,
        scene: &Scene,
        index: usize,
        camera: &'a Camera,
        ffmpeg: &str,
    ) -> Result<Self, Error> {
        let video = if config.video {
            let path = root.join(config.layout.video_path(index));
            let folder = path.parent().unwrap_or(root);
            create_dir_all(folder).map_err(Error::write(folder, "create the folder"))?;
            let size = [config.width, config.height];
            Some(files::video_writer(ffmpeg, &path, size)?)
        } else {
            None
        };
        // Where everything moves there is no rest to share between frames.
        let has_rest = scene.objects.iter().any(|object| !scene.changes(object));
        Ok(Self {
            index,
            camera,
            has_rest,
            rest: None,
            view: Rendered::empty(camera),
            video,
            moving_share: 0.0,
            depth_range: [f64::INFINITY, 0.0],
        })
    }

    fn write_frame(
        &mut self,
        root: &Path,
        config: &SynthConfig,
        scene: &Scene,
        frame: usize,
    ) -> Result<(), Error> {
        let time = config.time(frame);
        let is_lit = scene.is_lit(time);
        let is_other = |(lit, _): &(bool, Rest)| *lit != is_lit;
        if self.has_rest && self.rest.as_ref().is_none_or(is_other) {
            self.rest = Some((is_lit, Rest::new(scene, self.camera, time)));
        }
        let view = &mut self.view;
        let rest = self.rest.as_ref().map(|(_, rest)| rest);
        render_over(scene, self.camera, time, rest, view);
        let size = [config.width, config.height];
        if let Some(video) = &mut self.video {
            video.push(&view.rgb).map_err(Error::synth_video)?;
        } else {
            let path = config.layout.image_path(self.index, frame, config.frames);
            files::write_png(&root.join(path), &view.rgb, size, ExtendedColorType::Rgb8)?;
        }
        let mask: Vec<u8> = view
            .moving
            .iter()
            .map(|&moving| if moving { 255 } else { 0 })
            .collect();
        let path = config.layout.mask_path(self.index, frame, config.frames);
        files::write_png(&root.join(path), &mask, size, ExtendedColorType::L8)?;
        self.moving_share += view.moving_share();
        let [near, far] = depth_range(view);
        self.depth_range = [self.depth_range[0].min(near), self.depth_range[1].max(far)];
        Ok(())
    }

    fn finish(self, config: &SynthConfig) -> Result<ViewStats, Error> {
        if let Some(video) = self.video {
            video.finish().map_err(Error::synth_video)?;
        }
        Ok(ViewStats {
            moving_share: self.moving_share / config.frames as f64,
            depth_range: self.depth_range,
        })
    }
}

fn depth_range(view: &Rendered) -> [f64; 2] {
    view.depth
        .iter()
        .map(|&depth| f64::from(depth))
        .filter(|depth| depth.is_finite())
        .fold([f64::INFINITY, 0.0], |[near, far], depth| {
            [near.min(depth), far.max(depth)]
        })
}
