//! Costs weighed by what a picture shows of each Gaussian: of motion that is seen, and of nearness to the camera.

mod autodiff;
pub mod cpu;
#[cfg(feature = "cube")]
mod cube;
pub mod reference;
#[cfg(test)]
mod tests;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::Tensor;

use crate::host::{HostBackend, dims};
use crate::splats::N_COLUMNS;
use crate::{Camera, KernelError};

/// Disparity, in units of the typical one, above which a Gaussian is near.
pub const NEAR: f32 = 2.0;
/// Most that the nearness of a Gaussian counts for.
pub const NEAREST: f32 = 16.0;
/// Motion, in shares of the image's width, with which a Gaussian pays half of what it would at rest for being near.
pub const AT_REST: f32 = 0.005;

/// What of a camera tells shares of its picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureSize {
    /// Pixels.
    pub width: f32,
    /// Pixels.
    pub height: f32,
    /// Focal length along x, in shares of the width.
    pub focal: f32,
}

impl PictureSize {
    /// The size of a camera's picture.
    pub fn of(camera: &Camera) -> Self {
        Self {
            width: camera.width as f32,
            height: camera.height as f32,
            focal: (camera.fx / camera.width as f64) as f32,
        }
    }
}

/// How much motion a picture shows: the sum over Gaussians of opacity, times the share of the picture under each, times
/// `m / (1 + m / far)` of its motion `m` in shares of the picture's width. A mean over the picture, like the photometric
/// loss. Beyond `far`, more motion costs little more.
///
/// A Gaussian that is not drawn, or whose extent is not finite, counts nothing.
///
/// # Shapes
/// `extents [N]` in world units, `splats [N, C]` as [`project`](crate::project::project) packs them `-> [1]`.
///
/// # Gradient
/// To the extents; splats are constants.
///
/// # Errors
/// [`KernelError::Shape`] when rows or columns differ, [`KernelError::Config`] when `far` is not positive.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::{Camera, coverage::visible_motion, splats};
///
/// let device = Device::flex();
/// let camera = Camera::from_fov_x(1.0, 20, 10);
/// // Opaque, 2 of 200 pixels, at a distance of 1.
/// let mut splat = [0.0; splats::N_COLUMNS];
/// (splat[splats::MEAN_X], splat[splats::MEAN_Y]) = (10.0, 5.0);
/// (splat[splats::CONIC_A], splat[splats::CONIC_C]) = (0.5, 0.5);
/// (splat[splats::OPACITY], splat[splats::DEPTH]) = (1.0, 1.0);
/// (splat[splats::RADIUS_X], splat[splats::RADIUS_Y]) = (4.0, 4.0);
/// let splats = Tensor::<1>::from_floats(splat, &device).reshape([1, splats::N_COLUMNS]);
/// let cost = visible_motion(Tensor::from_floats([0.1], &device), splats, &camera, 1.0)?;
/// let motion = 0.1 * camera.fx / 20.0;
/// let expected = 0.01 * motion / (1.0 + motion);
/// assert!((f64::from(cost.into_scalar::<f32>()) - expected).abs() < 1e-7);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn visible_motion(
    extents: Tensor<1>,
    splats: Tensor<2>,
    camera: &Camera,
    far: f32,
) -> Result<Tensor<1>, KernelError> {
    if far.is_nan() || far <= 0.0 {
        return Err(KernelError::Config {
            op: "visible_motion",
            what: format!("`far` is {far}, expected more than 0"),
        });
    }
    let [n] = extents.dims();
    check_rows("visible_motion", &splats, n)?;
    if n == 0 {
        return Ok(Tensor::zeros([1], &extents.device()));
    }
    Ok(Tensor::from_dispatch(Dispatch::visible_motion(
        extents.into_dispatch(),
        splats.into_dispatch(),
        PictureSize::of(camera),
        far,
    )))
}

/// What [`floater_cost`] is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloaterWeights {
    /// Weight of the mean opacity.
    pub opacity: f32,
    /// Weight of nearness.
    pub nearness: f32,
}

