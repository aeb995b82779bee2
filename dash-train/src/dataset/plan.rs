//! From what a layout's reader lists to views: recipes, images in memory or on demand, masks.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use dash_kernels::Camera;
use rayon::prelude::*;

use super::broken::keep_readable;
use super::decode::header;
use super::distortion::{Distortion, undistort};
use super::frames::{
    CountedMask, FrameStore, Pixels, Recipe, Source, bytes_in_words, check_size, default_budget,
    make_all, salvage,
};
use super::image::ImageData;
use super::masks::{self, MASK_FOLDER};
use super::view::{MotionFile, MotionMask, Partition, View};
use super::{DatasetError, LoadOptions};

/// Folder with masks of what truly moves, which synthetic scenes carry.
const MOTION_FOLDER: &str = "motion_masks";
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
    pub(super) partition: Partition,
    /// The camera at the size that the image must have.
    pub(super) camera: Camera,
    pub(super) lens: Option<Lens>,
    /// The mask of the pixels that count that the poses name, which comes before one in the folder of masks.
    pub(super) mask: Option<PathBuf>,
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

/// The image that `camera` took, without the distortion of its lens if it has one to undo.
pub(super) fn without_distortion(
    image: ImageData,
    camera: &Camera,
    lens: Option<&Lens>,
) -> ImageData {
    match lens {
        None => image,
        Some(lens) => undistort(&image, camera, &lens.distortion, &lens.pinhole),
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
            .map(|view| (format!("the view {}", view.name), self.recipe(view)))
            .collect();
        let recipes = keep_readable(recipes, skip_broken, self.broken.as_ref())?;
        let mut plan: Vec<(PlannedView, Recipe)> = planned
            .into_iter()
            .zip(recipes)
            .filter_map(|(view, recipe)| Some((view, recipe?)))
            .collect();
        // Those who note what is broken look at the masks of every image.
        if self.broken.is_none()
            && let Some(doubt) = self.doubt_masks(&plan)?
        {
            tracing::warn!("{}: {doubt}", self.root.display());
        }
        let total: u64 = plan.iter().map(|(_, recipe)| recipe.bytes()).sum();
        let budget = self.options.memory.unwrap_or_else(default_budget);
        if !self.options.on_demand && total <= budget {
            return self
                .make(plan, |image| Pixels::Ready(Arc::new(image)))?
                .into_iter()
                .map(|(view, recipe, pixels)| self.view(view, &recipe, pixels, false))
                .collect();
        }
        // `broken` is noted by those who look at every image anyway.
        if skip_broken && self.broken.is_none() {
            // What is broken must be known before it is drawn: all is decoded once.
            let made = self.make(plan, |_| ())?.into_iter();
            plan = made.map(|(view, recipe, ())| (view, recipe)).collect();
        }
        let threads = rayon::current_num_threads().min(MAX_FRAME_THREADS);
        let recipes = plan.iter().map(|(_, recipe)| recipe.clone()).collect();
        let store = Arc::new(FrameStore::new(recipes, budget, threads)?);
        if total > budget {
            tracing::info!(
                "{}: the images take {}, more than the {} for them: they are decoded on demand",
                self.root.display(),
                bytes_in_words(total),
                bytes_in_words(budget)
            );
        }
        plan.into_iter()
            .enumerate()
            .map(|(index, (view, recipe))| {
                let store = store.clone();
                self.view(view, &recipe, Pixels::Stored { store, index }, true)
            })
            .collect()
    }

    /// What there is to say of the masks of a plan.
    fn doubt_masks(&self, plan: &[(PlannedView, Recipe)]) -> Result<Option<String>, DatasetError> {
        let size = |recipe: &Recipe| (recipe.camera.width, recipe.camera.height);
        let masks: Vec<_> = plan
            .iter()
            .map(|(_, recipe)| recipe.counted.as_ref().map(|mask| (mask, size(recipe))))
            .collect();
        match (masks::doubt(&masks), plan.first()) {
            (Ok(None), Some((first, _))) if masks.iter().all(Option::is_none) => {
                Ok(masks::unused_folder(self.root, &first.name))
            }
            // Left out below, with its view.
            (Err(_), _) if self.options.skip_broken => Ok(None),
            (doubt, _) => doubt,
        }
    }

    /// Makes all images of a plan and keeps of each what `keep` does; with `skip_broken`, of those that
    /// can be made.
    fn make<T: Send>(
        &self,
        plan: Vec<(PlannedView, Recipe)>,
        keep: impl Fn(ImageData) -> T + Sync,
    ) -> Result<Vec<(PlannedView, Recipe, T)>, DatasetError> {
        let skip_broken = self.options.skip_broken;
        let (planned, mut recipes): (Vec<_>, Vec<_>) = plan.into_iter().unzip();
        let mut made = make_all(&recipes, &keep);
        if skip_broken {
            salvage(&mut recipes, &mut made, &keep);
        }
        let mut results = Vec::with_capacity(made.len());
        let mut rest = Vec::with_capacity(made.len());
        for ((view, recipe), outcome) in planned.into_iter().zip(recipes).zip(made) {
            if let Some(result) = outcome {
                let name = match &result {
                    // Its error tells of all frames of that video.
                    Err(DatasetError::Video { .. }) => {
                        format!("damaged frames of camera {}", view.camera_name)
                    }
                    _ => format!("the view {}", view.name),
                };
                results.push((name, result));
                rest.push((view, recipe));
            }
        }
        let kept = keep_readable(results, skip_broken, self.broken.as_ref())?;
        let kept = rest.into_iter().zip(kept);
        Ok(kept
            .filter_map(|((view, recipe), made)| Some((view, recipe, made?)))
            .collect())
    }

    fn recipe(&self, view: &PlannedView) -> Result<Recipe, DatasetError> {
        let has_alpha = match &view.source {
            Source::File(path) => {
                let (width, height, has_alpha) = header(path)?;
                check_size(path, &view.camera, (width, height))?;
                has_alpha
            }
            Source::Video { .. } => false,
        };
        let mask = view.mask.clone();
        let mask = mask.or_else(|| masks::beside(self.root, MASK_FOLDER, view));
        let counted = mask.map(|path| CountedMask {
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

    fn view(
        &self,
        view: PlannedView,
        recipe: &Recipe,
        pixels: Pixels,
        on_demand: bool,
    ) -> Result<View, DatasetError> {
        let motion = match view.partition {
            Partition::Test => masks::beside(self.root, MOTION_FOLDER, &view),
            Partition::Train => None,
        };
        let motion_mask = motion.map(|path| {
            MotionMask::File(Box::new(MotionFile {
                path,
                camera: view.camera.clone(),
                lens: view.lens.clone(),
            }))
        });
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
            partition: view.partition,
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
