//! Renders a clip and writes it as a dataset, whole or not at all.

use super::SynthError;
use super::cloud::{cloud, cloud_size};
use super::config::SynthConfig;
use super::files;
use super::render::{Rendered, render_over, render_rest};
use super::rig::rig;
use super::scene::Scene;
use super::truth::{Truth, ViewStats};
use crate::video::ffmpeg_program;
use dash_kernels::Camera;
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
pub fn write(out: &Path, config: &SynthConfig) -> Result<SynthSummary, SynthError> {
    write_with(out, config, &ffmpeg_program().to_string_lossy())
}

pub(super) fn write_with(
    out: &Path,
    config: &SynthConfig,
    ffmpeg: &str,
) -> Result<SynthSummary, SynthError> {
    config.validate()?;
    let config = &config.as_written();
    let parent = check_output(out)?;
    if config.video {
        files::check_ffmpeg(ffmpeg)?;
    }
    fs::create_dir_all(&parent).map_err(SynthError::io(&parent, "create the folder"))?;
    // A sibling of `out`, on the same file system: the rename at the end is one step.
    let scratch = tempfile::Builder::new()
        .prefix(".dash-synth-")
        .tempdir_in(&parent)
        .map_err(SynthError::io(&parent, "create a scratch folder in it"))?;
    // One level down, since the scratch folder itself is closed to other users.
    let root = scratch.path().join("dataset");

    let scene = Scene::new(config.scene, config.seed, config.width, config.height);
    let cameras = rig(config.cameras, config.width, config.height);
    let stats = cameras
        .par_iter()
        .enumerate()
        .map(|(index, camera)| write_camera(&root, config, &scene, index, camera, ffmpeg))
        .collect::<Result<Vec<ViewStats>, SynthError>>()?;
    config
        .layout
        .write_cameras(&root, config, &cameras, &stats)?;
    let count = cloud_size(config.width, config.height);
    let points = cloud(&scene, &cameras, count, config.seed);
    config.layout.write_cloud(&root, &points)?;
    let truth = Truth::new(config, &scene, &cameras, &stats);
    files::write_json(&root.join("truth.json"), &truth)?;

    if out.exists() {
        // Not every system renames over an empty folder.
        fs::remove_dir(out).map_err(SynthError::io(out, "replace the empty folder"))?;
    }
    fs::rename(&root, out).map_err(SynthError::io(out, "move the finished dataset there"))?;
    Ok(SynthSummary {
        path: out.to_path_buf(),
        cameras: config.cameras,
        frames: config.frames,
        points: points.len(),
        moving_share: truth.moving_share,
    })
}

/// Refuses an output that is not free; returns the folder it is to be in.
fn check_output(out: &Path) -> Result<PathBuf, SynthError> {
    let refuse = |found| {
        Err(SynthError::OutputExists {
            path: out.to_path_buf(),
            found,
        })
    };
    if out.file_name().is_none() {
        return Err(SynthError::OutputName {
            path: out.to_path_buf(),
        });
    }
    match fs::symlink_metadata(out) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
        Err(error) => return Err(SynthError::io(out, "look at it")(error)),
        Ok(found) if found.is_symlink() => return refuse("a link"),
        Ok(found) if !found.is_dir() => return refuse("a file"),
        Ok(_) => {
            let mut entries = fs::read_dir(out).map_err(SynthError::io(out, "list the folder"))?;
            if entries.next().is_some() {
                return refuse("a folder with files in it");
            }
        }
    }
    Ok(match out.parent() {
        Some(parent) if parent != Path::new("") => parent.to_path_buf(),
        _ => PathBuf::from("."),
    })
}

/// Renders and writes one camera's frames and masks.
fn write_camera(
    root: &Path,
    config: &SynthConfig,
    scene: &Scene,
    index: usize,
    camera: &Camera,
    ffmpeg: &str,
) -> Result<ViewStats, SynthError> {
    // Where everything moves there is no rest to share between frames.
    let rest = scene
        .objects
        .iter()
        .any(|object| !scene.moves(object))
        .then(|| render_rest(scene, camera));
    let size = [config.width, config.height];
    let video_frames = root.join(format!("cam{index:02}.frames"));
    let per_frame = (0..config.frames)
        .into_par_iter()
        .map(|frame| {
            let view = render_over(scene, camera, config.time(frame), rest.as_ref());
            let image = if config.video {
                video_frames.join(format!("{frame:04}.png"))
            } else {
                root.join(config.layout.image_path(index, frame, config.frames))
            };
            files::write_png(&image, &view.rgb, size, ExtendedColorType::Rgb8)?;
            let mask: Vec<u8> = view
                .moving
                .iter()
                .map(|&m| if m { 255 } else { 0 })
                .collect();
            let path = root.join(config.layout.mask_path(index, frame, config.frames));
            files::write_png(&path, &mask, size, ExtendedColorType::L8)?;
            Ok((view.moving_share(), depth_range(&view)))
        })
        .collect::<Result<Vec<(f64, [f64; 2])>, SynthError>>()?;
    if config.video {
        let video = root.join(config.layout.video_path(index));
        files::write_video(ffmpeg, &video_frames, &video)?;
        fs::remove_dir_all(&video_frames)
            .map_err(SynthError::io(&video_frames, "remove the encoded frames"))?;
    }
    // A sequential sum: the same for any number of threads.
    let moving_share = per_frame.iter().map(|(share, _)| share).sum::<f64>() / config.frames as f64;
    let depth_range = per_frame
        .iter()
        .fold([f64::INFINITY, 0.0], |[near, far], (_, range)| {
            [near.min(range[0]), far.max(range[1])]
        });
    Ok(ViewStats {
        moving_share,
        depth_range,
    })
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
