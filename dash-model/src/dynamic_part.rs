//! The Gaussians that move, with the field that moves them.

use burn::module::{Module, Param};
use burn::tensor::activation::sigmoid;
use burn::tensor::{Int, Tensor};
use dash_kernels::project::{Activation, ShCoeffs};
use dash_kernels::rows::join_rows;

use crate::gaussians::to_host;
use crate::unseen::turn;
use crate::{DeformationField, Gaussians, Head, ModelError, OffsetPlacement, SceneSettings};

/// Share of a gap's length that must have been seen on both sides of it to tell velocities.
const LEAST_SEEN: f32 = 0.5;

/// The Gaussians that move, and the field that moves them.
#[derive(Module, Debug)]
pub struct DynamicPart {
    /// Canonical Gaussians.
    pub gaussians: Gaussians,
    /// The 4D hash field and its decoder.
    pub field: DeformationField,
}

/// Attributes of the dynamic Gaussians at one time, ready for projection.
#[derive(Debug, Clone)]
pub struct Deformed {
    /// `[N, 3]`, world units.
    pub means: Tensor<2>,
    /// `[N, 4]`.
    pub quats: Tensor<2>,
    /// `[N, 3]`, logarithms or not as `activation` says.
    pub scales: Tensor<2>,
    /// `[N]`, logits or not as `activation` says.
    pub opacities: Tensor<1>,
    /// Colour coefficients, of which the constant ones may change.
    pub sh_coeffs: ShCoeffs,
    /// What projection applies to scales and opacities.
    pub activation: Activation,
}

impl Deformed {
    /// A `share` of the way to how the same Gaussians are at another time. The offsets of both are to the same
    /// canonical quaternions, which are therefore not of opposite signs.
    fn on_the_way_to(self, other: Self, share: f32) -> Self {
        fn between<const D: usize>(from: Tensor<D>, to: Tensor<D>, share: f32) -> Tensor<D> {
            from * (1.0 - share) + to * share
        }
        Self {
            means: between(self.means, other.means, share),
            quats: between(self.quats, other.quats, share),
            scales: between(self.scales, other.scales, share),
            opacities: between(self.opacities, other.opacities, share),
            sh_coeffs: ShCoeffs {
                dc: between(self.sh_coeffs.dc, other.sh_coeffs.dc, share),
                rest: self.sh_coeffs.rest,
            },
            activation: self.activation,
        }
    }
}

impl DynamicPart {
    /// Canonical means moved along their coarse trajectories.
    ///
    /// # Shapes
    /// `-> [N, 3]`
    ///
    /// # Errors
    /// When the trajectories do not fit their basis.
    pub fn coarse_means(
        &self,
        settings: &SceneSettings,
        time: f32,
    ) -> Result<Tensor<2>, ModelError> {
        let means = self.gaussians.means.val();
        let Some(coefficients) = &self.gaussians.trajectories else {
            return Ok(means);
        };
        let basis = settings.trajectory_basis;
        Ok(means + basis.displacement(coefficients.val(), time)?)
    }