/// What floaters cost: the weighted sum of the mean opacity of all Gaussians, and of nearness.
///
/// Nearness is how much of a picture Gaussians cover from nearer than half of the typical distance: the sum over them of
/// opacity, times the share of the picture under each, times what the square of its disparity has above that of [`NEAR`] (at
/// most [`NEAREST`]), in units of the mean disparity of what they cover. A Gaussian larger than the picture counts by the
/// part of it that lies inside: such are backgrounds. Zero where nothing is drawn.
///
/// A floater between the camera and the scene, as dark as the background, changes no training picture, but darkens
/// novel views between them. A Gaussian that is followed must stay visible: the more `motion` it has, the less it pays for
/// being near.
///
/// # Shapes
/// `opacity_logits [N]`, `splats [N, C]` as [`project`](crate::project::project) packs them, `motion [N]` in world units
/// (`None`: all rest) `-> [1]`.
///
/// # Gradient
/// To the logits; splats and motion are constants. Motion that is not finite counts as none; a logit that is not finite
/// costs nothing.
///
/// # Errors
/// [`KernelError::Shape`] when rows or columns differ.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::{Camera, coverage::{FloaterWeights, floater_cost}, splats};
///
/// let device = Device::flex();
/// let camera = Camera::from_fov_x(1.0, 20, 10);
/// let splat = |depth: f32| {
///     let mut splat = [0.0; splats::N_COLUMNS];
///     (splat[splats::MEAN_X], splat[splats::MEAN_Y]) = (10.0, 5.0);
///     (splat[splats::CONIC_A], splat[splats::CONIC_C]) = (0.5, 0.5);
///     (splat[splats::OPACITY], splat[splats::DEPTH]) = (0.5, depth);
///     (splat[splats::RADIUS_X], splat[splats::RADIUS_Y]) = (4.0, 4.0);
///     splat
/// };
/// let cost_of = |depths: [f32; 3], opacity| {
///     let rows = depths.map(splat).concat();
///     let splats = Tensor::<1>::from_floats(rows.as_slice(), &device).reshape([3, splats::N_COLUMNS]);
///     let weights = FloaterWeights { opacity, nearness: 1.0 };
///     let cost = floater_cost(Tensor::zeros([3], &device), splats, None, &camera, weights)?;
///     Ok::<f32, dash_kernels::KernelError>(cost.into_scalar())
/// };
/// // All at about one distance, and one at a tenth of it.
/// assert_eq!(cost_of([1.0, 1.1, 0.9], 0.0)?, 0.0);
/// assert_eq!(cost_of([1.0, 1.1, 0.9], 0.5)?, 0.25);
/// assert!(cost_of([1.0, 1.1, 0.1], 0.0)? > 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn floater_cost(
    opacity_logits: Tensor<1>,
    splats: Tensor<2>,
    motion: Option<Tensor<1>>,
    camera: &Camera,
    weights: FloaterWeights,
) -> Result<Tensor<1>, KernelError> {
    let [n] = opacity_logits.dims();
    check_rows("floater_cost", &splats, n)?;
    if let Some(found) = motion
        .as_ref()
        .map(Tensor::dims)
        .filter(|&dims| dims != [n])
    {
        return Err(KernelError::Shape {
            op: "floater_cost",
            tensor: "motion",
            expected: format!("[{n}]"),
            found: found.to_vec(),
        });
    }
    if n == 0 {
        return Ok(Tensor::zeros([1], &opacity_logits.device()));
    }
    let moves = motion.is_some();
    // Something has to be bound in its place, and is not looked at.
    let motion = motion.unwrap_or_else(|| opacity_logits.clone());
    Ok(Tensor::from_dispatch(Dispatch::floater_cost(
        opacity_logits.into_dispatch(),
        splats.into_dispatch(),
        motion.into_dispatch(),
        PictureSize::of(camera),
        weights,
        moves,
    )))
}

