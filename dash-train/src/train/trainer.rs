//! The three stages: warm-up, decomposition, 4D.

use std::sync::Arc;

use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Gradients, Tensor, TensorData};
use dash_kernels::splats::{DEPTH, N_COLUMNS, RADIUS_X};
use dash_model::decomposition::{MotionStatistics, select_dynamic};
use dash_model::{DynamicScene, GaussianRows, Gaussians, MotionField, SceneSettings, SpaceBox};
use rand::SeedableRng;
use rand_pcg::Pcg64;

use super::config::{MotionMeasure, TimeWindow, TrainConfig};
use super::density::{DensityStatistics, RESET_OPACITY, control_density};
use super::initial::{initial_points, scene_extent};
use super::loss::{photometric, smoothness, static_motion};
use super::optimizer::{Optimizer, to_host};
use super::sampler::ViewSampler;
use super::{split, validation};
use crate::TrainError;
use crate::dataset::{Dataset, Split, View};

/// Path prefix of the static Gaussians' parameters.
pub(crate) const STATIC: &str = "scene.static_set.";
/// Path prefix of the dynamic Gaussians' parameters.
pub(crate) const DYNAMIC: &str = "scene.dynamic.gaussians.";

/// Share of the decomposition stage after which motion statistics count.
const SETTLED: f32 = 0.75;
/// Share of the decomposition stage after which a growing window has all times.
const GROWN: f32 = 0.7;
/// Cameras at the first time that a growing window needs.
const MIN_CAMERAS: usize = 4;
/// Steps between two gatherings of motion statistics.
const STATISTICS_INTERVAL: usize = 4;
/// Steps between two looks at which Gaussians Eq. 5 holds still.
const MASK_INTERVAL: usize = 50;

/// What one step did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepReport {
    /// Steps done so far.
    pub step: usize,
    /// The whole loss.
    pub loss: f32,
    /// Peak signal-to-noise ratio of the step's training view, dB.
    pub psnr: f32,
    /// Static Gaussians.
    pub n_static: usize,
    /// Dynamic Gaussians.
    pub n_dynamic: usize,
}

/// A training run in memory.
pub struct Trainer {
    pub(crate) config: TrainConfig,
    pub(crate) device: Device,
    pub(crate) dataset: Arc<Dataset>,
    pub(crate) train_views: Vec<usize>,
    pub(crate) validation_views: Vec<usize>,
    /// Size of the scene, world units.
    pub(crate) extent: f32,
    pub(crate) scene: DynamicScene,
    pub(crate) motion: Option<MotionField>,
    pub(crate) motion_space: Option<SpaceBox>,
    pub(crate) optimizer: Optimizer,
    pub(crate) rng: Pcg64,
    pub(crate) sampler: ViewSampler,
    pub(crate) step: usize,
    pub(crate) density_static: DensityStatistics,
    pub(crate) density_dynamic: DensityStatistics,
    pub(crate) motion_statistics: MotionStatistics,
    pub(crate) held_still: Vec<bool>,
}

/// What a forward pass leaves for the backward pass and the statistics.
struct Forward {
    loss: Tensor<1>,
    image: Tensor<3>,
    target: Tensor<3>,
    /// Zero leaves whose gradients are those of the packed splats, and the splats.
    static_probe: (Tensor<2>, Tensor<2>),
    dynamic_probe: Option<(Tensor<2>, Tensor<2>)>,
    /// Motion of every Gaussian, world units.
    motion: Option<Tensor<1>>,
}

