//! What to load of a dataset, and how.

use super::frame_range::FrameRange;
use super::layout::Layout;
use crate::Error;

/// What to load of a dataset, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadOptions {
    /// The layout; recognised by the files when `None`.
    pub layout: Option<Layout>,
    /// Images are loaded at `round(size / downscale)`; at least 1.
    pub downscale: f64,
    /// Indices of the cameras to hold out, instead of those the layout holds out.
    pub test_cameras: Option<Vec<usize>>,
    /// Names of the cameras to leave out, of training and of testing.
    pub drop_cameras: Vec<String>,
    /// Which frames; `None` for those of published results where the layout knows them, else all.
    pub frames: Option<FrameRange>,
    /// At most this many frames (distinct times), after `frames` and `frame_stride`.
    pub max_frames: Option<usize>,
    /// Every n-th frame only; at least 1.
    pub frame_stride: usize,
    /// Decoding threads; all of rayon's when `None`.
    pub threads: Option<usize>,
    /// Memory budget of the images, bytes; half of the free memory when `None`. Beyond it, images are decoded
    /// on demand.
    pub memory: Option<u64>,
    /// Decode images on demand even if all of them would fit.
    pub on_demand: bool,
    /// Whether white in `masks/` marks the pixels to ignore, instead of those that count.
    pub invert_masks: bool,
    /// Leave out views whose image cannot be read, with a warning, instead of stopping.
    pub skip_broken: bool,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self {
            layout: None,
            downscale: 1.0,
            test_cameras: None,
            drop_cameras: Vec::new(),
            frames: None,
            max_frames: None,
            frame_stride: 1,
            threads: None,
            memory: None,
            on_demand: false,
            invert_masks: false,
            skip_broken: false,
        }
    }
}

impl LoadOptions {
    pub(crate) fn validate(&self) -> Result<(), Error> {
        let refuse = |option, expected: &str, found: String| {
            Err(Error::LoadOption {
                option,
                expected: expected.into(),
                found,
            })
        };
        if !(self.downscale >= 1.0 && self.downscale.is_finite()) {
            return refuse(
                "--downscale",
                "a number of at least 1",
                self.downscale.to_string(),
            );
        }
        if self.frame_stride == 0 {
            return refuse("frame stride", "at least 1", "0".into());
        }
        if self.max_frames == Some(0) {
            return refuse("maximum of frames", "at least 1", "0".into());
        }
        if self.threads == Some(0) {
            return refuse("--threads", "at least 1", "0".into());
        }
        Ok(())
    }

    /// The indices of the wanted frames among frames with these numbers.
    ///
    /// # Errors
    /// When none of them is in the range of `--frames`.
    pub(crate) fn wanted(&self, numbers: &[u64]) -> Result<Vec<usize>, Error> {
        let in_range: Vec<usize> = (0..numbers.len())
            .filter(|&place| {
                self.frames
                    .is_none_or(|range| range.contains(numbers[place], place))
            })
            .collect();
        if let (Some(range), true, [first, ..]) = (self.frames, in_range.is_empty(), numbers) {
            let last = numbers.last().unwrap_or(first);
            return Err(Error::LoadOption {
                option: "--frames",
                expected: format!("some of the frames {first} to {last}"),
                found: range.to_string(),
            });
        }
        if let (Some(FrameRange::Between { last, .. }), Some(end)) = (self.frames, numbers.last())
            && last > *end
        {
            tracing::warn!("--frames: the clip ends at {end}, before {last}");
        }
        let most = self.max_frames.unwrap_or(usize::MAX);
        let strided = in_range.into_iter().step_by(self.frame_stride);
        Ok(strided.take(most).collect())
    }

    /// For each of the cameras with these names whether it stays.
    ///
    /// # Errors
    /// When `--drop-cameras` names one that is not there, or all of them.
    pub(crate) fn kept(&self, names: &[&str]) -> Result<Vec<bool>, Error> {
        let refuse = |found: String| Error::LoadOption {
            option: "--drop-cameras",
            expected: format!("some of the cameras {}, not all", shown(names)),
            found,
        };
        if let Some(unknown) = self
            .drop_cameras
            .iter()
            .find(|name| !names.contains(&name.as_str()))
        {
            return Err(Error::LoadOption {
                option: "--drop-cameras",
                expected: format!("some of the cameras {}", shown(names)),
                found: format!("{unknown}, which is none of them"),
            });
        }
        let kept: Vec<bool> = names
            .iter()
            .map(|name| !self.drop_cameras.iter().any(|dropped| dropped == name))
            .collect();
        if !self.drop_cameras.is_empty() && !kept.contains(&true) {
            return Err(refuse(self.drop_cameras.join(",")));
        }
        Ok(kept)
    }

    /// For each camera whether it is held out: by `test_cameras`, else as the layout suggests.
    pub(crate) fn held_out(&self, suggested: Vec<bool>) -> Result<Vec<bool>, Error> {
        let Some(test_cameras) = &self.test_cameras else {
            // A single camera is needed for training.
            if suggested == [true] {
                tracing::warn!("one camera only: it is trained on, and nothing is held out");
                return Ok(vec![false]);
            }
            return Ok(suggested);
        };
        let mut held_out = vec![false; suggested.len()];
        for &camera in test_cameras {
            *held_out.get_mut(camera).ok_or_else(|| Error::LoadOption {
                option: "--test-cameras",
                expected: format!("camera indices from 0 to {}", suggested.len() - 1),
                found: camera.to_string(),
            })? = true;
        }
        Ok(held_out)
    }
}

/// The names, or the first of them where they would fill a page.
fn shown(names: &[&str]) -> String {
    const MOST: usize = 32;
    let more = if names.len() > MOST { ", .." } else { "" };
    format!("{}{more}", names[..names.len().min(MOST)].join(", "))
}
