//! The whole scene: static Gaussians, and the few that move.

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use dash_kernels::Camera;
use dash_kernels::project::{Activation, ProjectOptions, project};
use dash_kernels::rasterize::{RasterizeOptions, rasterize};
use dash_kernels::rows::join_rows;
use dash_kernels::splats::N_COLUMNS;
use serde::{Deserialize, Serialize};

use crate::gaussians::LOGIT_LIMIT;
use crate::{Deformed, DynamicPart, Gaps, GaussianRows, Gaussians, ModelError, TrajectoryBasis};

/// Where the decoder's rotation and scale offsets are added.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OffsetPlacement {
    /// To log scales and raw quaternions: a scale stays positive whatever the decoder says.
    BeforeActivation,
    /// To scales and unit quaternions, as the released DASH code does; a negative scale draws as
    /// its absolute value.
    AfterActivation,
}

/// What rendering needs to know beside the parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneSettings {
    /// Colour behind everything, sRGB in [0, 1].
    pub background: [f32; 3],
    /// Active spherical-harmonics degree, at most the stored one.
    pub sh_degree: usize,
    /// Gaussians nearer than this along a camera's z are not drawn, world units.
    pub near_plane: f64,
    /// Functions of time of the coarse trajectories.
    pub trajectory_basis: TrajectoryBasis,
    /// Where rotation and scale offsets are added.
    pub offsets: OffsetPlacement,
    /// Parts of the clip of which nothing was seen, see [`DynamicPart::deform`].
    #[serde(default, skip_serializing_if = "Gaps::is_empty")]
    pub gaps: Gaps,
}

/// A dynamic scene. A scene in which nothing moves has no dynamic part at all.
#[derive(Module, Debug)]
pub struct DynamicScene {
    /// Gaussians that never move.
    pub static_set: Gaussians,
    /// Gaussians that move.
    pub dynamic: Option<DynamicPart>,
    /// What rendering needs to know beside the parameters.
    #[module(skip)]
    pub settings: SceneSettings,
}

/// Which Gaussians a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layer {
    /// All of them.
    Full,
    /// Those that never move.
    Static,
    /// Those that move.
    Dynamic,
}

/// A picture: `[H, W, 5]` with RGB, alpha and depth.
#[derive(Debug, Clone)]
pub struct Rendering {
    /// RGB over the background, alpha, and depth weighted by alpha.
    pub image: Tensor<3>,
}

impl Rendering {
    /// `[H, W, 3]`, sRGB.
    pub fn rgb(&self) -> Tensor<3> {
        self.image.clone().narrow(2, 0, 3)
    }

    /// `[H, W, 1]` in [0, 1].
    pub fn alpha(&self) -> Tensor<3> {
        self.image.clone().narrow(2, 3, 1)
    }

    /// `[H, W, 1]`, world units times alpha.
    pub fn depth(&self) -> Tensor<3> {
        self.image.clone().narrow(2, 4, 1)
    }
}

impl DynamicScene {
    /// Packed splats of the static Gaussians, see [`project`].
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn static_splats(&self, camera: &Camera) -> Result<Tensor<2>, ModelError> {
        self.static_splats_at(self.static_set.means.val(), camera)
    }