impl Trainer {
    /// A run at its first step.
    ///
    /// # Errors
    /// When the configuration is out of range or no view is left to train on.
    pub fn new(
        config: TrainConfig,
        dataset: Arc<Dataset>,
        device: &Device,
    ) -> Result<Self, TrainError> {
        config.validate()?;
        let device = device.clone().autodiff();
        let (train_views, validation_views) = validation::hold_out(&dataset);
        if train_views.is_empty() {
            return Err(TrainError::NoTrainingViews {
                dataset: dataset.root.clone(),
            });
        }
        let mut rng = Pcg64::seed_from_u64(config.seed);
        let background = config.background.or(dataset.background).unwrap_or([0.0; 3]);
        let points = initial_points(
            &dataset,
            &train_views,
            background,
            config.max_initial_points,
            &mut rng,
        );
        let extent = config
            .learning_rates
            .extent
            .unwrap_or_else(|| scene_extent(&dataset, &points.positions));
        let rows = GaussianRows::from_points(
            &points.positions,
            &points.colors,
            config.sh_degree,
            0.01 * extent,
        );
        let scene = DynamicScene {
            static_set: Gaussians::from_rows(&rows, &device),
            dynamic: None,
            settings: SceneSettings {
                background,
                sh_degree: 0,
                trajectory_basis: config.decomposition.basis,
                offsets: config.field.offsets,
            },
        };
        let n = rows.len();
        Ok(Self {
            config,
            device,
            dataset,
            train_views,
            validation_views,
            extent,
            scene,
            motion: None,
            motion_space: None,
            optimizer: Optimizer::default(),
            rng,
            sampler: ViewSampler::default(),
            step: 0,
            density_static: DensityStatistics::new(n),
            density_dynamic: DensityStatistics::new(0),
            motion_statistics: MotionStatistics::default(),
            held_still: Vec::new(),
        })
    }

    /// The scene as trained so far.
    pub fn scene(&self) -> &DynamicScene {
        &self.scene
    }

    /// The configuration of the run.
    pub fn config(&self) -> &TrainConfig {
        &self.config
    }

    /// Steps done so far.
    pub fn steps_done(&self) -> usize {
        self.step
    }

    /// Whether all steps are done.
    pub fn is_finished(&self) -> bool {
        self.step >= self.config.iterations
    }

    /// Mean PSNR over views that are neither trained on nor tested, dB; `None` when none are held
    /// out.
    ///
    /// # Errors
    /// When rendering fails.
    pub fn validation_psnr(&self) -> Result<Option<f64>, TrainError> {
        validation::psnr(&self.scene, &self.dataset, &self.validation_views)
    }

    /// Whether anything may move in this run.
    pub(crate) fn may_move(&self) -> bool {
        self.config.decomposition.enabled && self.dataset.n_frames > 1
    }

    /// One optimisation step, with what its step number brings: stage changes, density control.
    ///
    /// # Errors
    /// When the loss is not finite, or a kernel refuses its input.
    pub fn step(&mut self) -> Result<StepReport, TrainError> {
        self.enter_stage()?;
        let sh_interval = self.config.step_at(self.config.sh_interval).max(1);
        self.scene.settings.sh_degree = (self.step / sh_interval).min(self.config.sh_degree);

        let dataset = self.dataset.clone();
        let view = &dataset.views[self.next_view()];
        let forward = self.forward(view)?;
        let loss = to_host(forward.loss.clone())[0];
        if !loss.is_finite() {
            return Err(TrainError::NotFinite {
                step: self.step,
                view: view.name.clone(),
            });
        }
        let mse = to_host(
            (forward.image.clone() - forward.target.clone())
                .powi_scalar(2)
                .mean(),
        )[0];
        let mut gradients = forward.loss.backward();
        self.gather_statistics(&forward, view, &mut gradients);
        drop(forward);
        self.update(&mut gradients);
        self.step += 1;
        self.control_density();
        self.review()?;

        let (n_static, n_dynamic) = self.scene.counts();
        Ok(StepReport {
            step: self.step,
            loss,
            psnr: -10.0 * mse.max(1e-10).log10(),
            n_static,
            n_dynamic,
        })
    }

    /// Changes stage where the step number says so.
    fn enter_stage(&mut self) -> Result<(), TrainError> {
        if !self.may_move() {
            return Ok(());
        }
        let stages = &self.config.stages;
        let (warmup, end) = (
            self.config.step_at(stages.warmup),
            self.config.step_at(stages.decomposition),
        );
        if self.step == warmup && warmup < end {
            split::start_motion(self)?;
            self.sampler.restart();
        }
        if self.step == end {
            split::split(self)?;
            self.sampler.restart();
        }
        Ok(())
    }

