//! From planned views to views: images in memory or on demand, masks.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use dash_kernels::Camera;
use rayon::prelude::*;

use super::broken::Broken;
use super::options::LoadOptions;
use super::partition::Partition;
use super::pixels::decode::{header, is_transparent};
use super::pixels::frames::{
    FrameStore, Pixels, Recipe, Source, bytes_in_words, check_size, default_budget, make_all,
    salvage,
};
use super::pixels::image::ImageData;
use super::pixels::lens::Lens;
use super::pixels::masks::{self, CountedMask, MASK_FOLDER};
use super::view::{MotionFile, MotionMask, View};
use crate::Error;

/// Folder with the motion masks of synthetic scenes.
const MOTION_FOLDER: &str = "motion_masks";
/// Fewest pixels of a side that `--downscale` may leave.
const LEAST_SIDE: usize = 3;
/// Most threads that decode ahead.
const MAX_FRAME_THREADS: usize = 4;
/// Pictures that are looked at to know whether any is transparent.
const ASKED_FOR_ALPHA: usize = 64;

/// A view whose image is still to be decoded.
#[derive(Debug, Clone)]
pub struct PlannedView {
    /// As [`View::name`]; the view's masks are called after it.
    pub name: String,
    /// As [`View::camera_name`].
    pub camera_name: String,
    /// As [`View::camera_index`].
    pub camera_index: usize,
    /// As [`View::frame`].
    pub frame: usize,
    /// As [`View::time`].
    pub time: f32,
    /// As [`View::partition`].
    pub partition: Partition,
    /// The camera at the size that the image must have.
    pub camera: Camera,
    pub(crate) source: Source,
    pub(crate) lens: Option<Lens>,
    /// The mask that the file of poses names; it takes precedence over one in `masks/`.
    pub(crate) mask: Option<PathBuf>,
}

impl PlannedView {
    /// A training view of camera 0 and frame 0 from an image file; the public fields say the rest.
    pub fn of_image(file: &Path, name: &str, camera: Camera) -> Self {
        Self {
            name: name.to_string(),
            camera_name: name.to_string(),
            camera_index: 0,
            frame: 0,
            time: 0.0,
            partition: Partition::Train,
            camera,
            source: Source::File(file.to_path_buf()),
            lens: None,
            mask: None,
        }
    }
}

/// A reader's access to the folder and the options, and to the images of planned views.
#[derive(Debug)]
pub struct Loader<'a> {
    pub(crate) root: &'a Path,
    pub(crate) options: &'a LoadOptions,
    pub(crate) broken: Broken,
}

impl<'a> Loader<'a> {
    pub(crate) fn new(root: &'a Path, options: &'a LoadOptions) -> Self {
        Self {
            root,
            options,
            broken: Broken::stop_or_warn(options.skip_broken),
        }
    }

    /// The dataset's folder.
    pub fn root(&self) -> &Path {
        self.root
    }

    /// What is to be loaded.
    pub fn options(&self) -> &LoadOptions {
        self.options
    }

    /// The planned views in their order. Images are decoded now if all of them fit the memory budget, else on
    /// demand.
    ///
    /// # Errors
    /// Names the image or mask that is missing, damaged or of another size than its camera, or a camera that is
    /// to be dropped and is not there.
    pub fn load_views(&self, planned: Vec<PlannedView>) -> Result<Vec<View>, Error> {
        let names: BTreeSet<&str> = planned.iter().map(|v| v.camera_name.as_str()).collect();
        self.options.kept(&Vec::from_iter(names))?;
        let is_kept = |view: &PlannedView| !self.options.drop_cameras.contains(&view.camera_name);
        self.load_kept(planned.into_iter().filter(is_kept).collect())
    }

