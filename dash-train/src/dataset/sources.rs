//! The cameras of a synchronised rig: where their frames are, and the step from them to views.

use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use super::broken::first_size;
use super::distortion::Distortion;
use super::plan::{Context, Lens, PlannedView};
use super::view::{Split, View};
use super::{DatasetError, files, frame_time, frames, recordings};

/// Frames may differ from the poses' aspect ratio by this much and one pixel.
const ASPECT_TOLERANCE: f64 = 0.01;
/// Extensions of videos.
pub(super) const VIDEO_EXTENSIONS: [&str; 5] = ["mp4", "mov", "mkv", "webm", "avi"];

/// Where a camera's frames are.
#[derive(Debug, Clone)]
pub(super) enum Frames {
    /// One file per frame, in order.
    Images(Vec<FrameFile>),
    Video,
}

/// One frame's image and what it is called: its file's stem, or less where that says more.
#[derive(Debug, Clone)]
pub(super) struct FrameFile {
    pub(super) file: PathBuf,
    pub(super) label: String,
}

impl FrameFile {
    /// Frames called by their files' stems.
    pub(super) fn by_stems(files: Vec<PathBuf>) -> Vec<Self> {
        files
            .into_iter()
            .map(|file| Self {
                label: files::stem(&file),
                file,
            })
            .collect()
    }

    /// The frame's number, where its name has one.
    pub(super) fn number(&self) -> Option<u64> {
        match files::frame_number(&self.label)? {
            "" => Some(0),
            digits => digits.parse().ok(),
        }
    }
}

/// A camera without its pose.
#[derive(Debug, Clone)]
pub(super) struct Source {
    pub(super) name: String,
    /// The video, or the folder of the images.
    pub(super) path: PathBuf,
    pub(super) frames: Frames,
}

impl Source {
    fn images(&self) -> Option<&[FrameFile]> {
        match &self.frames {
            Frames::Images(images) => Some(images),
            Frames::Video => None,
        }
    }
}

/// A camera with its pose.
#[derive(Debug, Clone)]
pub(super) struct RigCamera {
    pub(super) source: Source,
    /// At the size at which the pose was estimated; frames may have another.
    pub(super) camera: Camera,
    pub(super) distortion: Distortion,
    /// The file with the pose, for errors.
    pub(super) posed_by: PathBuf,
}

/// The views of all cameras at all wanted frames, camera by camera, and the number of frames.
///
/// # Errors
/// When cameras differ in their frames, a frame in its shape from the poses, or one is damaged.
pub(super) fn load(
    context: &Context,
    cameras: &[RigCamera],
    held_out: &[bool],
) -> Result<(Vec<View>, usize), DatasetError> {
    let lists: Option<Vec<&[FrameFile]>> = cameras.iter().map(|c| c.source.images()).collect();
    let Some(lists) = lists else {
        let (planned, n_frames) = recordings::plan(context, cameras, held_out)?;
        return Ok((context.load_views(planned)?, n_frames));
    };
    check_frames(cameras, &lists)?;
    let numbers: Vec<u64> = lists.first().map_or_else(Vec::new, |list| {
        (0..)
            .zip(*list)
            .map(|(place, frame)| frame.number().unwrap_or(place))
            .collect()
    });
    let wanted = context.options.wanted(&numbers)?;
    let n_frames = wanted.len();
    let planned = plan(context, cameras, &lists, &wanted, held_out)?;
    Ok((context.load_views(planned)?, n_frames))
}

