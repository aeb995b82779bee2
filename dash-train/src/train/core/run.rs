//! The state of a run.

use std::collections::BTreeSet;
use std::sync::Arc;

use burn::tensor::Device;
use dash_model::{
    DynamicScene, Gaps, GaussianRows, Gaussians, OffsetPlacement, SceneSettings, SpaceBox,
    TrajectoryBasis,
};
use rand_pcg::Pcg64;

use super::backdrop::Backdrop;
use super::capture::TimeSpan;
use super::config::{DensifyConfig, ScheduleConfig};
use super::densify::SceneScale;
use super::first_points::{FirstPoints, Start};
use super::initial::{Region, near_plane};
use super::notes::Notes;
use super::optimizer::Optimizer;
use super::rates::Rates;
use super::sampler::ViewSampler;
use super::sets::{RowEdit, Set};
use super::skipped::Skipped;
use super::times::Times;
use super::view_sums::ViewSums;
use crate::Error;
use crate::dataset::{Dataset, View};

/// Scale of the first Gaussians where no neighbour says more, in units of the extent.
const FIRST_SCALE: f32 = 0.01;

/// What density control gathers of one set.
#[derive(Debug, Clone, Default)]
pub struct SetState {
    /// Gradients of screen positions since the last round.
    pub gathered: ViewSums,
}

/// Everything that a run consists of, beside its extensions and its density control.
pub struct Run<M> {
    /// What is done at which step.
    pub config: ScheduleConfig,
    /// Learning rates.
    pub rates: Rates,
    /// Where tensors live, with gradients.
    pub device: Device,
    /// The data.
    pub dataset: Arc<Dataset>,
    /// Indices of the views that are trained on.
    pub train_views: Vec<usize>,
    /// Indices of views that are neither trained on nor tested.
    pub validation_views: Vec<usize>,
    /// Size of the scene, world units.
    pub extent: f32,
    /// The part of space that the capture is about.
    pub region: SpaceBox,
    /// The shortest span around the clip's middle in which the cameras show the scene's shape; `None` of a camera that
    /// is carried along.
    pub start: Option<TimeSpan>,
    /// The training views' times.
    pub times: Times,
    /// What was known before the first step.
    pub(super) first: Arc<Start>,
    /// What is trained.
    pub scene: DynamicScene,
    /// Gaussians of another run that are drawn with it and not trained.
    pub backdrop: Option<Backdrop>,
    /// Its optimizer.
    pub optimizer: Optimizer,
    /// The source of everything random.
    pub rng: Pcg64,
    /// The order of views.
    pub sampler: ViewSampler,
    /// Steps done.
    pub step: usize,
    /// Density control's state of the static set.
    pub static_state: SetState,
    /// The same of the dynamic set.
    pub dynamic_state: SetState,
    /// Whether the present step updates the scene, and not the method's own modules alone.
    pub updates_scene: bool,
    /// The step after which no Gaussian comes, goes or changes sets, if there is one.
    pub frozen_after: Option<usize>,
    /// The method's own state.
    pub method: M,
    /// Edits of rows that extensions have not been told yet.
    pub(super) edits: Vec<RowEdit>,
    /// What was noted of steps on the device.
    pub(crate) notes: Notes,
    /// Mean loss and PSNR of the steps that were read last.
    pub(super) last_means: [f32; 2],
    /// Steps left out because something was not finite.
    pub(super) skipped: Skipped,
    /// Seconds that steps have waited for images.
    pub(super) waited_secs: f64,
}

