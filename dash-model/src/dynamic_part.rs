//! The dynamic Gaussians and their deformation field.

mod deformed;
mod pruning;

use burn::module::{Module, Param};
use burn::tensor::activation::sigmoid;
use burn::tensor::{Int, Tensor, TensorData};
use dash_kernels::deform::{Ellipsoids, Path, deform};
use dash_kernels::project::{Activation, ShCoeffs};
use dash_kernels::space_time::Beside;

pub use deformed::Deformed;

use crate::time_gaps::turn;
use crate::{DeformationField, Gaussians, ModelError, OffsetPlacement, SceneSettings};

/// Share of a gap's length that pictures must cover on both sides of it, so that velocities can be measured.
const LEAST_OBSERVED: f32 = 0.5;

/// The dynamic Gaussians of a scene and the field that deforms them.
///
/// # Example
/// ```
/// use burn::tensor::Device;
/// use dash_model::{
///     DeformationConfig, DeformationField, DynamicPart, GaussianRows, Gaussians, HashEncoderConfig,
///     SceneSettings, SpaceBox,
/// };
/// use rand::SeedableRng;
///
/// let device = Device::flex();
/// let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
/// let rows = GaussianRows::from_points(&[[0.0; 3], [0.5; 3]], &[[0.8; 3]; 2], 0, 0.1);
/// let grid = HashEncoderConfig::new(2, 8, [4, 4, 4, 2], [8, 8, 8, 4]);
/// let config = DeformationConfig::new(grid, 8);
/// let part = DynamicPart {
///     gaussians: Gaussians::from_rows(&rows, &device),
///     field: DeformationField::new(&config, SpaceBox::fixed(1.0), &mut rng, &device)?,
/// };
/// let deformed = part.deform(&SceneSettings::default(), 0.5)?;
/// assert_eq!(deformed.means.dims(), [2, 3]);
/// # Ok::<(), dash_model::ModelError>(())
/// ```
#[derive(Module, Debug)]
pub struct DynamicPart {
    /// Canonical Gaussians.
    pub gaussians: Gaussians,
    /// The field over space and time.
    pub field: DeformationField,
}

