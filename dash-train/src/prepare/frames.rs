//! Frames of all cameras at the same times, as numbered images.

use std::fs;
use std::path::{Path, PathBuf};

use dash_model::unfinished::create_dir_all;
use image::metadata::Orientation;
use rayon::prelude::*;

use super::schedule::{Schedule, Timeline};
use super::sources::{Recording, Source, image_times};
use crate::Error;
use crate::dataset::pixels::decode::orientation;
use crate::dataset::pixels::dimensions;
use crate::dataset::pixels::shrink::write_upright;
use crate::video::{VideoIndex, write_frames};

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

/// A camera's pictures.
pub(super) enum Pictures<'a> {
    /// Frames of a video.
    Video(Box<VideoIndex>),
    /// Image files.
    Images(&'a [PathBuf]),
}

/// When each camera recorded its pictures, and where they are. `image_rate` is that of folders of images.
pub(super) fn recorded<'a>(
    sources: &'a [Source],
    offsets: &[f64],
    image_rate: f64,
) -> Result<(Vec<Timeline>, Vec<Pictures<'a>>), Error> {
    let images: Vec<&[PathBuf]> = sources
        .iter()
        .filter_map(|source| match &source.recording {
            Recording::Images(images) => Some(images.as_slice()),
            Recording::Video(_) => None,
        })
        .collect();
    let mut of_images = image_times(&images, image_rate).into_iter();
    let lists: Vec<Vec<f64>> = sources
        .iter()
        .map(|source| match source.recording {
            Recording::Images(_) => of_images.next().unwrap_or_default(),
            Recording::Video(_) => Vec::new(),
        })
        .collect();
    let recorded = sources.par_iter().zip(lists).zip(offsets);
    let recorded = recorded.map(|((source, times), &offset)| {
        Ok(match &source.recording {
            Recording::Images(images) => (
                Timeline::of_images(times, offset),
                Pictures::Images(images.as_slice()),
            ),
            Recording::Video(video) => {
                let video = VideoIndex::read(video, false).map_err(Error::of_recording)?;
                (of_video(&video, offset), Pictures::Video(Box::new(video)))
            }
        })
    });
    let recorded = recorded.collect::<Result<Vec<_>, Error>>()?;
    Ok(recorded.into_iter().unzip())
}

/// Times from the first frame on, since where a file's clock begins depends on the program that wrote it.
fn of_video(video: &VideoIndex, offset: f64) -> Timeline {
    let times = video.times();
    let first = times.first().copied().unwrap_or(0.0);
    Timeline {
        times: times.iter().map(|time| time - first).collect(),
        rate: video.rate(),
        offset,
    }
}

/// A remark on cameras whose images their EXIF data turn.
pub(super) fn turned(names: &[String], cameras: &[Pictures]) -> Option<String> {
    let is_turned = |pictures: &Pictures| match pictures {
        Pictures::Images(images) => images.iter().any(|image| !is_upright(image)),
        Pictures::Video(_) => false,
    };
    let turned: Vec<&str> = names
        .iter()
        .zip(cameras)
        .filter_map(|(name, pictures)| is_turned(pictures).then_some(name.as_str()))
        .collect();
    (!turned.is_empty()).then(|| {
        format!(
            "images are turned upright, as their EXIF orientation says: those of {}",
            turned.join(", ")
        )
    })
}

fn is_upright(image: &Path) -> bool {
    orientation(image) == Orientation::NoTransforms
}

