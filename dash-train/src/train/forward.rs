//! The forward pass of a step: the picture, the losses, and what statistics are taken from.

use std::cell::LazyCell;
use std::ops::RangeInclusive;

use burn::tensor::{Tensor, TensorData};
use dash_kernels::Camera;
use dash_kernels::photometric::photometric;
use dash_kernels::rows::join_rows;

use super::cover::{Cover, nearness, visible_motion};
use super::loss::{opacity, static_motion, weighted_error, where_counted};
use super::optimizer::to_host;
use super::regularity::{Measure, regularity};
use super::trainer::Trainer;
use super::{coarse, target};
use crate::Error;
use crate::dataset::View;

/// Motion from which on more of it costs little more, in shares of the image's width, while the field
/// looks for it.
const FAR_IN_FIELD: f32 = 0.2;
/// The same once every Gaussian has a trajectory of its own.
const FAR_ALONE: f32 = 0.05;
/// Sizes of scenes that are measured in their own units.
const ORDINARY_EXTENTS: RangeInclusive<f32> = 0.05..=2000.0;
/// The size of a room, metres.
const ROOM: f32 = 4.0;

/// What a forward pass leaves for the backward pass and the statistics.
pub(crate) struct Forward {
    pub(super) loss: Tensor<1>,
    /// Mean squared error of the picture.
    pub(super) mse: Tensor<1>,
    /// Zero leaves whose gradients are those of the packed splats, and the splats.
    pub(crate) static_probe: (Tensor<2>, Vec<f32>),
    pub(crate) dynamic_probe: Option<(Tensor<2>, Vec<f32>)>,
}

impl Trainer {
    /// The loss of a view, with what the coarse stages and the regularisers add.
    pub(super) fn forward(&mut self, view: &View) -> Result<Forward, Error> {
        let (camera, time) = (&view.camera, view.time);
        let mut regularisers = Vec::new();
        let mut motion = None;
        let coefficients = coarse::coefficients(self)?;
        let static_splats = match &coefficients {
            None => self.scene.static_splats(camera)?,
            Some(coefficients) => {
                let basis = self.config.decomposition.basis;
                let means = self.scene.static_set.means.val();
                let moved = means + basis.displacement(coefficients.clone(), time)?;
                self.scene.static_splats_at(moved, camera)?
            }
        };
        let splats_on_host = to_host(static_splats.clone());
        let cover = LazyCell::new(|| Cover::of(&splats_on_host, camera));
        if let Some(coefficients) = coefficients {
            let extents = self.extents(coefficients)?;
            motion = Some(extents.clone().detach());
            regularisers.extend(self.motion_cost(extents, &cover));
            regularisers.extend(self.cost_of_forgetting()?);
        }
        let static_leaf = self.probe(&static_splats);
        let joined = static_splats + static_leaf.clone();
        let mut dynamic_probe = None;
        let splats = match self.dynamic_splats(camera, time, &mut regularisers)? {
            None => joined,
            Some(splats) => {
                let on_host = to_host(splats.clone());
                regularisers.extend(self.nearness_of_dynamic(&on_host, camera));
                let leaf = self.probe(&splats);
                let probed = splats + leaf.clone();
                dynamic_probe = Some((leaf, on_host));
                join_rows(joined, probed)?
            }
        };
        let rendering = self.scene.rasterize(splats, camera)?;
        let image = rendering.image;
        let (image, target, of_moved) = match self.plain_target(view)? {
            Some(target) => (image, target, None),
            None => self.with_target(image, view)?,
        };
        if let Some(weights) = of_moved {
            let error = weighted_error(image.clone(), target.clone(), weights);
            regularisers.push(error * (1.0 - self.config.loss.dssim));
        }
        // Eqs. 6 and 12.
        let judged = photometric(image, target, self.config.loss.dssim)?;
        let mut loss = judged.loss;
        let weight = self.config.loss.static_opacity;
        if weight > 0.0 {
            regularisers.extend(opacity(&self.scene.static_set).map(|mean| mean * weight));
        }
        let weight = self.config.loss.nearness;
        if weight > 0.0 {
            let motion = motion.map_or_else(Vec::new, to_host);
            let cost = nearness(&self.scene.static_set, &cover, &motion);
            regularisers.extend(cost.map(|cost| cost * weight));
        }
        for term in regularisers {
            loss = loss + term;
        }
        Ok(Forward {
            loss,
            mse: judged.mse,
            static_probe: (static_leaf, splats_on_host),
            dynamic_probe,
        })
    }

    /// A view's picture on the device, where that is all that is needed of it on the host.
    fn plain_target(&mut self, view: &View) -> Result<Option<Tensor<3>>, Error> {
        if self.looks_at_moved() {
            return Ok(None);
        }
        self.moved = None;
        Ok(target::as_bytes(view, &self.device)?)
    }