impl DynamicPart {
    /// The Gaussians at `time`.
    ///
    /// Inside one of [`SceneSettings::gaps`] they are interpolated between both sides of the gap. Means follow a path with
    /// one turn where the velocities before and after the gap agree on it; this evaluates the field four times. Before the
    /// first and after the last time seen, means are extrapolated by point reflection at the edge.
    ///
    /// # Source
    /// DASH Eqs. 9-10. The coarse trajectory below the field's offsets and the treatment of gaps are ours.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn deform(&self, settings: &SceneSettings, time: f32) -> Result<Deformed, ModelError> {
        if let Some(beyond) = settings.gaps.extrapolation(time) {
            let mut deformed = self.deform_linear(settings, beyond.edge)?;
            let mirrored = self.deform_linear(settings, beyond.mirrored)?;
            deformed.means = deformed.means * 2.0 - mirrored.means;
            return Ok(deformed);
        }
        let Some(gap) = settings.gaps.interpolation(time) else {
            return self.deform_linear(settings, time);
        };
        let [from, to] = [gap.from, gap.to].map(|time| self.deform_linear(settings, time));
        let (from, to) = (from?, to?);
        let (before, after) = (from.means.clone(), to.means.clone());
        let mut deformed = from.lerp(to, gap.weight, self.deforms_sh_rest());
        let length = gap.to - gap.from;
        if gap.observed >= LEAST_OBSERVED * length {
            let means = |time: f32| self.deform_linear(settings, time).map(|at| at.means);
            let scale = length / gap.observed;
            let arrives = (before.clone() - means(gap.from - gap.observed)?) * scale;
            let leaves = (means(gap.to + gap.observed)? - after.clone()) * scale;
            deformed.means = deformed.means + turn(after - before, arrives, leaves, gap.weight);
        }
        Ok(deformed)
    }

    /// The Gaussians at `time`, interpolated linearly inside gaps.
    fn deform_linear(&self, settings: &SceneSettings, time: f32) -> Result<Deformed, ModelError> {
        let at = |time: f32| -> Result<Deformed, ModelError> {
            self.deform_from(settings, time, self.features(time)?)
        };
        match settings.gaps.interpolation(time) {
            Some(gap) => {
                let (from, to) = (at(gap.from)?, at(gap.to)?);
                Ok(from.lerp(to, gap.weight, self.deforms_sh_rest()))
            }
            None => at(time),
        }
    }

    fn deforms_sh_rest(&self) -> bool {
        self.field.config().heads.sh_rest > 0
    }

    /// The field's features at the canonical means.
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

    /// [`DynamicPart::features`], and behind them the features beside some of the means, in one lookup: the gradient of each
    /// lookup is as large as the tables, however few its points.
    ///
    /// # Shapes
    /// `M` points beside `-> [N + M, features]`
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn features_beside(&self, time: f32, beside: Beside) -> Result<Tensor<2>, ModelError> {
        let canonical = &self.gaussians;
        let embeddings = canonical.embeddings.as_ref().map(|embeddings| {
            let rows: Vec<i32> = beside.rows.iter().map(|&row| row as i32).collect();
            let (own, shape) = (embeddings.val(), [rows.len()]);
            let rows = Tensor::<1, Int>::from_data(TensorData::new(rows, shape), &own.device());
            Tensor::cat(vec![own.clone(), own.select(0, rows)], 0)
        });
        let space = self.field.space();
        let points = space.points_beside(canonical.means.val(), time, beside)?;
        self.field.features_at(points, embeddings)
    }

    /// The Gaussians at `time`, from features of [`DynamicPart::features`], without regard to gaps.
    ///
    /// # Shapes
    /// `features [N, features]`
    ///
    /// # Errors
    /// When a shape does not fit, or the field has a head for more or fewer colour coefficients than the Gaussians have.
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
        let decoded = self.field.decoded(features)?;
        let offsets = self.field.appearance(&decoded);
        let canonical = &self.gaussians;
        let opacity_logits = plus(canonical.opacity_logits.val(), offsets.opacity_logits);
        let own = canonical.sh_coeffs();
        if let Some(offset) = &offsets.sh_rest
            && offset.dims() != own.rest.dims()
        {
            let expected = format!("shape {:?}, as the field's head", offset.dims());
            let found = format!("shape {:?}", own.rest.dims());
            return Err(ModelError::argument("sh_rest", expected, found));
        }
        let sh_coeffs = ShCoeffs {
            dc: plus(own.dc, offsets.sh_dc),
            rest: plus(own.rest, offsets.sh_rest),
        };
        let (quats, log_scales) = (canonical.quats.val(), canonical.log_scales.val());
        let (quats, scales, opacities, activation) = match settings.offsets {
            OffsetPlacement::BeforeActivation => {
                (quats, log_scales, opacity_logits, Activation::Exp)
            }
            OffsetPlacement::AfterActivation => {
                let norm = (quats.clone().powi_scalar(2).sum_dim(1) + 1e-12).sqrt();
                let opacities = sigmoid(opacity_logits);
                (
                    quats / norm,
                    log_scales.exp(),
                    opacities,
                    Activation::Linear,
                )
            }
        };
        let canonical = Ellipsoids {
            means: canonical.means.val(),
            quats,
            scales,
        };
        let path = self.gaussians.trajectories.as_ref().map(|path| Path {
            coefficients: path.val(),
            basis: settings.trajectory_basis.at(time),
        });
        let deformed = deform(canonical, path, decoded, self.field.columns())?;
        Ok(Deformed {
            means: deformed.means,
            quats: deformed.quats,
            scales: deformed.scales,
            opacities,
            sh_coeffs,
            activation,
        })
    }
}