impl<M> Run<M> {
    /// A run at its first step. `first_points` may hold its points; `method` makes the method's state of what is known about
    /// the capture.
    ///
    /// # Errors
    /// When no view is left to train on, or an image can't be read.
    pub fn new(
        config: ScheduleConfig,
        dataset: Arc<Dataset>,
        device: &Device,
        first_points: &FirstPoints,
        method: impl FnOnce(&CaptureFacts) -> M,
    ) -> Result<Self, Error> {
        let device = device.clone().autodiff();
        let known = first_points.find(&config, &dataset)?;
        let (train_views, points, start) = (&known.train_views, &known.points, known.span);
        let background = dataset.background.unwrap_or_default();
        let views = || train_views.iter().map(|&index| &dataset.views[index]);
        let region = Region::of(&dataset, points);
        let near_plane = config
            .near_plane
            .unwrap_or_else(|| near_plane(views(), points));
        let extent = config.extent.unwrap_or(region.extent);
        let scale = FIRST_SCALE * extent;
        let rows =
            GaussianRows::from_points(&points.positions, &points.colors, config.sh_degree, scale);
        let facts = CaptureFacts::of(&dataset, views(), start);
        Ok(Self {
            rates: Rates::of(&config.optimizer),
            scene: DynamicScene {
                static_set: Gaussians::from_rows(&rows, &device),
                dynamic: None,
                settings: SceneSettings {
                    background,
                    sh_degree: 0,
                    near_plane,
                    trajectory_basis: TrajectoryBasis::Linear,
                    offsets: OffsetPlacement::BeforeActivation,
                    gaps: Gaps::default(),
                },
            },
            backdrop: None,
            times: Times::of(views().map(|view| view.time)),
            method: method(&facts),
            static_state: SetState {
                gathered: ViewSums::new(rows.len(), &device),
            },
            dynamic_state: SetState::default(),
            region: region.space,
            optimizer: Optimizer::default(),
            sampler: ViewSampler::default(),
            step: 0,
            updates_scene: true,
            frozen_after: None,
            edits: Vec::new(),
            notes: Notes::new(&device),
            last_means: [f32::NAN; 2],
            skipped: Skipped::default(),
            waited_secs: 0.0,
            config,
            device,
            dataset,
            train_views: train_views.clone(),
            validation_views: known.validation_views.clone(),
            extent,
            start,
            rng: known.rng.clone(),
            first: known,
        })
    }

    /// What density control gathers of a set.
    pub fn state(&mut self, set: Set) -> &mut SetState {
        match set {
            Set::Static => &mut self.static_state,
            Set::Dynamic => &mut self.dynamic_state,
        }
    }

    /// The configuration of a set's density control.
    pub fn densify(&self, set: Set) -> &DensifyConfig {
        match set {
            Set::Static => &self.config.densify.static_set,
            Set::Dynamic => &self.config.densify.dynamic,
        }
    }

    /// What lengths are measured by.
    pub fn scale(&self) -> SceneScale {
        let SpaceBox { min, max, .. } = self.region;
        SceneScale {
            centre: std::array::from_fn(|axis| 0.5 * (min[axis] + max[axis])),
            extent: self.extent,
        }
    }

    /// Whether no Gaussian comes, goes or changes sets any more.
    pub fn is_frozen(&self) -> bool {
        self.frozen_after.is_some_and(|step| self.step > step)
    }

    /// Whether every time by itself shows the scene's shape, as the synchronised cameras of a rig do.
    pub fn is_synchronized(&self) -> bool {
        self.start.is_some_and(TimeSpan::is_one_time)
    }

    /// Seconds that steps have waited for images.
    pub fn waited_secs(&self) -> f64 {
        self.waited_secs
    }

    /// The training views.
    pub fn views(&self) -> impl Iterator<Item = &View> + Clone {
        let views = &self.dataset.views;
        self.train_views.iter().map(|&index| &views[index])
    }
}

/// What a capture is, as far as a method's sizes follow from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CaptureFacts {
    /// Frames of the clip; of a synchronised rig, those that are trained on.
    pub n_frames: usize,
    /// Whether every time by itself shows the scene's shape.
    pub is_synchronized: bool,
}

impl CaptureFacts {
    fn of<'a>(
        dataset: &Dataset,
        train_views: impl Iterator<Item = &'a View>,
        start: Option<TimeSpan>,
    ) -> Self {
        let is_synchronized = start.is_some_and(TimeSpan::is_one_time);
        let trained: BTreeSet<usize> = train_views.map(|view| view.frame).collect();
        Self {
            n_frames: match is_synchronized {
                true => trained.len(),
                false => dataset.n_frames,
            },
            is_synchronized,
        }
    }
}