    /// The Gaussians at `time`. Through one of [`SceneSettings::gaps`] they go in straight lines from how they are
    /// before to how they are after; those whose velocities before and after agree on where they turned in between go by
    /// there. The field is asked four times then. Beyond an end of what was seen they go on as they came there, as far
    /// as it is that they were seen to come.
    ///
    /// # Source
    /// DASH Eqs. 9-10; the coarse trajectory below the field's offsets and the way through gaps are ours.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn deform(&self, settings: &SceneSettings, time: f32) -> Result<Deformed, ModelError> {
        if let Some(end) = settings.gaps.beyond(time) {
            let mut deformed = self.deform_straight(settings, end.at)?;
            let inner = self.deform_straight(settings, end.inner)?;
            deformed.means = deformed.means * 2.0 - inner.means;
            return Ok(deformed);
        }
        let Some(gap) = settings.gaps.around(time) else {
            return self.deform_straight(settings, time);
        };
        let [from, to] = [gap.from, gap.to].map(|time| self.deform_straight(settings, time));
        let (from, to) = (from?, to?);
        let (before, after) = (from.means.clone(), to.means.clone());
        let mut deformed = from.on_the_way_to(to, gap.share);
        let length = gap.to - gap.from;
        if gap.beside >= LEAST_SEEN * length {
            let means = |time: f32| self.deform_straight(settings, time).map(|at| at.means);
            let scale = length / gap.beside;
            let arrives = (before.clone() - means(gap.from - gap.beside)?) * scale;
            let leaves = (means(gap.to + gap.beside)? - after.clone()) * scale;
            deformed.means = deformed.means + turn(after - before, arrives, leaves, gap.share);
        }
        Ok(deformed)
    }

    /// The Gaussians at `time`, through gaps in straight lines.
    fn deform_straight(&self, settings: &SceneSettings, time: f32) -> Result<Deformed, ModelError> {
        let at = |time: f32| -> Result<Deformed, ModelError> {
            self.deform_from(settings, time, self.features(time)?)
        };
        match settings.gaps.around(time) {
            Some(gap) => Ok(at(gap.from)?.on_the_way_to(at(gap.to)?, gap.share)),
            None => at(time),
        }
    }

    /// The part without a head of its field. What the head adds on average over `times` becomes the
    /// Gaussians' own, where offsets are added before the activation.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn without_head(
        &self,
        settings: &SceneSettings,
        head: Head,
        times: &[f32],
    ) -> Result<Self, ModelError> {
        let mut part = self.clone();
        part.field = part.field.without_head(head);
        if settings.offsets == OffsetPlacement::AfterActivation {
            return Ok(part);
        }
        let own = match head {
            Head::Rotation => &mut part.gaussians.quats,
            Head::Scale => &mut part.gaussians.log_scales,
        };
        let mut value = own.val();
        for &time in times {
            let offsets = self.field.decode(self.features(time)?)?;
            let offset = match head {
                Head::Rotation => offsets.quats,
                Head::Scale => offsets.scales,
            };
            if let Some(offset) = offset {
                value = value + offset / times.len() as f32;
            }
        }
        *own = Param::from_tensor(value.detach());
        Ok(part)
    }

    /// The part without some levels of its field's hash grid, see
    /// [`DeformationField::without_levels`]; `typical` is of [`DynamicPart::mean_features`].
    ///
    /// # Errors
    /// As there.
    pub fn without_levels(&self, left_out: &[usize], typical: &[f32]) -> Result<Self, ModelError> {
        let mut part = self.clone();
        part.field = part.field.without_levels(left_out, typical)?;
        Ok(part)
    }

    /// The part with zeros in the entries of its field's hash grid that its Gaussians read at no time, and how
    /// many entries they read of how many. It looks the same. `None` where the field has no hash grid.
    pub fn without_unread(&self) -> Option<(Self, [usize; 2])> {
        let (field, counts) = self.field.without_unread(self.gaussians.means.val())?;
        let part = Self {
            gaussians: self.gaussians.clone(),
            field,
        };
        Some((part, counts))
    }

    /// What the field's features are on average over the Gaussians and some times.
    ///
    /// # Errors
    /// When there is no time, or a shape does not fit.
    pub fn mean_features(&self, times: &[f32]) -> Result<Vec<f32>, ModelError> {
        let mut sum: Option<Tensor<2>> = None;
        for &time in times {
            let mean = self.features(time)?.mean_dim(0);
            sum = Some(match sum {
                Some(sum) => sum + mean,
                None => mean,
            });
        }
        let sum = sum.ok_or_else(|| ModelError::Config("expected at least one time".into()))?;
        Ok(to_host(sum.detach() / times.len() as f32))
    }

    /// The field's features at the Gaussians' canonical places.
    ///
    /// # Shapes
    /// `-> [N, features]`
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn features(&self, time: f32) -> Result<Tensor<2>, ModelError> {
        let canonical = &self.gaussians;
        let embeddings = canonical.embeddings.as_ref().map(Param::val);
        self.field.features(canonical.means.val(), embeddings, time)
    }

    /// The same, and the features at other points of the field's unit cube, in one lookup: the gradient of a
    /// lookup is as large as the tables, however few the points.
    ///
    /// # Shapes
    /// `rows [M]`: whose embeddings each of `points [M, 4]` has `-> [N, features], [M, features]`
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn features_and_at(
        &self,
        time: f32,
        rows: Tensor<1, Int>,
        points: Tensor<2>,
    ) -> Result<(Tensor<2>, Tensor<2>), ModelError> {
        let canonical = &self.gaussians;
        let own = self.field.space().points_at(canonical.means.val(), time)?;
        let [n, m] = [own.dims()[0], points.dims()[0]];
        let embeddings = canonical.embeddings.as_ref().map(|embeddings| {
            let own = embeddings.val();
            Tensor::cat(vec![own.clone(), own.select(0, rows)], 0)
        });
        let all = join_rows(own, points)?;
        let features = self.field.features_at(all, embeddings)?;
        Ok((features.clone().narrow(0, 0, n), features.narrow(0, n, m)))
    }

    /// The Gaussians at `time`, from the field's features there, as [`DynamicPart::features`] gives them.
    ///
    /// # Shapes
    /// `features [N, features]`
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn deform_from(
        &self,
        settings: &SceneSettings,
        time: f32,
        features: Tensor<2>,
    ) -> Result<Deformed, ModelError> {
        fn plus<const D: usize>(value: Tensor<D>, offset: Option<Tensor<D>>) -> Tensor<D> {
            match offset {
                Some(offset) => value + offset,
                None => value,
            }
        }
        let offsets = self.field.decode(features)?;
        let canonical = &self.gaussians;
        let means = self.coarse_means(settings, time)? + offsets.means;
        let opacity_logits = plus(canonical.opacity_logits.val(), offsets.opacity_logits);
        let own = canonical.sh_coeffs();
        let sh_coeffs = ShCoeffs {
            dc: plus(own.dc, offsets.sh_dc),
            rest: own.rest,
        };
        Ok(match settings.offsets {
            OffsetPlacement::BeforeActivation => Deformed {
                means,
                quats: plus(canonical.quats.val(), offsets.quats),
                scales: plus(canonical.log_scales.val(), offsets.scales),
                opacities: opacity_logits,
                sh_coeffs,
                activation: Activation::Exp,
            },
            OffsetPlacement::AfterActivation => {
                let quats = canonical.quats.val();
                let norm = (quats.clone().powi_scalar(2).sum_dim(1) + 1e-12).sqrt();
                Deformed {
                    means,
                    quats: plus(quats / norm, offsets.quats),
                    scales: plus(canonical.log_scales.val().exp(), offsets.scales),
                    opacities: sigmoid(opacity_logits),
                    sh_coeffs,
                    activation: Activation::Linear,
                }
            }
        })
    }
}
