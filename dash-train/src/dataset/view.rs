//! Views: a camera, a time and an image; and the step from a listed image to a loaded view.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use dash_kernels::Camera;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::broken::keep_readable;
use super::distortion::Distortion;
use super::frames::{
    CountedMask, FrameStore, Pixels, Recipe, Source, bytes_in_words, default_budget, groups,
    make_group,
};
use super::image::{ImageData, decode_mask, header};
use super::{DatasetError, LoadOptions};

/// Folder with masks of what truly moves, which synthetic scenes carry.
const MOTION_FOLDER: &str = "motion_masks";
/// Folder with masks of the pixels that count.
const COUNTED_FOLDER: &str = "masks";
/// Most threads that make frames ahead of time.
const MAX_FRAME_THREADS: usize = 4;

/// What a view is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// Optimised against.
    Train,
    /// Only measured.
    Test,
}

impl Split {
    /// [`Split::Test`] for a view that is held out.
    pub(super) fn held_out(held_out: bool) -> Self {
        if held_out { Self::Test } else { Self::Train }
    }
}

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Train => "train",
            Self::Test => "test",
        })
    }
}

/// One image of a capture. Clones share the image.
#[derive(Debug, Clone)]
pub struct View {
    /// The camera's name: its folder or video, or a number for poses that have none.
    pub camera_name: String,
    /// Index of the camera in the capture; views with one pose share it.
    pub camera_index: usize,
    /// Index of the time among the capture's loaded times.
    pub frame: usize,
    /// Time in [0, 1]; 0 in a static capture.
    pub time: f32,
    /// Pose and intrinsics at the loaded size.
    pub camera: Camera,
    /// Whether it is trained on or held out.
    pub split: Split,
    /// The image's path below the dataset (for `camNN/images/0003.png`: `camNN/0003`), without extension.
    pub name: String,
    pub(crate) pixels: Pixels,
    /// Memory that the image takes when it is there.
    pub(crate) bytes: u64,
    pub(crate) has_alpha: bool,
    pub(crate) motion_mask: Option<MotionMask>,
}

/// A view made smaller.
pub(crate) struct SmallView {
    pub(crate) camera: Camera,
    /// `[H * W * 3]` in [0, 1].
    pub(crate) rgb: Vec<f32>,
    /// `[H * W]` in [0, 1].
    pub(crate) alpha: Option<Vec<f32>>,
}

/// A mask of what truly moves.
#[derive(Debug, Clone)]
pub(crate) enum MotionMask {
    /// `[H * W]` of 0 and 255.
    Ready(Arc<Vec<u8>>),
    /// Read when it is asked for, with the size of its image as captured.
    File(PathBuf, (usize, usize)),
}

impl View {
    /// A training view of camera 0 and frame 0 from 8-bit pixels `[H * W * 3]`, for data that does
    /// not come from a folder; the public fields say the rest.
    ///
    /// # Panics
    /// When there are not as many pixels as the camera has.
    pub fn from_rgb8(name: &str, camera: Camera, time: f32, pixels: Vec<u8>) -> Self {
        let (width, height) = (camera.width, camera.height);
        assert_eq!(
            pixels.len(),
            width * height * 3,
            "`pixels` must be [H * W * 3]"
        );
        Self {
            camera_name: name.to_string(),
            camera_index: 0,
            frame: 0,
            time,
            camera,
            split: Split::Train,
            name: name.to_string(),
            bytes: pixels.len() as u64,
            has_alpha: false,
            pixels: Pixels::Ready(Arc::new(ImageData::from_rgb(width, height, pixels))),
            motion_mask: None,
        }
    }

    /// The image over `background`.
    ///
    /// # Shapes
    /// `[H * W * 3]`, rows first, sRGB values in [0, 1].
    ///
    /// # Errors
    /// When the image is read only now and is damaged or gone.
    pub fn rgb(&self, background: [f32; 3]) -> Result<Vec<f32>, DatasetError> {
        Ok(self.pixels.get()?.rgb(background))
    }

    /// Some rows of [`rgb`](Self::rgb).
    pub(crate) fn rgb_rows(
        &self,
        background: [f32; 3],
        rows: Range<usize>,
    ) -> Result<Vec<f32>, DatasetError> {
        Ok(self.pixels.get()?.rgb_rows(background, rows))
    }

    /// The image's alpha `[H * W]` in [0, 1]; `None` when it has none.
    ///
    /// # Errors
    /// As [`rgb`](Self::rgb).
    pub fn alpha(&self) -> Result<Option<Vec<f32>>, DatasetError> {
        Ok(self.pixels.get()?.alpha())
    }

    /// Camera and image at a size of which no side is longer than `max_side`.
    pub(crate) fn at_most(
        &self,
        max_side: usize,
        background: [f32; 3],
    ) -> Result<SmallView, DatasetError> {
        let image = self.pixels.get()?;
        let (width, height) = (self.camera.width, self.camera.height);
        let longer = width.max(height);
        if longer <= max_side {
            return Ok(SmallView {
                camera: self.camera.clone(),
                rgb: image.rgb(background),
                alpha: image.alpha(),
            });
        }
        let shrink = |side: usize| (side * max_side / longer).max(1);
        let small = ImageData::clone(&image).resized(shrink(width), shrink(height));
        Ok(SmallView {
            camera: self.camera.resized(small.width, small.height),
            rgb: small.rgb(background),
            alpha: small.alpha(),
        })
    }