    /// The view to train on.
    fn next_view(&mut self) -> usize {
        let window = self.time_window();
        let (views, train_views) = (&self.dataset.views, &self.train_views);
        let index = self.sampler.next(
            train_views.len(),
            |index| views[train_views[index]].time <= window,
            window < 1.0,
            &mut self.rng,
        );
        train_views[index]
    }

    /// The latest time that is trained on at this step.
    fn time_window(&self) -> f32 {
        let stages = &self.config.stages;
        let first = self
            .train_views
            .iter()
            .map(|&i| self.dataset.views[i].time)
            .fold(1.0, f32::min);
        let at_first = self
            .train_views
            .iter()
            .filter(|&&i| self.dataset.views[i].time == first)
            .count();
        if stages.window == TimeWindow::All || !self.may_move() || at_first < MIN_CAMERAS {
            return 1.0;
        }
        let (warmup, end) = (
            self.config.step_at(stages.warmup),
            self.config.step_at(stages.decomposition),
        );
        if self.step < warmup {
            return first;
        }
        let grown = (self.step - warmup) as f32 / (GROWN * (end - warmup).max(1) as f32);
        (first + (1.0 - first) * grown).min(1.0)
    }

    fn forward(&mut self, view: &View) -> Result<Forward, TrainError> {
        let (camera, time) = (&view.camera, view.time);
        let mut regularisers = Vec::new();
        let mut motion_extent = None;
        let static_splats = match &self.motion {
            None => self.scene.static_splats(camera)?,
            Some(field) => {
                let means = self.scene.static_set.means.val();
                let coefficients = field.coefficients(means.clone())?;
                let moved = means + field.basis().displacement(coefficients.clone(), time);
                let extents = field.extent(coefficients);
                if let Some(space) = &self.motion_space {
                    let term = static_motion(extents.clone(), &self.held_still, space);
                    regularisers.push(term * self.config.loss.static_motion);
                }
                motion_extent = Some(extents.detach());
                self.scene.static_splats_at(moved, camera)?
            }
        };
        let static_leaf = self.probe(&static_splats);
        let joined = static_splats.clone() + static_leaf.clone();
        let mut dynamic_probe = None;
        let splats = match self.scene.dynamic_splats(camera, time)? {
            None => joined,
            Some(splats) => {
                let leaf = self.probe(&splats);
                let probed = splats.clone() + leaf.clone();
                dynamic_probe = Some((leaf, splats));
                Tensor::cat(vec![joined, probed], 0)
            }
        };
        let rendering = self.scene.rasterize(splats, camera)?;
        let image = rendering.rgb();
        let target = Tensor::<3>::from_data(
            TensorData::new(
                view.rgb(self.scene.settings.background),
                [camera.height, camera.width, 3],
            ),
            &self.device,
        );
        let mut loss = photometric(image.clone(), target.clone(), self.config.loss.dssim)?;
        if self.config.loss.smoothness > 0.0
            && let Some(dynamic) = self
                .scene
                .dynamic
                .as_ref()
                .filter(|d| !d.gaussians.is_empty())
        {
            let means = dynamic.gaussians.means.val();
            let step = self.config.loss.smoothness_step;
            let term = smoothness(&dynamic.field, means, time, step, &mut self.rng)?;
            regularisers.push(term * self.config.loss.smoothness);
        }
        if self.config.loss.dynamic_opacity > 0.0
            && let Some(dynamic) = self
                .scene
                .dynamic
                .as_ref()
                .filter(|d| !d.gaussians.is_empty())
        {
            // Per Gaussian of the whole scene, so that few dynamic ones are not pressed harder.
            let (n_static, n_dynamic) = self.scene.counts();
            let weight = self.config.loss.dynamic_opacity / (n_static + n_dynamic) as f32;
            let opacities = sigmoid(dynamic.gaussians.opacity_logits.val());
            regularisers.push(opacities.sum() * weight);
        }
        for term in regularisers {
            loss = loss + term;
        }
        Ok(Forward {
            loss,
            image: image.detach(),
            target,
            static_probe: (static_leaf, static_splats),
            dynamic_probe,
            motion: motion_extent,
        })
    }

    /// A leaf of zeros: added to packed splats, its gradient is theirs.
    fn probe(&self, splats: &Tensor<2>) -> Tensor<2> {
        Tensor::zeros(splats.dims(), &self.device).require_grad()
    }