    /// A picture and that of its view, zero where the latter does not count, and the [`Moved::weights`] of its pixels.
    ///
    /// [`Moved::weights`]: super::moved::Moved::weights
    fn with_target(
        &mut self,
        image: Tensor<3>,
        view: &View,
    ) -> Result<(Tensor<3>, Tensor<3>, Option<Vec<f32>>), Error> {
        let camera = &view.camera;
        let (target, counted) = view.rgb_and_counted(self.scene.settings.background)?;
        let of_moved = self.weights_of_moved(view, &target)?;
        let target = TensorData::new(target, [camera.height, camera.width, 3]);
        let target = Tensor::<3>::from_data(target, &self.device);
        let (image, target) = match counted {
            None => (image, target),
            Some(counted) => where_counted(image, target, counted),
        };
        Ok((image, target, of_moved))
    }

    /// Packed splats of the dynamic Gaussians; `None` without any. What keeps the field regular joins the
    /// regularisers, from the same lookup of the field.
    fn dynamic_splats(
        &mut self,
        camera: &Camera,
        time: f32,
        regularisers: &mut Vec<Tensor<1>>,
    ) -> Result<Option<Tensor<2>>, Error> {
        let Some(dynamic) = &self.scene.dynamic else {
            return Ok(None);
        };
        let loss = &self.config.loss;
        let is_steady = loss.steadiness > 0.0 && !coarse::shown_at_once(self.start_part);
        let is_smooth = loss.smoothness > 0.0 && self.step.is_multiple_of(loss.smoothness_interval);
        if !is_smooth && !is_steady || dynamic.gaussians.is_empty() {
            return Ok(self.scene.dynamic_splats(camera, time)?);
        }
        let rng = &mut self.rng;
        let around = is_steady.then(|| self.times.around(time, rng)).flatten();
        let measure = Measure {
            share: loss.smoothness_share,
            step: is_smooth.then_some(loss.smoothness_step),
            around,
            extent: self.extent,
        };
        let settings = &self.scene.settings;
        let regularity = regularity(dynamic, settings, time, &measure, rng)?;
        let weight = loss.smoothness * loss.smoothness_interval as f32;
        regularisers.extend(regularity.smoothness.map(|term| term * weight));
        regularisers.extend(regularity.unsteadiness.map(|term| term * loss.steadiness));
        let deformed = dynamic.deform_from(settings, time, regularity.features)?;
        Ok(Some(self.scene.deformed_splats(deformed, camera)?))
    }

    /// What the dynamic Gaussians pay for what they cover of a picture from near, if anything.
    fn nearness_of_dynamic(&self, splats: &[f32], camera: &Camera) -> Option<Tensor<1>> {
        let weight = self.config.loss.nearness;
        let dynamic = self.scene.dynamic.as_ref().filter(|_| weight > 0.0)?;
        let cover = Cover::of(splats, camera);
        nearness(&dynamic.gaussians, &cover, &[]).map(|cost| cost * weight)
    }

    /// What the coarse field pays for having forgotten where fast things were found.
    fn cost_of_forgetting(&self) -> Result<Option<Tensor<1>>, Error> {
        let weight = self.config.loss.found_places;
        let Some(field) = self.motion.as_ref().filter(|_| weight > 0.0) else {
            return Ok(None);
        };
        let basis = self.config.decomposition.basis;
        let cost = self
            .found_places
            .cost(field, basis, self.step, &self.device)?;
        Ok(cost.map(|cost| cost * weight))
    }

    /// A leaf of zeros: added to packed splats, its gradient is theirs.
    fn probe(&self, splats: &Tensor<2>) -> Tensor<2> {
        Tensor::zeros(splats.dims(), &self.device).require_grad()
    }

    /// How far the trajectories of `coefficients [N, B * 3]` go, `[N]`, world units. The smallest length
    /// that this tells from rest is a millionth, so that scenes of an extraordinary size are measured in
    /// units that suit them.
    pub(crate) fn extents(&self, coefficients: Tensor<2>) -> Result<Tensor<1>, Error> {
        let basis = self.config.decomposition.basis;
        Ok(match motion_unit(self.extent) {
            None => basis.extent(coefficients)?,
            Some(unit) => basis.extent(coefficients / unit)? * unit,
        })
    }

    /// The cost of motions `[N]`: Eq. 5 while the field looks for motion; of every Gaussian as it
    /// appears in this view, once each has a trajectory of its own.
    fn motion_cost(&self, extents: Tensor<1>, cover: &Cover) -> Option<Tensor<1>> {
        let (space, loss) = (self.motion_space.as_ref()?, &self.config.loss);
        // A cost of no weight is not worked out.
        let visible = |weight: f32, far: f32| {
            (weight > 0.0).then(|| visible_motion(extents.clone(), cover, far) * weight)
        };
        if self.motion.is_none() {
            return visible(loss.visible_motion, FAR_ALONE);
        }
        let held = static_motion(extents.clone(), &self.held_still, space) * loss.static_motion;
        Some(match visible(loss.field_motion, FAR_IN_FIELD) {
            Some(cost) => held + cost,
            None => held,
        })
    }
}