    /// Which pixels count, `[H * W]` of 1 and 0; `None` where all do.
    ///
    /// # Errors
    /// As [`rgb`](Self::rgb).
    pub fn counted(&self) -> Result<Option<Vec<f32>>, DatasetError> {
        let image = self.pixels.get()?;
        Ok(image.counted.as_ref().map(|mask| {
            mask.iter()
                .map(|&counts| f32::from(u8::from(counts > 0)))
                .collect()
        }))
    }

    /// Whether the image has alpha.
    pub fn has_alpha(&self) -> bool {
        self.has_alpha
    }

    /// True motion `[H * W]`, 255 where the colour depends on something that moves, else 0. Only
    /// test views of synthetic scenes have it.
    ///
    /// # Errors
    /// As [`rgb`](Self::rgb).
    pub fn motion_mask(&self) -> Result<Option<Arc<Vec<u8>>>, DatasetError> {
        match &self.motion_mask {
            None => Ok(None),
            Some(MotionMask::Ready(mask)) => Ok(Some(mask.clone())),
            Some(MotionMask::File(path, full_size)) => {
                let mask = decode_mask(path, *full_size)?;
                let mask = mask.resized(self.camera.width, self.camera.height);
                Ok(Some(Arc::new(mask.thresholded(false))))
            }
        }
    }

    /// Memory that the image takes when it is there.
    pub fn image_bytes(&self) -> u64 {
        self.bytes
    }
}

/// A view whose image is still to be decoded.
pub(super) struct PlannedView {
    pub(super) source: Source,
    pub(super) name: String,
    pub(super) camera_name: String,
    pub(super) camera_index: usize,
    pub(super) frame: usize,
    pub(super) time: f32,
    pub(super) split: Split,
    /// The camera at the size that the image must have.
    pub(super) camera: Camera,
    pub(super) lens: Option<Lens>,
}

/// How to undo a lens's distortion.
#[derive(Debug, Clone)]
pub(super) struct Lens {
    pub(super) distortion: Distortion,
    /// Intrinsics of the undistorted image; the pose is the view's.
    pub(super) pinhole: Camera,
}

impl Lens {
    /// `None` when there is nothing to undo; errors name `path`.
    pub(super) fn new(
        distortion: Distortion,
        camera: &Camera,
        path: &Path,
    ) -> Result<Option<Self>, DatasetError> {
        if distortion.is_negligible() {
            return Ok(None);
        }
        let pinhole = distortion.pinhole(camera, path)?;
        Ok(Some(Self {
            distortion,
            pinhole,
        }))
    }
}

/// What all layouts' readers are given.
pub(super) struct Context<'a> {
    pub(super) root: &'a Path,
    pub(super) options: &'a LoadOptions,
    /// Where views whose images can't be decoded are noted and left out.
    pub(super) broken: Option<Mutex<Vec<DatasetError>>>,
}

impl<'a> Context<'a> {
    pub(super) fn new(root: &'a Path, options: &'a LoadOptions) -> Self {
        Self {
            root,
            options,
            broken: None,
        }
    }

    /// The views of a plan, in its order: with their images where all of them fit the memory that
    /// they may take, else with images that are made when they are asked for.
    pub(super) fn load_views(&self, planned: Vec<PlannedView>) -> Result<Vec<View>, DatasetError> {
        let skip_broken = self.options.skip_broken;
        let recipes = planned
            .par_iter()
            .map(|view| (view.name.clone(), self.recipe(view)))
            .collect();
        let recipes = keep_readable(recipes, skip_broken, self.broken.as_ref())?;
        let (mut planned, mut recipes): (Vec<_>, Vec<_>) = planned
            .into_iter()
            .zip(recipes)
            .filter_map(|(view, recipe)| Some((view, recipe?)))
            .unzip();
        let total: u64 = recipes.iter().map(Recipe::bytes).sum();
        let budget = self.options.memory.unwrap_or_else(default_budget);
        let on_demand = self.options.on_demand || total > budget;
        let named = |planned: &[PlannedView]| planned.iter().map(|v| v.name.clone()).collect();
        if on_demand {
            // `broken` is noted by those who look at every image anyway.
            if skip_broken && self.broken.is_none() {
                // What is broken must be known before it is drawn: all is decoded once.
                let names: Vec<String> = named(&planned);
                let checked = names.into_iter().zip(make_all(&recipes, |_| ())).collect();
                let sound = keep_readable(checked, true, self.broken.as_ref())?;
                let mut is_sound = sound.iter().map(Option::is_some);
                planned.retain(|_| is_sound.next().unwrap_or(false));
                let mut is_sound = sound.iter().map(Option::is_some);
                recipes.retain(|_| is_sound.next().unwrap_or(false));
            }
            let threads = rayon::current_num_threads().min(MAX_FRAME_THREADS);
            let store = Arc::new(FrameStore::new(recipes.clone(), budget, threads)?);
            if total > budget {
                tracing::info!(
                    "{}: the images take {}, more than the {} for them: they are decoded on demand",
                    self.root.display(),
                    bytes_in_words(total),
                    bytes_in_words(budget)
                );
            }
            return planned
                .into_iter()
                .zip(&recipes)
                .enumerate()
                .map(|(index, (view, recipe))| {
                    let store = store.clone();
                    self.view(view, recipe, Pixels::Stored { store, index }, true)
                })
                .collect();
        }
        let names: Vec<String> = named(&planned);
        let made = make_all(&recipes, |image| Pixels::Ready(Arc::new(image)));
        let made = names.into_iter().zip(made).collect();
        let made = keep_readable(made, skip_broken, self.broken.as_ref())?;
        planned
            .into_iter()
            .zip(&recipes)
            .zip(made)
            .filter_map(|((view, recipe), pixels)| Some(self.view(view, recipe, pixels?, false)))
            .collect()
    }