    /// [`Self::load_views`] of a plan from which cameras have been dropped already.
    pub(crate) fn load_kept(&self, planned: Vec<PlannedView>) -> Result<Vec<View>, Error> {
        let skip_broken = self.options.skip_broken;
        let recipes = planned
            .par_iter()
            .map(|view| (format!("the view {}", view.name), self.recipe(view)))
            .collect();
        let recipes = self.broken.keep_readable(recipes)?;
        let mut plan: Vec<(PlannedView, Recipe)> = planned
            .into_iter()
            .zip(recipes)
            .filter_map(|(view, recipe)| Some((view, recipe?)))
            .collect();
        forget_unused_alpha(&mut plan);
        // Callers that collect broken images check every mask themselves.
        if !self.broken.is_noted()
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
        if skip_broken && !self.broken.is_noted() {
            // A broken image must be known before a batch draws it, so everything is decoded once.
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

    /// A warning about the masks of a plan, where they look wrong.
    fn doubt_masks(&self, plan: &[(PlannedView, Recipe)]) -> Result<Option<String>, Error> {
        let size = |recipe: &Recipe| (recipe.camera.width, recipe.camera.height);
        let masks: Vec<_> = plan
            .iter()
            .map(|(_, recipe)| recipe.counted.as_ref().map(|mask| (mask, size(recipe))))
            .collect();
        match (masks::doubt(&masks), plan.first()) {
            (Ok(None), Some((first, _))) if masks.iter().all(Option::is_none) => {
                let told = masks::unused_folder(self.root, &first.name);
                let inverted = self.options.invert_masks;
                Ok(told
                    .or_else(|| inverted.then(|| "--invert-masks, and no view has a mask".into())))
            }
            (Ok(None), _) => {
                let lacks = |(_, recipe): &&(PlannedView, Recipe)| recipe.counted.is_none();
                let without: Vec<&str> = plan
                    .iter()
                    .filter(lacks)
                    .map(|(view, _)| view.name.as_str())
                    .collect();
                let used = masks.iter().flatten().map(|(mask, _)| mask.path.as_path());
                Ok(masks::unused_files(
                    self.root,
                    &used.collect(),
                    &without,
                    plan.len(),
                ))
            }
            // Left out below, with its view.
            (Err(_), _) if self.options.skip_broken => Ok(None),
            (doubt, _) => doubt,
        }
    }

    /// Decodes all images of a plan and keeps the result of `keep`; with `skip_broken`, without those that
    /// fail.
    fn make<T: Send>(
        &self,
        plan: Vec<(PlannedView, Recipe)>,
        keep: impl Fn(ImageData) -> T + Sync,
    ) -> Result<Vec<(PlannedView, Recipe, T)>, Error> {
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
                    // The error covers all frames of that video.
                    Err(Error::VideoDecode { .. }) => {
                        format!("damaged frames of camera {}", view.camera_name)
                    }
                    _ => format!("the view {}", view.name),
                };
                results.push((name, result));
                rest.push((view, recipe));
            }
        }
        let kept = self.broken.keep_readable(results)?;
        let kept = rest.into_iter().zip(kept);
        Ok(kept
            .filter_map(|((view, recipe), made)| Some((view, recipe, made?)))
            .collect())
    }

    /// The view's picture in a folder of masks.
    fn mask_of(&self, view: &PlannedView, folder: &str) -> Option<PathBuf> {
        let image = match &view.source {
            Source::File(image) => Some(image.as_path()),
            Source::Video { .. } => None,
        };
        masks::beside(&self.root.join(folder), &view.name, image)
    }

    fn recipe(&self, view: &PlannedView) -> Result<Recipe, Error> {
        let has_alpha = match &view.source {
            Source::File(path) => {
                let (width, height, has_alpha) = header(path)?;
                check_size(path, &view.camera, (width, height))?;
                has_alpha
            }
            Source::Video { .. } => false,
        };
        let mask = view.mask.clone();
        let mask = mask.or_else(|| self.mask_of(view, MASK_FOLDER));
        let counted = mask.map(|path| CountedMask {
            path,
            inverted: self.options.invert_masks,
        });
        Ok(Recipe {
            source: view.source.clone(),
            size: self.loaded_size((view.camera.width, view.camera.height))?,
            camera: view.camera.clone(),
            lens: view.lens.clone(),
            has_alpha,
            counted,
        })
    }

    /// The size at which an image of this one is loaded.
    fn loaded_size(&self, size: (usize, usize)) -> Result<(usize, usize), Error> {
        let downscale = self.options.downscale;
        let shrink = |side: usize| (side as f64 / downscale).round().max(1.0) as usize;
        let (width, height) = (shrink(size.0), shrink(size.1));
        if downscale > 1.0 && width.min(height) < LEAST_SIDE {
            return Err(Error::LoadOption {
                option: "--downscale",
                expected: format!(
                    "a factor that leaves images of {}x{} at least {LEAST_SIDE} pixels a side",
                    size.0, size.1
                ),
                found: format!("{downscale}, which leaves {width}x{height}"),
            });
        }
        Ok((width, height))
    }

    fn view(
        &self,
        view: PlannedView,
        recipe: &Recipe,
        pixels: Pixels,
        on_demand: bool,
    ) -> Result<View, Error> {
        let motion = match view.partition {
            Partition::Test => self.mask_of(&view, MOTION_FOLDER),
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
        let file = std::fs::metadata(recipe.source.path());
        let mut view = View {
            file_bytes: file.map_or(0, |file| file.len()),
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

/// Pictures of a capture that could be transparent and are opaque have no background: so it is if none of some is transparent
/// anywhere.
fn forget_unused_alpha(plan: &mut [(PlannedView, Recipe)]) {
    let files: Vec<&Path> = plan
        .iter()
        .filter(|(_, recipe)| recipe.has_alpha)
        .filter_map(|(_, recipe)| match &recipe.source {
            Source::File(path) => Some(path.as_path()),
            Source::Video { .. } => None,
        })
        .collect();
    let n = files.len().min(ASKED_FOR_ALPHA);
    let asked = (0..n).into_par_iter().map(|k| files[k * files.len() / n]);
    if !asked.any(is_transparent) {
        for (_, recipe) in plan {
            recipe.has_alpha = false;
        }
    }
}
