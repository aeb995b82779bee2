//! Frames of all cameras at the same times, as numbered images.

use std::fs;
use std::path::{Path, PathBuf};

use dash_model::unfinished::create_dir_all;
use rayon::prelude::*;

use super::schedule::{Schedule, Timeline};
use super::sources::{Recording, Source, image_times};
use crate::Error;
use crate::dataset::pixels::dimensions;
use crate::dataset::pixels::shrink::write_resized;
use crate::files;
use crate::video::{Selection, frame_times, refusal, write_frames};

/// Size of a file that a disk takes which is not full.
const PROBE_BYTES: usize = 1 << 16;

/// How large the frames are to be.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum FrameSize {
    /// As they were recorded.
    #[default]
    Recorded,
    /// At most this many pixels high.
    Height(usize),
    /// Width and height divided by this; at least 1.
    Downscale(f64),
}

impl FrameSize {
    /// The width and height of frames that were recorded at `[width, height]`.
    pub(super) fn of(self, [width, height]: [usize; 2]) -> [usize; 2] {
        let factor = match self {
            Self::Recorded => return [width, height],
            Self::Height(wanted) => height as f64 / wanted as f64,
            Self::Downscale(factor) => factor,
        };
        if factor <= 1.0 {
            return [width, height];
        }
        [width, height].map(|side| (side as f64 / factor).round().max(1.0) as usize)
    }
}

/// When each camera recorded its frames. `image_rate` is that of folders of images.
pub(super) fn timelines(
    sources: &[Source],
    offsets: &[f64],
    image_rate: f64,
) -> Result<Vec<Timeline>, Error> {
    let images: Vec<&[PathBuf]> = sources
        .iter()
        .filter_map(|source| match &source.recording {
            Recording::Images(images) => Some(images.as_slice()),
            Recording::Video(_) => None,
        })
        .collect();
    let mut of_images = image_times(&images, image_rate).into_iter();
    let lists: Vec<Option<Vec<f64>>> = sources
        .iter()
        .map(|source| match source.recording {
            Recording::Images(_) => of_images.next(),
            Recording::Video(_) => None,
        })
        .collect();
    sources
        .par_iter()
        .zip(lists)
        .zip(offsets)
        .map(|((source, list), &offset)| {
            let times = match (list, &source.recording) {
                (Some(times), _) => times,
                (None, Recording::Video(video)) => {
                    frame_times(video).map_err(Error::of_recording)?
                }
                (None, Recording::Images(_)) => Vec::new(),
            };
            Ok(Timeline { times, offset })
        })
        .collect()
}

/// Each camera's first frame at its full size, as `folder/0000.png`, `0001.png` .. (or with the extension
/// of the image it is), in the cameras' order.
pub(super) fn first_frames(
    sources: &[Source],
    timelines: &[Timeline],
    schedule: &Schedule,
    folder: &Path,
) -> Result<Vec<PathBuf>, Error> {
    create_dir_all(folder).map_err(Error::access(folder))?;
    sources
        .par_iter()
        .zip(timelines)
        .enumerate()
        .map(|(index, (source, timeline))| match &source.recording {
            Recording::Images(images) => {
                let image = &images[timeline.nearest(schedule.start)];
                let to = folder.join(format!("{index:04}.{}", extension(image)));
                copy(image, &to)?;
                Ok(to)
            }
            Recording::Video(video) => {
                let own = folder.join(format!("{index:04}"));
                fs::create_dir(&own).map_err(Error::access(&own))?;
                extract(video, &own, &selection(timeline, schedule, 1, None))?;
                let (from, to) = (own.join("0000.png"), folder.join(format!("{index:04}.png")));
                if !from.is_file() {
                    return Err(no_frame(video, schedule.start));
                }
                fs::rename(&from, &to).map_err(Error::access(&to))?;
                fs::remove_dir(&own).map_err(Error::access(&own))?;
                Ok(to)
            }
        })
        .collect()
}