    fn recipe(&self, view: &PlannedView) -> Result<Recipe, DatasetError> {
        let has_alpha = match &view.source {
            Source::File(path) => header(path)?.2,
            Source::Video { .. } => false,
        };
        let counted = self.beside(COUNTED_FOLDER, view).map(|path| CountedMask {
            path,
            inverted: self.options.invert_masks,
        });
        let shrink = |side: usize| (side as f64 / self.options.downscale).round().max(1.0) as usize;
        Ok(Recipe {
            source: view.source.clone(),
            size: (shrink(view.camera.width), shrink(view.camera.height)),
            camera: view.camera.clone(),
            lens: view.lens.clone(),
            has_alpha,
            counted,
        })
    }

    /// The picture of the view's name in a folder of masks.
    fn beside(&self, folder: &str, view: &PlannedView) -> Option<PathBuf> {
        let file = self.root.join(folder).join(format!("{}.png", view.name));
        file.is_file().then_some(file)
    }

    fn view(
        &self,
        view: PlannedView,
        recipe: &Recipe,
        pixels: Pixels,
        on_demand: bool,
    ) -> Result<View, DatasetError> {
        let full_size = (view.camera.width, view.camera.height);
        let motion = match view.split {
            Split::Test => self.beside(MOTION_FOLDER, &view),
            Split::Train => None,
        };
        let motion_mask = motion.map(|path| MotionMask::File(path, full_size));
        let camera = match &view.lens {
            None => view.camera,
            Some(lens) => Camera {
                fx: lens.pinhole.fx,
                fy: lens.pinhole.fy,
                ..view.camera
            },
        };
        let (width, height) = recipe.size;
        let mut view = View {
            camera_name: view.camera_name,
            camera_index: view.camera_index,
            frame: view.frame,
            time: view.time,
            camera: camera.resized(width, height),
            split: view.split,
            name: view.name,
            pixels,
            bytes: recipe.bytes(),
            has_alpha: recipe.has_alpha,
            motion_mask,
        };
        if !on_demand {
            view.motion_mask = view.motion_mask()?.map(MotionMask::Ready);
        }
        Ok(view)
    }
}

/// Makes all images, in parallel over files and videos, and keeps of each what `keep` does.
fn make_all<T: Send>(
    recipes: &[Recipe],
    keep: impl Fn(ImageData) -> T + Sync,
) -> Vec<Result<T, DatasetError>> {
    let made: Vec<Vec<Result<T, DatasetError>>> = videos(recipes)
        .into_par_iter()
        .map(|group| {
            let mut made: Vec<Option<T>> = group.iter().map(|_| None).collect();
            let first = group.first().copied().unwrap_or(0);
            let outcome = make_group(recipes, &group, |index, image| {
                if let Some(place) = made.get_mut(index - first) {
                    *place = Some(keep(image));
                }
                Ok(())
            });
            // The reason is told once; what is missing besides is named.
            let mut reason = outcome.err();
            group
                .iter()
                .zip(made)
                .map(|(&index, made)| match made {
                    Some(made) => Ok(made),
                    None => Err(reason
                        .take()
                        .unwrap_or_else(|| recipes[index].source.is_missing())),
                })
                .collect()
        })
        .collect();
    made.into_iter().flatten().collect()
}

/// As [`groups`], with those of one video together.
fn videos(recipes: &[Recipe]) -> Vec<Vec<usize>> {
    let mut joined: Vec<Vec<usize>> = Vec::new();
    let video = |group: &[usize]| match &recipes[*group.first()?].source {
        Source::File(_) => None,
        Source::Video { video, .. } => Some(Arc::as_ptr(video)),
    };
    for group in groups(recipes) {
        match joined.last_mut() {
            Some(last) if video(&group).is_some() && video(last) == video(&group) => {
                last.extend(group);
            }
            _ => joined.push(group),
        }
    }
    joined
}