/// Each camera's first frame at its full size, as `folder/0000.png`, `0001.png` .. (or with the extension
/// of the image it is), in the cameras' order.
pub(super) fn first_frames(
    cameras: &[Pictures],
    timelines: &[Timeline],
    schedule: &Schedule,
    folder: &Path,
) -> Result<Vec<PathBuf>, Error> {
    create_dir_all(folder).map_err(Error::access(folder))?;
    cameras
        .par_iter()
        .zip(timelines)
        .enumerate()
        .map(|(index, (pictures, timeline))| {
            let stem = format!("{index:04}");
            let first = timeline.nearest(schedule.start);
            match pictures {
                Pictures::Images(images) => copy_image(&images[first], folder, &stem, None),
                Pictures::Video(video) => {
                    let own = folder.join(&stem);
                    fs::create_dir(&own).map_err(Error::access(&own))?;
                    let written =
                        write_frames(video, &own, &[first], None).map_err(Error::of_recording)?;
                    let from = written.first().ok_or_else(|| video.is_missing(first))?;
                    let to = own.with_extension("png");
                    fs::rename(from, &to).map_err(Error::access(&to))?;
                    fs::remove_dir(&own).map_err(Error::access(&own))?;
                    Ok(to)
                }
            }
        })
        .collect()
}

/// Frames of each camera, in order; `None` where the camera recorded none.
pub(super) type Written = Vec<Vec<Option<PathBuf>>>;

/// Writes every camera's frames to `dataset/NAME/images/0000.png` and so on. Returns equally many for each camera,
/// fewer than planned if a video ends early, and the index of the camera with the fewest.
pub(super) fn write_all(
    names: &[String],
    cameras: &[Pictures],
    timelines: &[Timeline],
    schedule: &Schedule,
    sizes: &[Option<[usize; 2]>],
    dataset: &Path,
) -> Result<(Written, usize), Error> {
    let mut cameras = (0..cameras.len())
        .into_par_iter()
        .map(|index| {
            let folder = dataset.join(&names[index]).join("images");
            create_dir_all(&folder).map_err(Error::access(&folder))?;
            let times = (0..schedule.n_frames).map(|frame| schedule.time(frame));
            let nearest: Vec<usize> = times.map(|time| timelines[index].nearest(time)).collect();
            match &cameras[index] {
                Pictures::Images(images) => copy_images(images, &nearest, sizes[index], &folder),
                Pictures::Video(video) => write_frames(video, &folder, &nearest, sizes[index])
                    .map_err(Error::of_recording),
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
    let mut written = Vec::with_capacity(cameras.len());
    for (frames, timeline) in cameras.into_iter().zip(timelines) {
        let mut own = Vec::with_capacity(frames.len());
        for (frame, file) in frames.into_iter().enumerate() {
            let is_recorded = timeline.has(schedule.time(frame));
            if !is_recorded {
                fs::remove_file(&file).map_err(Error::access(&file))?;
            }
            own.push(is_recorded.then_some(file));
        }
        written.push(own);
    }
    Ok((written, shortest))
}

fn copy_images(
    images: &[PathBuf],
    nearest: &[usize],
    size: Option<[usize; 2]>,
    folder: &Path,
) -> Result<Vec<PathBuf>, Error> {
    let copied = nearest.par_iter().enumerate();
    copied
        .map(|(frame, &image)| copy_image(&images[image], folder, &format!("{frame:04}"), size))
        .collect()
}

/// Copies an image to `folder/STEM.*`: the file itself, or where it is turned or scaled, a PNG.
fn copy_image(
    image: &Path,
    folder: &Path,
    stem: &str,
    size: Option<[usize; 2]>,
) -> Result<PathBuf, Error> {
    if size.is_some() || !is_upright(image) {
        let to = folder.join(format!("{stem}.png"));
        write_upright(image, &to, size)?;
        return Ok(to);
    }
    let to = folder.join(format!("{stem}.{}", extension(image)));
    // Apart, so that an error names the file that was refused.
    let bytes = fs::read(image).map_err(Error::access(image))?;
    fs::write(&to, bytes).map_err(Error::access(&to))?;
    Ok(to)
}

/// Width and height of images.
pub(super) fn sizes(images: &[PathBuf]) -> Result<Vec<[usize; 2]>, Error> {
    images
        .iter()
        .map(|image| dimensions(image).map(|(width, height)| [width, height]))
        .collect()
}

fn extension(image: &Path) -> String {
    image
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_ascii_lowercase()
}