/// Writes every camera's frames to `dataset/NAME/images/0000.png` and so on. Returns equally many for each camera,
/// fewer than planned if a video ends early, and the index of the camera with the fewest.
pub(super) fn write_all(
    sources: &[Source],
    timelines: &[Timeline],
    schedule: &Schedule,
    sizes: &[[usize; 2]],
    recorded_sizes: &[[usize; 2]],
    dataset: &Path,
) -> Result<(Vec<Vec<PathBuf>>, usize), Error> {
    let mut cameras = (0..sources.len())
        .into_par_iter()
        .map(|index| {
            let folder = dataset.join(&sources[index].name).join("images");
            create_dir_all(&folder).map_err(Error::access(&folder))?;
            let size = (sizes[index] != recorded_sizes[index]).then_some(sizes[index]);
            let timeline = &timelines[index];
            match &sources[index].recording {
                Recording::Images(images) => copy_images(images, timeline, schedule, size, &folder),
                Recording::Video(video) => {
                    let selection = selection(timeline, schedule, schedule.n_frames, size);
                    extract(video, &folder, &selection)?;
                    let frames = files::list_images(&folder)?;
                    if frames.is_empty() {
                        return Err(no_frame(video, schedule.start));
                    }
                    Ok(frames)
                }
            }
        })
        .collect::<Result<Vec<Vec<PathBuf>>, Error>>()?;
    let lengths = cameras.iter().map(Vec::len).enumerate();
    let (shortest, n_frames) = lengths.min_by_key(|(_, n)| *n).unwrap_or((0, 0));
    for frames in &mut cameras {
        for extra in frames.drain(n_frames..) {
            fs::remove_file(&extra).map_err(Error::access(&extra))?;
        }
    }
    Ok((cameras, shortest))
}

fn copy_images(
    images: &[PathBuf],
    timeline: &Timeline,
    schedule: &Schedule,
    size: Option<[usize; 2]>,
    folder: &Path,
) -> Result<Vec<PathBuf>, Error> {
    (0..schedule.n_frames)
        .into_par_iter()
        .map(|frame| {
            let image = &images[timeline.nearest(schedule.time(frame))];
            let extension = match size {
                Some(_) => "png".into(),
                None => extension(image),
            };
            let to = folder.join(format!("{frame:04}.{extension}"));
            match size {
                Some(size) => write_resized(image, &to, size)?,
                None => copy(image, &to)?,
            }
            Ok(to)
        })
        .collect()
}

/// Width and height of images.
pub(super) fn sizes(images: &[PathBuf]) -> Result<Vec<[usize; 2]>, Error> {
    images
        .iter()
        .map(|image| dimensions(image).map(|(width, height)| [width, height]))
        .collect()
}

/// Writes frames of a video. Where that fails, the folder may be at fault, not the video.
fn extract(video: &Path, folder: &Path, selection: &Selection) -> Result<(), Error> {
    let Err(error) = write_frames(video, folder, selection) else {
        return Ok(());
    };
    let said = match &error {
        Error::VideoDecode { reason, .. } => refusal(reason),
        _ => None,
    };
    let probe = folder.join("probe");
    let refused = fs::write(&probe, vec![0; PROBE_BYTES]).err().or(said);
    // It may not exist.
    let _ = fs::remove_file(&probe);
    Err(match refused {
        Some(source) => Error::access(folder)(source),
        None => error.of_recording(),
    })
}

/// Copies a file; the error names the one that was refused.
fn copy(from: &Path, to: &Path) -> Result<(), Error> {
    let bytes = fs::read(from).map_err(Error::access(from))?;
    fs::write(to, bytes).map_err(Error::access(to))
}

fn selection(
    timeline: &Timeline,
    schedule: &Schedule,
    n_frames: usize,
    size: Option<[usize; 2]>,
) -> Selection {
    Selection {
        start: schedule.start + timeline.offset,
        fps: schedule.fps,
        n_frames,
        period: timeline.period().unwrap_or(1.0 / schedule.fps),
        size,
    }
}

fn extension(image: &Path) -> String {
    image
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_ascii_lowercase()
}

fn no_frame(video: &Path, time: f64) -> Error {
    Error::invalid(
        video,
        format!("a frame at {time:.3} s"),
        "none that could be decoded",
        "replace the video, or choose another range with --start and --end",
    )
}
