//! The cameras of a synchronised rig: where their frames are, and the step from them to views.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use super::broken::{first_size, note};
use super::decode::turned;
use super::distortion::Distortion;
use super::plan::{Context, Lens, PlannedView};
use super::view::{Partition, View};
use super::{DatasetError, files, frame_time, frames, recordings, times};

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
    /// The digits of the label that number the frame, without leading zeros.
    digits: Option<String>,
}

/// A camera's images by frame; `None` where it lacks one.
type Row<'a> = Vec<Option<&'a FrameFile>>;

impl FrameFile {
    /// A camera's frames, called by their files' stems.
    pub(super) fn by_stems(files: Vec<PathBuf>) -> Vec<Self> {
        let labels = files.iter().map(|file| files::stem(file)).collect();
        Self::labelled(files, labels)
    }

    /// A camera's frames with these labels.
    pub(super) fn labelled(files: Vec<PathBuf>, labels: Vec<String>) -> Vec<Self> {
        let numbers = files::frame_numbers(&labels);
        files
            .into_iter()
            .zip(labels)
            .zip(numbers)
            .map(|((file, label), digits)| Self {
                file,
                label,
                digits,
            })
            .collect()
    }

    /// The frame's number, where its name has one.
    pub(super) fn number(&self) -> Option<u64> {
        self.digits.as_ref()?.parse().ok()
    }

    /// The label and which of its digits are taken for the frame's number, for errors.
    fn described(&self) -> String {
        match &self.digits {
            Some(digits) => format!("{} (frame {digits})", self.label),
            None => self.label.clone(),
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
    let rows = match check_frames(cameras, &lists) {
        Ok(()) => lists.iter().map(|l| l.iter().map(Some).collect()).collect(),
        Err(error) if !context.options.skip_broken => return Err(error),
        Err(error) => {
            let Some(rows) = by_numbers(&lists) else {
                return Err(error);
            };
            warn_of_missing(cameras, &rows);
            if let Some(broken) = &context.broken {
                note(broken, error);
            }
            rows
        }
    };
    let frames = || {
        let n_frames = rows.first().map_or(0, Vec::len);
        (0..n_frames).map(|place| rows.iter().find_map(|row| row[place]))
    };
    let numbers: Vec<Option<u64>> = frames().map(|frame| frame?.number()).collect();
    let or_places = (0..).zip(&numbers).map(|(place, n)| n.unwrap_or(place));
    let wanted = context.options.wanted(&or_places.collect::<Vec<u64>>())?;
    let stated: Option<Vec<u64>> = wanted.iter().map(|&place| numbers[place]).collect();
    let times = stated.and_then(|numbers| times::of_numbers(&numbers));
    let n_frames = wanted.len();
    let times = times.unwrap_or_else(|| (0..n_frames).map(|k| frame_time(k, n_frames)).collect());
    let wanted: Vec<(usize, f32)> = wanted.into_iter().zip(times).collect();
    let planned = plan(context, cameras, &rows, &wanted, held_out)?;
    Ok((context.load_views(planned)?, n_frames))
}

/// The frames that any camera has, by their numbers; `None` where images have no numbers of their own, or a camera's
/// are mostly other ones than all others'.
fn by_numbers<'a>(lists: &[&'a [FrameFile]]) -> Option<Vec<Row<'a>>> {
    let mut cameras: Vec<BTreeMap<u64, &FrameFile>> = Vec::with_capacity(lists.len());
    let mut n_of: BTreeMap<u64, usize> = BTreeMap::new();
    for list in lists {
        let mut own = BTreeMap::new();
        for frame in *list {
            let number = frame.number()?;
            if own.insert(number, frame).is_some() {
                return None;
            }
            *n_of.entry(number).or_default() += 1;
        }
        cameras.push(own);
    }
    let is_shared = |number: &&u64| n_of[*number] > 1;
    let fits = |own: &BTreeMap<u64, _>| 2 * own.keys().filter(is_shared).count() >= own.len();
    cameras.iter().all(fits).then(|| {
        let row = |own: &BTreeMap<u64, &'a FrameFile>| -> Row<'a> {
            n_of.keys().map(|number| own.get(number).copied()).collect()
        };
        cameras.iter().map(row).collect()
    })
}