    fn gather_statistics(&mut self, forward: &Forward, view: &View, gradients: &mut Gradients) {
        let camera = &view.camera;
        let half_size = [camera.width as f32 / 2.0, camera.height as f32 / 2.0];
        let splats = to_host(forward.static_probe.1.clone());
        if let Some(v_splats) = forward.static_probe.0.grad_remove(gradients) {
            self.density_static
                .add(&to_host(v_splats), &splats, half_size);
        }
        if let Some((leaf, splats)) = &forward.dynamic_probe
            && let Some(v_splats) = leaf.grad_remove(gradients)
        {
            self.density_dynamic
                .add(&to_host(v_splats), &to_host(splats.clone()), half_size);
        }
        if let Some(extents) = &forward.motion {
            self.gather_motion(&to_host(extents.clone()), &splats, view);
        }
    }

    /// Motion of each visible Gaussian as this view shows it.
    fn gather_motion(&mut self, extents: &[f32], splats: &[f32], view: &View) {
        let stages = &self.config.stages;
        let settled = stages.warmup + SETTLED * (stages.decomposition - stages.warmup);
        if self.step >= self.config.step_at(settled)
            && self.step.is_multiple_of(STATISTICS_INTERVAL)
        {
            let focal = (view.camera.fx / view.camera.width as f64) as f32;
            let measure = self.config.decomposition.measure;
            let (motion, weights): (Vec<f32>, Vec<f32>) = extents
                .iter()
                .zip(splats.chunks_exact(N_COLUMNS))
                .map(|(&extent, splat)| {
                    let depth = splat[DEPTH];
                    let visible = splat[RADIUS_X] > 0.0 && depth > 0.0;
                    let motion = match measure {
                        MotionMeasure::World => extent,
                        MotionMeasure::DistanceWeighted => extent / (depth * depth + 1e-6),
                        MotionMeasure::Screen => extent * focal / depth,
                    };
                    (motion, if visible { 1.0 } else { 0.0 })
                })
                .unzip();
            self.motion_statistics.add(&motion, &weights);
        }
        if self.step.is_multiple_of(MASK_INTERVAL) {
            self.held_still = self.dynamic_mask().iter().map(|dynamic| !dynamic).collect();
        }
    }

    /// Which Gaussians move, as far as the statistics know.
    pub(crate) fn dynamic_mask(&self) -> Vec<bool> {
        let rule = &self.config.decomposition;
        select_dynamic(&self.motion_statistics.means(), rule.quantile, rule.floor)
    }

    fn update(&mut self, gradients: &mut Gradients) {
        let rates = self.config.learning_rates.clone();
        let progress = self.step as f32 / self.config.iterations as f32;
        let decay = |from: f32, to: f32| {
            if from <= 0.0 || to <= 0.0 {
                from
            } else {
                from * (to / from).powf(progress)
            }
        };
        let means = decay(rates.means, rates.means_final) * self.extent;
        let trajectories = decay(
            rates.trajectories,
            rates.trajectories * rates.means_final / rates.means.max(1e-30),
        ) * self.extent;
        let field = decay(1.0, rates.field_final);
        let rate = move |name: &str| match name.rsplit('.').next() {
            Some("means") => means,
            Some("quats") => rates.quats,
            Some("log_scales") => rates.scales,
            Some("opacity_logits") => rates.opacities,
            Some("sh_dc") => rates.sh_dc,
            Some("sh_rest") => rates.sh_rest,
            Some("trajectories") => trajectories,
            Some("table") if name.starts_with("motion.") => rates.motion_grid,
            Some("table") => rates.grid * field,
            _ if name.starts_with("motion.") => rates.motion_network,
            _ => rates.network * field,
        };
        self.scene = self
            .optimizer
            .step("scene", self.scene.clone(), gradients, rate);
        if let Some(motion) = self.motion.take() {
            // The coarse field comes to rest by the end of its stage: Adam's steps do not get
            // smaller by themselves, and what still jitters would pass for motion.
            let stages = &self.config.stages;
            let (warmup, end) = (
                self.config.step_at(stages.warmup),
                self.config.step_at(stages.decomposition),
            );
            let left = (end - self.step) as f32 / (end - warmup).max(1) as f32;
            let settle = (left / (1.0 - GROWN)).min(1.0);
            self.motion = Some(
                self.optimizer
                    .step("motion", motion, gradients, |name| rate(name) * settle),
            );
        }
    }