    /// Packed splats of the static Gaussians with other means `[N, 3]`, as the coarse stage moves
    /// them.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn static_splats_at(
        &self,
        means: Tensor<2>,
        camera: &Camera,
    ) -> Result<Tensor<2>, ModelError> {
        let set = &self.static_set;
        Ok(project(
            means,
            set.quats.val(),
            set.log_scales.val(),
            set.opacity_logits.val(),
            set.sh_coeffs(),
            camera,
            &ProjectOptions {
                sh_degree: Some(self.settings.sh_degree),
                near_plane: self.settings.near_plane,
                ..Default::default()
            },
        )?)
    }

    /// Packed splats of the dynamic Gaussians at `time`; `None` without a dynamic part.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn dynamic_splats(
        &self,
        camera: &Camera,
        time: f32,
    ) -> Result<Option<Tensor<2>>, ModelError> {
        let Some(dynamic) = self.dynamic.as_ref().filter(|d| !d.gaussians.is_empty()) else {
            return Ok(None);
        };
        let deformed = dynamic.deform(&self.settings, time)?;
        self.deformed_splats(deformed, camera).map(Some)
    }

    /// Packed splats of deformed Gaussians.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn deformed_splats(
        &self,
        deformed: Deformed,
        camera: &Camera,
    ) -> Result<Tensor<2>, ModelError> {
        Ok(project(
            deformed.means,
            deformed.quats,
            deformed.scales,
            deformed.opacities,
            deformed.sh_coeffs,
            camera,
            &ProjectOptions {
                sh_degree: Some(self.settings.sh_degree),
                activation: deformed.activation,
                near_plane: self.settings.near_plane,
            },
        )?)
    }

    /// Draws packed splats over the scene's background.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn rasterize(&self, splats: Tensor<2>, camera: &Camera) -> Result<Rendering, ModelError> {
        let options = RasterizeOptions {
            width: camera.width,
            height: camera.height,
            background: self.settings.background,
        };
        Ok(Rendering {
            image: rasterize(splats, &options)?,
        })
    }

    /// The scene from `camera` at `time` in [0, 1].
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn render(&self, camera: &Camera, time: f32) -> Result<Rendering, ModelError> {
        self.render_layer(camera, time, Layer::Full)
    }

    /// One layer of the scene from `camera` at `time` in [0, 1].
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn render_layer(
        &self,
        camera: &Camera,
        time: f32,
        layer: Layer,
    ) -> Result<Rendering, ModelError> {
        let still = match layer {
            Layer::Dynamic => None,
            Layer::Full | Layer::Static => Some(self.static_splats(camera)?),
        };
        let moving = match layer {
            Layer::Static => None,
            Layer::Full | Layer::Dynamic => self.dynamic_splats(camera, time)?,
        };
        let splats = match (still, moving) {
            (Some(still), Some(moving)) => join_rows(still, moving)?,
            (Some(splats), None) | (None, Some(splats)) => splats,
            (None, None) => Tensor::zeros([0, N_COLUMNS], &self.static_set.means.device()),
        };
        self.rasterize(splats, camera)
    }

    /// All Gaussians as they are at `time`: static rows first.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn at(&self, time: f32) -> Result<GaussianRows, ModelError> {
        let mut rows = self.static_set.to_rows();
        let Some(dynamic) = self.dynamic.as_ref().filter(|d| !d.gaussians.is_empty()) else {
            return Ok(rows);
        };
        let deformed = dynamic.deform(&self.settings, time)?;
        let log_scales = match deformed.activation {
            Activation::Exp => deformed.scales,
            Activation::Linear => deformed.scales.abs().clamp_min(1e-12).log(),
        };
        let opacity_logits = match deformed.activation {
            Activation::Exp => deformed.opacities,
            Activation::Linear => logits(deformed.opacities),
        };
        let frozen = Gaussians {
            means: Param::from_tensor(deformed.means.detach()),
            quats: Param::from_tensor(deformed.quats.detach()),
            log_scales: Param::from_tensor(log_scales.detach()),
            opacity_logits: Param::from_tensor(opacity_logits.detach()),
            sh_dc: Param::from_tensor(deformed.sh_coeffs.dc.detach()),
            trajectories: None,
            embeddings: None,
            ..dynamic.gaussians.clone()
        };
        rows.append(&frozen.to_rows());
        Ok(rows)
    }

    /// Numbers of static and dynamic Gaussians.
    pub fn counts(&self) -> (usize, usize) {
        (
            self.static_set.len(),
            self.dynamic.as_ref().map_or(0, |d| d.gaussians.len()),
        )
    }
}

/// The logits of opacities, within what the sigmoid still answers.
fn logits(opacities: Tensor<1>) -> Tensor<1> {
    let least = (1.0 + f64::from(LOGIT_LIMIT).exp()).recip();
    let opacities = opacities.clamp(least, 1.0 - least);
    opacities.clone().log() - (-opacities + 1.0).log()
}