/// What makes a scene that is much smaller or larger than a room or a town about as large as a room: a power of
/// two, so that dividing by it rounds nothing.
fn motion_unit(extent: f32) -> Option<f32> {
    let extraordinary = !ORDINARY_EXTENTS.contains(&extent) && extent > 0.0 && extent.is_finite();
    extraordinary.then(|| (extent / ROOM).log2().round().exp2())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::Device;
    use dash_model::{DeformationField, DynamicPart, GaussianRows, Gaussians, SpaceBox};
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;
    use crate::synth;
    use crate::train::{Preset, TrainConfig};

    /// At its first step, and a view of it.
    fn trainer(config: TrainConfig) -> (Trainer, View) {
        let dataset = Arc::new(synth::loaded(4, 3, [32, 24]));
        let view = dataset.views[0].clone();
        let trainer = Trainer::new(config, dataset, &Device::flex()).expect("valid");
        (trainer, view)
    }

    /// Such dynamic Gaussians with a fresh field.
    fn part(trainer: &Trainer, rows: &GaussianRows) -> DynamicPart {
        let deformation = &trainer.config.field.deformation;
        let (space, mut rng) = (SpaceBox::fixed(10.0), Pcg64::seed_from_u64(1));
        let field = DeformationField::new(deformation, space, &mut rng, &trainer.device);
        DynamicPart {
            gaussians: Gaussians::from_rows(rows, &trainer.device),
            field: field.expect("valid"),
        }
    }

    /// By the gradients of their opacities with the cost and without.
    #[test]
    fn dynamic_gaussians_pay_for_what_they_cover_from_near() {
        let mut config = TrainConfig::preset(Preset::Quick);
        config.loss.smoothness = 0.0;
        config.loss.steadiness = 0.0;
        let (mut trainer, view) = trainer(config);
        let (eye, forward) = (view.camera.position(), view.camera.forward());
        let before_it = |away: f64| std::array::from_fn(|k| (eye[k] + away * forward[k]) as f32);
        let places = [before_it(4.0), before_it(1.0)];
        let mut rows = GaussianRows::from_points(&places, &[[0.0; 3]; 2], 0, 0.1);
        rows.log_scales = vec![[0.5_f32.ln(); 3], [0.05_f32.ln(); 3]];
        rows.opacity_logits = vec![2.0, -2.0];
        trainer.scene.settings.near_plane = 0.1;
        trainer.scene.dynamic = Some(part(&trainer, &rows));
        let mut slopes = |weight: f32| {
            trainer.config.loss.nearness = weight;
            let gradients = trainer.forward(&view).expect("renders").loss.backward();
            let dynamic = trainer.scene.dynamic.as_ref().expect("given");
            let logits = dynamic.gaussians.opacity_logits.val();
            let slopes = logits.grad(&gradients).expect("of logits");
            to_host(Tensor::<1>::from_inner(slopes))
        };
        let (without, with) = (slopes(0.0), slopes(1.0));
        assert_eq!(with[0], without[0], "at the typical distance");
        assert!(with[1] > without[1] + 1e-4, "{with:?} {without:?}");
    }

    #[test]
    fn smoothness_is_measured_at_one_step_of_its_interval_with_the_weight_of_all() {
        let mut config = TrainConfig::preset(Preset::Quick);
        config.loss.steadiness = 0.0;
        config.loss.smoothness = 0.5;
        config.loss.smoothness_share = 1.0;
        // A step that is large beside the cells, so that features differ.
        config.loss.smoothness_step = [0.4, 0.1];
        let (mut trainer, view) = trainer(config);
        let rows = GaussianRows::from_points(&[[0.1; 3], [-0.2; 3]], &[[0.5; 3]; 2], 0, 0.1);
        trainer.scene.dynamic = Some(part(&trainer, &rows));
        let mut cost = |interval: usize, step: usize| {
            trainer.config.loss.smoothness_interval = interval;
            trainer.step = step;
            trainer.rng = Pcg64::seed_from_u64(2);
            let mut terms = Vec::new();
            let splats = trainer.dynamic_splats(&view.camera, 0.5, &mut terms);
            splats.expect("valid").expect("some are dynamic");
            let terms = terms.into_iter().map(|term| to_host(term)[0]);
            terms.collect::<Vec<f32>>()
        };
        let [each] = cost(1, 3)[..] else {
            panic!("one term");
        };
        assert!(each > 0.0);
        assert!(cost(4, 3).is_empty());
        let [all] = cost(4, 8)[..] else {
            panic!("one term");
        };
        assert!((all / (4.0 * each) - 1.0).abs() < 1e-6, "{all} {each}");
    }
}
