//! The whole scene: static Gaussians, and the few that move.

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use burn::tensor::activation::sigmoid;
use dash_kernels::Camera;
use dash_kernels::project::{Activation, ProjectOptions, project};
use dash_kernels::rasterize::{RasterizeOptions, rasterize};
use dash_kernels::splats::NEAR_PLANE;
use serde::{Deserialize, Serialize};

use crate::deformation::Offsets;
use crate::gaussians::to_host;
use crate::{DeformationField, GaussianRows, Gaussians, Head, ModelError, TrajectoryBasis};

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
    #[serde(default = "default_near_plane")]
    pub near_plane: f64,
    /// Functions of time of the coarse trajectories.
    pub trajectory_basis: TrajectoryBasis,
    /// Where rotation and scale offsets are added.
    pub offsets: OffsetPlacement,
}

fn default_near_plane() -> f64 {
    NEAR_PLANE
}

/// The Gaussians that move, and the field that moves them.
#[derive(Module, Debug)]
pub struct DynamicPart {
    /// Canonical Gaussians.
    pub gaussians: Gaussians,
    /// The 4D hash field and its decoder.
    pub field: DeformationField,
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
    /// Colour coefficients `[N, K, 3]`.
    pub sh_coeffs: Tensor<3>,
    /// What projection applies to scales and opacities.
    pub activation: Activation,
}

impl DynamicPart {
    /// Canonical means moved along their coarse trajectories.
    ///
    /// # Shapes
    /// `-> [N, 3]`
    pub fn coarse_means(&self, settings: &SceneSettings, time: f32) -> Tensor<2> {
        let means = self.gaussians.means.val();
        match &self.gaussians.trajectories {
            Some(coefficients) => {
                means
                    + settings
                        .trajectory_basis
                        .displacement(coefficients.val(), time)
            }
            None => means,
        }
    }

    /// The Gaussians at `time`.
    ///
    /// # Source
    /// DASH Eqs. 9-10; the coarse trajectory below the field's offsets is ours.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn deform(&self, settings: &SceneSettings, time: f32) -> Result<Deformed, ModelError> {
        let features = self.features(time)?;
        Ok(self.deform_with(settings, time, self.field.decode(features)))
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
            let offsets = self.field.decode(self.features(time)?);
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

    /// What the field knows of the Gaussians at `time`, `[N, features]`.
    fn features(&self, time: f32) -> Result<Tensor<2>, ModelError> {
        let canonical = &self.gaussians;
        let embeddings = canonical.embeddings.as_ref().map(Param::val);
        self.field.features(canonical.means.val(), embeddings, time)
    }

    fn deform_with(&self, settings: &SceneSettings, time: f32, offsets: Offsets) -> Deformed {
        fn plus<const D: usize>(value: Tensor<D>, offset: Option<Tensor<D>>) -> Tensor<D> {
            match offset {
                Some(offset) => value + offset,
                None => value,
            }
        }
        let canonical = &self.gaussians;
        let means = self.coarse_means(settings, time) + offsets.means;
        let opacity_logits = plus(canonical.opacity_logits.val(), offsets.opacity_logits);
        let sh_coeffs = canonical.sh_coeffs_with(plus(canonical.sh_dc.val(), offsets.sh_dc));
        match settings.offsets {
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
        }
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
        Ok(Some(project(
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
        )?))
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
        let mut parts = Vec::new();
        if layer != Layer::Dynamic {
            parts.push(self.static_splats(camera)?);
        }
        if layer != Layer::Static {
            parts.extend(self.dynamic_splats(camera, time)?);
        }
        let splats = match parts.len() {
            0 => {
                let device = self.static_set.means.device();
                Tensor::zeros([0, dash_kernels::splats::N_COLUMNS], &device)
            }
            1 => parts.swap_remove(0),
            _ => Tensor::cat(parts, 0),
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
            Activation::Linear => dynamic.gaussians.opacity_logits.val(),
        };
        let frozen = Gaussians {
            means: Param::from_tensor(deformed.means.detach()),
            quats: Param::from_tensor(deformed.quats.detach()),
            log_scales: Param::from_tensor(log_scales.detach()),
            opacity_logits: Param::from_tensor(opacity_logits.detach()),
            sh_dc: Param::from_tensor(deformed.sh_coeffs.narrow(1, 0, 1).detach()),
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