    fn control_density(&mut self) {
        let config = self.config.clone();
        let due = |density: &super::config::DensityConfig, step: usize| {
            step >= config.step_at(density.from)
                && step < config.step_at(density.until)
                && step.is_multiple_of(density.interval)
        };
        let was_reset =
            |interval: usize, since: usize, step: usize| interval > 0 && step > since + interval;
        let (step, extent) = (self.step, self.extent);
        if due(&config.density_static, step) {
            let density = &config.density_static;
            let rows = self.scene.static_set.to_rows();
            let prune_large = was_reset(density.opacity_reset_interval, 0, step);
            let round = control_density(
                &rows,
                &self.density_static,
                density,
                extent,
                prune_large,
                &mut self.rng,
            );
            self.optimizer
                .edit_rows(STATIC, &round.sources, &round.fresh, rows.len());
            self.scene.static_set = Gaussians::from_rows(&round.rows, &self.device);
            self.density_static = DensityStatistics::new(round.rows.len());
            if self.motion.is_some() {
                self.motion_statistics = self.motion_statistics.gather(&round.sources);
                self.held_still = round
                    .sources
                    .iter()
                    .map(|&row| self.held_still[row])
                    .collect();
            }
        }
        let start = config.step_at(config.stages.decomposition);
        if due(&config.density_dynamic, step)
            && let Some(dynamic) = &mut self.scene.dynamic
        {
            let density = &config.density_dynamic;
            let rows = dynamic.gaussians.to_rows();
            let prune_large = was_reset(density.opacity_reset_interval, start, step);
            let round = control_density(
                &rows,
                &self.density_dynamic,
                density,
                extent,
                prune_large,
                &mut self.rng,
            );
            self.optimizer
                .edit_rows(DYNAMIC, &round.sources, &round.fresh, rows.len());
            dynamic.gaussians = Gaussians::from_rows(&round.rows, &self.device);
            self.density_dynamic = DensityStatistics::new(round.rows.len());
        }
        let resets = |density: &super::config::DensityConfig, since: usize| {
            let interval = density.opacity_reset_interval;
            interval > 0
                && step > since
                && step < config.step_at(density.until)
                && (step - since).is_multiple_of(interval)
        };
        // While motion is being followed, what it follows must stay in sight.
        if self.motion.is_none() && resets(&config.density_static, 0) {
            self.scene.static_set = with_low_opacity(self.scene.static_set.clone());
            self.optimizer.reset(&format!("{STATIC}opacity_logits"));
        }
        if resets(&config.density_dynamic, start)
            && let Some(dynamic) = &mut self.scene.dynamic
        {
            dynamic.gaussians = with_low_opacity(dynamic.gaussians.clone());
            self.optimizer.reset(&format!("{DYNAMIC}opacity_logits"));
        }
    }

    /// Lets dynamic Gaussians that do not move become static.
    fn review(&mut self) -> Result<(), TrainError> {
        let interval = self.config.decomposition.review_interval;
        let start = self.config.step_at(self.config.stages.decomposition);
        if interval > 0 && self.step > start && (self.step - start).is_multiple_of(interval) {
            split::review(self)?;
        }
        Ok(())
    }

    /// Indices of the views that are trained on.
    pub fn train_views(&self) -> &[usize] {
        &self.train_views
    }

    /// Views of the dataset's test split.
    pub fn test_views(&self) -> impl Iterator<Item = &View> {
        self.dataset
            .views
            .iter()
            .filter(|view| view.split == Split::Test)
    }
}

/// The same Gaussians, none more opaque than [`RESET_OPACITY`].
fn with_low_opacity(mut set: Gaussians) -> Gaussians {
    let limit = dash_model::logit(RESET_OPACITY);
    set.opacity_logits = set
        .opacity_logits
        .map(|logits| Tensor::from_inner(logits.inner().clamp_max(limit)).require_grad());
    set
}