/// Every camera must have the same frames, or times would be mixed up between cameras.
fn check_frames(cameras: &[RigCamera], lists: &[&[FrameFile]]) -> Result<(), DatasetError> {
    let Some((first, expected)) = cameras.first().zip(lists.first()) else {
        return Ok(());
    };
    for (camera, list) in cameras.iter().zip(lists) {
        let source = &camera.source;
        let number = |frame: &'_ FrameFile| files::frame_number(&frame.label).map(str::to_string);
        let repeated = |pair: &[FrameFile]| {
            let number = number(&pair[0]);
            number.is_some() && number == files::frame_number(&pair[1].label).map(str::to_string)
        };
        if let Some(pair) = list.windows(2).find(|pair| repeated(pair)) {
            return Err(DatasetError::invalid(
                &source.path,
                "one image per frame",
                format!(
                    "{} twice (as {} too)",
                    pair[0].file.display(),
                    pair[1].label
                ),
                "remove the duplicate",
            ));
        }
        same_count(&first.source, expected.len(), source, list.len())?;
        let differs = |(a, b): &(&FrameFile, &FrameFile)| number(a) != number(b);
        if let Some((wanted, found)) = expected.iter().zip(*list).find(differs) {
            return Err(DatasetError::invalid(
                &source.path,
                format!(
                    "the frames of {}, the next being {}",
                    first.source.name, wanted.label
                ),
                found.label.clone(),
                "give every camera the same frame numbers",
            ));
        }
    }
    Ok(())
}

pub(super) fn same_count(
    first: &Source,
    expected: usize,
    source: &Source,
    found: usize,
) -> Result<(), DatasetError> {
    if found == expected {
        return Ok(());
    }
    Err(DatasetError::invalid(
        &source.path,
        format!("{expected} frames, as many as {} has", first.name),
        found.to_string(),
        "give every camera the same frames, or leave out what a damaged video lacks (--skip-broken)",
    ))
}

fn plan(
    context: &Context,
    cameras: &[RigCamera],
    lists: &[&[FrameFile]],
    wanted: &[usize],
    held_out: &[bool],
) -> Result<Vec<PlannedView>, DatasetError> {
    let mut planned = Vec::new();
    for (camera_index, (rig_camera, images)) in cameras.iter().zip(lists).enumerate() {
        let kept: Vec<&FrameFile> = wanted.iter().map(|&place| &images[place]).collect();
        let (Some(first), Some(size)) = (
            kept.first(),
            first_size(context, kept.iter().map(|frame| frame.file.as_path())),
        ) else {
            continue;
        };
        let (camera, lens) = at_size(rig_camera, size?, &first.file)?;
        let camera_name = &rig_camera.source.name;
        for (frame, image) in kept.iter().enumerate() {
            planned.push(PlannedView {
                source: frames::Source::File(image.file.clone()),
                name: format!("{camera_name}/{}", image.label),
                camera_name: camera_name.clone(),
                camera_index,
                frame,
                time: frame_time(frame, kept.len()),
                split: Split::held_out(held_out[camera_index]),
                camera: camera.clone(),
                lens: lens.clone(),
            });
        }
    }
    Ok(planned)
}

/// The camera at the frames' size, which may be another than the poses were estimated at.
pub(super) fn at_size(
    rig_camera: &RigCamera,
    (width, height): (usize, usize),
    path: &Path,
) -> Result<(Camera, Option<Lens>), DatasetError> {
    let RigCamera {
        camera, posed_by, ..
    } = rig_camera;
    let camera = resized(camera, (width, height), path, posed_by)?;
    let lens = Lens::new(rig_camera.distortion, &camera, posed_by)?;
    Ok((camera, lens))
}

/// Whether pictures of this size are shaped like the camera's.
pub(super) fn has_shape_of(camera: &Camera, (width, height): (usize, usize)) -> bool {
    let expected_height = width as f64 * camera.height as f64 / camera.width as f64;
    (height as f64 - expected_height).abs() <= 1.0 + ASPECT_TOLERANCE * expected_height
}

/// The camera at another size of the same shape; errors name the image `path` and the poses' file.
pub(super) fn resized(
    camera: &Camera,
    (width, height): (usize, usize),
    path: &Path,
    posed_by: &Path,
) -> Result<Camera, DatasetError> {
    if !has_shape_of(camera, (width, height)) {
        let posed_by = posed_by.file_name().unwrap_or(posed_by.as_os_str());
        return Err(DatasetError::invalid(
            path,
            format!(
                "frames shaped like the {}x{} of {}",
                camera.width,
                camera.height,
                posed_by.to_string_lossy()
            ),
            format!("{width}x{height}"),
            "use uncropped frames, or correct height, width and focal length in the poses",
        ));
    }
    Ok(camera.resized(width, height))
}
