//! A dynamic scene and its rendering.

mod settings;

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use dash_kernels::Camera;
use dash_kernels::project::{Activation, ProjectOptions, project};
use dash_kernels::rasterize::{RasterizeOptions, rasterize};
use dash_kernels::rows::join_rows;
use dash_kernels::splats::N_COLUMNS;

pub use settings::{OffsetPlacement, SceneSettings};

use crate::gaussians::LOGIT_LIMIT;
use crate::{Deformed, DynamicPart, GaussianRows, Gaussians, ModelError};

/// A dynamic scene: static Gaussians, and an optional dynamic part.
///
/// # Source
/// DASH Eqs. 1-2 (rendering) and 10 (both sets together).
///
/// # Example
/// ```
/// use burn::tensor::Device;
/// use dash_model::{Camera, DynamicScene, GaussianRows, Gaussians, Layer, SceneSettings};
///
/// let device = Device::flex();
/// let rows = GaussianRows::from_points(&[[0.0; 3], [0.3, 0.0, 0.2]], &[[0.9, 0.2, 0.1]; 2], 0, 0.1);
/// let scene = DynamicScene {
///     static_set: Gaussians::from_rows(&rows, &device),
///     // A `DynamicPart` adds deformed Gaussians.
///     dynamic: None,
///     settings: SceneSettings { background: [1.0; 3], ..Default::default() },
/// };
/// let camera = Camera::new(40.0, 40.0, 16.0, 12.0, 32, 24).look_at(
///     [0.0, 0.0, -3.0],
///     [0.0; 3],
///     [0.0, -1.0, 0.0],
/// );
/// let picture = scene.render(&camera, 0.5)?;
/// assert_eq!(picture.rgb().dims(), [24, 32, 3]);
/// // The layers of the decomposition, and all Gaussians of one instant.
/// scene.render_layer(&camera, 0.5, Layer::Static)?.alpha();
/// assert_eq!(scene.at(0.5)?, rows);
/// # Ok::<(), dash_model::ModelError>(())
/// ```
#[derive(Module, Debug)]
pub struct DynamicScene {
    /// Static Gaussians.
    pub static_set: Gaussians,
    /// Dynamic Gaussians and their field; `None` in a static scene.
    pub dynamic: Option<DynamicPart>,
    /// What rendering needs beside the parameters.
    #[module(skip)]
    pub settings: SceneSettings,
}

/// The Gaussians that a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layer {
    /// Static and dynamic ones.
    Full,
    /// Static ones only.
    Static,
    /// Dynamic ones only.
    Dynamic,
}

/// A picture: `[H, W, 5]` with RGB, alpha and depth.
#[derive(Debug, Clone)]
pub struct Rendering {
    /// RGB over the background, alpha, and depth weighted by alpha.
    pub image: Tensor<3>,
}

impl Rendering {
    /// Pictures of one size that fade into each other, each with its share; the shares add up to 1. `None` of none.
    ///
    /// # Errors
    /// The first of a picture that is made on the way.
    pub fn faded<E>(
        pictures: impl IntoIterator<Item = Result<(Self, f32), E>>,
    ) -> Result<Option<Self>, E> {
        let mut sum: Option<Self> = None;
        for picture in pictures {
            let (Self { image }, share) = picture?;
            let image = if share == 1.0 { image } else { image * share };
            sum = Some(Self {
                image: match sum {
                    None => image,
                    Some(before) => before.image + image,
                },
            });
        }
        Ok(sum)
    }

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

    /// Packed splats of the static Gaussians with other means `[N, 3]`, which the coarse stage displaces.
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
        self.rasterize(self.splats(camera, time, layer)?, camera)
    }

    /// Packed splats of one layer at `time` in [0, 1], static rows first.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub fn splats(
        &self,
        camera: &Camera,
        time: f32,
        layer: Layer,
    ) -> Result<Tensor<2>, ModelError> {
        let static_splats = match layer {
            Layer::Dynamic => None,
            Layer::Full | Layer::Static => Some(self.static_splats(camera)?),
        };
        let dynamic_splats = match layer {
            Layer::Static => None,
            Layer::Full | Layer::Dynamic => self.dynamic_splats(camera, time)?,
        };
        Ok(match (static_splats, dynamic_splats) {
            (Some(static_splats), Some(dynamic_splats)) => {
                join_rows(static_splats, dynamic_splats)?
            }
            (Some(splats), None) | (None, Some(splats)) => splats,
            (None, None) => Tensor::zeros([0, N_COLUMNS], &self.static_set.means.device()),
        })
    }

    /// All Gaussians at `time`, static rows first.
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
            sh_rest: Param::from_tensor(deformed.sh_coeffs.rest.detach()),
            trajectories: None,
            embeddings: None,
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

/// The logits of opacities, within [`LOGIT_LIMIT`].
fn logits(opacities: Tensor<1>) -> Tensor<1> {
    let least = (1.0 + f64::from(LOGIT_LIMIT).exp()).recip();
    let opacities = opacities.clamp(least, 1.0 - least);
    opacities.clone().log() - (-opacities + 1.0).log()
}
