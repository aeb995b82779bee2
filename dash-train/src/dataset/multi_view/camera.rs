//! The cameras of a synchronised rig, and where their frames are.

use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use crate::Error;
use crate::dataset::pixels::distortion::Distortion;
use crate::dataset::pixels::lens::Lens;
use crate::dataset::pixels::sizes::Sizes;
use crate::files::{self};

/// Where a camera's frames are.
#[derive(Debug, Clone)]
pub(crate) enum Frames {
    /// One file per frame, in order.
    Images(Vec<FrameFile>),
    /// A video.
    Video,
}

/// One frame's image and its label: the file's stem, or a part of it.
#[derive(Debug, Clone)]
pub(crate) struct FrameFile {
    pub(crate) file: PathBuf,
    pub(crate) label: String,
    /// The digits of the label that number the frame, without leading zeros.
    pub(crate) digits: Option<String>,
}

impl FrameFile {
    /// A camera's frames, called by their files' stems.
    pub(crate) fn by_stems(files: Vec<PathBuf>) -> Vec<Self> {
        let labels = files.iter().map(|file| files::stem(file)).collect();
        Self::labelled(files, labels)
    }

    /// A camera's frames with these labels.
    pub(crate) fn labelled(files: Vec<PathBuf>, labels: Vec<String>) -> Vec<Self> {
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
    pub(crate) fn number(&self) -> Option<u64> {
        self.digits.as_ref()?.parse().ok()
    }

    /// The label and the frame's number, for errors.
    pub(crate) fn described(&self) -> String {
        match &self.digits {
            Some(digits) => format!("{} (frame {digits})", self.label),
            None => self.label.clone(),
        }
    }
}

/// A camera without its pose.
#[derive(Debug, Clone)]
pub(crate) struct Source {
    pub(crate) name: String,
    /// The video, or the folder of the images.
    pub(crate) path: PathBuf,
    pub(crate) frames: Frames,
}

impl Source {
    pub(crate) fn images(&self) -> Option<&[FrameFile]> {
        match &self.frames {
            Frames::Images(images) => Some(images),
            Frames::Video => None,
        }
    }
}

/// A camera with its pose.
#[derive(Debug, Clone)]
pub(crate) struct RigCamera {
    pub(crate) source: Source,
    /// At the size at which the pose was estimated; frames may have another.
    pub(crate) camera: Camera,
    pub(crate) distortion: Distortion,
    /// The file with the pose, for errors.
    pub(crate) posed_by: PathBuf,
}

impl RigCamera {
    /// The camera at the frames' size, which may be another than the poses were estimated at, and its lens.
    pub(crate) fn at_size(
        &self,
        size: (usize, usize),
        path: &Path,
        sizes: &mut Sizes,
    ) -> Result<(Camera, Option<Lens>), Error> {
        let camera = sizes.resized(&self.camera, size, path, &self.posed_by)?;
        let lens = Lens::new(self.distortion, &camera, &self.posed_by)?;
        Ok((camera, lens))
    }
}

/// Refuses a camera with another number of frames than the first.
pub(crate) fn same_count(
    first: &Source,
    expected: usize,
    source: &Source,
    found: usize,
) -> Result<(), Error> {
    if found == expected {
        return Ok(());
    }
    Err(Error::invalid(
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