fn check_rows(op: &'static str, splats: &Tensor<2>, n: usize) -> Result<(), KernelError> {
    if splats.dims() == [n, N_COLUMNS] {
        return Ok(());
    }
    Err(KernelError::Shape {
        op,
        tensor: "splats",
        expected: format!("[{n}, {N_COLUMNS}]"),
        found: splats.dims().to_vec(),
    })
}

/// Dispatch of this module's operations over the enabled backends.
#[backend_extension(Autodiff, Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait Coverage: Backend {
    /// See [`visible_motion`]; shapes and `far` have been checked.
    fn visible_motion(
        extents: FloatTensor<Self>,
        splats: FloatTensor<Self>,
        picture: PictureSize,
        far: f32,
    ) -> FloatTensor<Self>;

    /// See [`floater_cost`]; shapes have been checked. Where nothing `moves`, the motion is not looked at.
    fn floater_cost(
        opacity_logits: FloatTensor<Self>,
        splats: FloatTensor<Self>,
        motion: FloatTensor<Self>,
        picture: PictureSize,
        weights: FloaterWeights,
        moves: bool,
    ) -> FloatTensor<Self>;
}

/// The costs with their gradients, which a backend has to implement for training.
pub trait CoverageVjp: Coverage {
    /// The cost `[1]`, and its gradient to the extents `[N]`.
    fn visible_motion_and_gradient(
        extents: FloatTensor<Self>,
        splats: FloatTensor<Self>,
        picture: PictureSize,
        far: f32,
    ) -> (FloatTensor<Self>, FloatTensor<Self>);

    /// The cost `[1]`, and its gradient to the logits `[N]`.
    fn floater_cost_and_gradient(
        opacity_logits: FloatTensor<Self>,
        splats: FloatTensor<Self>,
        motion: FloatTensor<Self>,
        picture: PictureSize,
        weights: FloaterWeights,
        moves: bool,
    ) -> (FloatTensor<Self>, FloatTensor<Self>);
}

impl<B: HostBackend> Coverage for B {
    fn visible_motion(
        extents: FloatTensor<B>,
        splats: FloatTensor<B>,
        picture: PictureSize,
        far: f32,
    ) -> FloatTensor<B> {
        B::visible_motion_and_gradient(extents, splats, picture, far).0
    }

    fn floater_cost(
        opacity_logits: FloatTensor<B>,
        splats: FloatTensor<B>,
        motion: FloatTensor<B>,
        picture: PictureSize,
        weights: FloaterWeights,
        moves: bool,
    ) -> FloatTensor<B> {
        B::floater_cost_and_gradient(opacity_logits, splats, motion, picture, weights, moves).0
    }
}

impl<B: HostBackend> CoverageVjp for B {
    fn visible_motion_and_gradient(
        extents: FloatTensor<B>,
        splats: FloatTensor<B>,
        picture: PictureSize,
        far: f32,
    ) -> (FloatTensor<B>, FloatTensor<B>) {
        let [n] = dims::<1>(&extents);
        let (cost, gradient) =
            cpu::visible_motion(&B::values(&extents), &B::values(&splats), picture, far);
        (
            B::tensor(vec![cost], [1], &extents),
            B::tensor(gradient, [n], &extents),
        )
    }

    fn floater_cost_and_gradient(
        opacity_logits: FloatTensor<B>,
        splats: FloatTensor<B>,
        motion: FloatTensor<B>,
        picture: PictureSize,
        weights: FloaterWeights,
        moves: bool,
    ) -> (FloatTensor<B>, FloatTensor<B>) {
        let [n] = dims::<1>(&opacity_logits);
        let (cost, gradient) = cpu::floater_cost(
            &B::values(&opacity_logits),
            &B::values(&splats),
            moves.then_some(&*B::values(&motion)),
            picture,
            weights,
        );
        (
            B::tensor(vec![cost], [1], &opacity_logits),
            B::tensor(gradient, [n], &opacity_logits),
        )
    }
}