fn warn_of_missing(cameras: &[RigCamera], rows: &[Row]) {
    for (camera, row) in cameras.iter().zip(rows) {
        let n_missing = row.iter().filter(|frame| frame.is_none()).count();
        if n_missing > 0 {
            tracing::warn!(
                "{}: {n_missing} of {} frames are missing",
                camera.source.path.display(),
                row.len()
            );
        }
    }
}

/// Every camera must have the same frames, or times would be mixed up between cameras.
fn check_frames(cameras: &[RigCamera], lists: &[&[FrameFile]]) -> Result<(), DatasetError> {
    let Some((first, expected)) = cameras.first().zip(lists.first()) else {
        return Ok(());
    };
    for (camera, list) in cameras.iter().zip(lists) {
        let source = &camera.source;
        let repeated =
            |pair: &[FrameFile]| pair[0].digits.is_some() && pair[0].digits == pair[1].digits;
        if let Some(pair) = list.windows(2).find(|pair| repeated(pair)) {
            return Err(DatasetError::invalid(
                &source.path,
                "one image per frame",
                format!(
                    "{} twice (as {} too)",
                    pair[0].file.display(),
                    pair[1].described()
                ),
                "remove the duplicate, or number the files so that each frame has digits of its own",
            ));
        }
        same_count(&first.source, expected.len(), source, list.len())?;
        let differs = |(a, b): &(&FrameFile, &FrameFile)| a.digits != b.digits;
        if let Some((wanted, found)) = expected.iter().zip(*list).find(differs) {
            return Err(DatasetError::invalid(
                &source.path,
                format!(
                    "the frames of {}, the next being {}",
                    first.source.name,
                    wanted.described()
                ),
                found.described(),
                "give every camera the same frame numbers, or leave out what one lacks (--skip-broken)",
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
        format!(
            "{expected} frames, as many as {} has{}",
            first.name,
            files::unread_images(&first.path)
        ),
        format!("{found}{}", files::unread_images(&source.path)),
        "give every camera the same frames, or leave out what one lacks (--skip-broken)",
    ))
}

/// The views of all cameras at the wanted frames, each a place in the rows and a time.
fn plan(
    context: &Context,
    cameras: &[RigCamera],
    rows: &[Row],
    wanted: &[(usize, f32)],
    held_out: &[bool],
) -> Result<Vec<PlannedView>, DatasetError> {
    let mut planned = Vec::new();
    for (camera_index, (rig_camera, row)) in cameras.iter().zip(rows).enumerate() {
        let files = wanted.iter().filter_map(|&(place, _)| row[place]);
        let mut files = files.map(|frame| frame.file.as_path()).peekable();
        let Some(&first) = files.peek() else {
            continue;
        };
        let Some(size) = first_size(context, files) else {
            continue;
        };
        let (camera, lens) = at_size(rig_camera, size?, first)?;
        let camera_name = &rig_camera.source.name;
        for (frame, &(place, time)) in wanted.iter().enumerate() {
            let Some(image) = row[place] else { continue };
            planned.push(PlannedView {
                source: frames::Source::File(image.file.clone()),
                name: format!("{camera_name}/{}", image.label),
                camera_name: camera_name.clone(),
                camera_index,
                frame,
                time,
                partition: Partition::held_out(held_out[camera_index]),
                camera: camera.clone(),
                lens: lens.clone(),
                mask: None,
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
        let turned = if has_shape_of(camera, (height, width)) {
            turned(path)
        } else {
            String::new()
        };
        return Err(DatasetError::invalid(
            path,
            format!(
                "frames shaped like the {}x{} of {}",
                camera.width,
                camera.height,
                posed_by.to_string_lossy()
            ),
            format!("{width}x{height}{turned}"),
            "use uncropped frames, or correct height, width and focal length in the poses",
        ));
    }
    Ok(camera.resized(width, height))
}
