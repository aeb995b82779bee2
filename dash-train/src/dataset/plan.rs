//! From what a layout's reader lists to views: recipes, images in memory or on demand, masks.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use dash_kernels::Camera;
use rayon::prelude::*;

use super::broken::keep_readable;
use super::decode::header;
use super::distortion::Distortion;
use super::frames::{
    CountedMask, FrameStore, Pixels, Recipe, Source, bytes_in_words, default_budget, groups,
    make_group,
};
use super::image::ImageData;
use super::view::{MotionMask, Split, View};
use super::{DatasetError, LoadOptions};

/// Folder with masks of what truly moves, which synthetic scenes carry.
const MOTION_FOLDER: &str = "motion_masks";
/// Folder with masks of the pixels that count.
const COUNTED_FOLDER: &str = "masks";
/// Most threads that make frames ahead of time.
const MAX_FRAME_THREADS: usize = 4;

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
