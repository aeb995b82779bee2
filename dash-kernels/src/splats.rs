//! Packed 2D splats: the rows that [`project`](crate::project::project) writes and
//! [`rasterize`](crate::rasterize::rasterize) reads, and the thresholds both agree on.
//!
//! Rows may be concatenated: static and dynamic splats are joined after projection. A row whose
//! radii are zero draws nothing. The last four columns are zero but for needles, see [`ACROSS_X`].
//!
//! # Example
//! Splats can be written by hand, too:
//! ```
//! use burn::tensor::{Device, Tensor};
//! use dash_kernels::rasterize::{CHANNEL_ALPHA, RasterizeOptions, rasterize};
//! use dash_kernels::splats::{self, N_COLUMNS};
//!
//! let mut splat = [0.0; N_COLUMNS];
//! (splat[splats::MEAN_X], splat[splats::MEAN_Y]) = (4.5, 4.5);
//! (splat[splats::CONIC_A], splat[splats::CONIC_C]) = (0.5, 0.5);
//! (splat[splats::OPACITY], splat[splats::GREEN], splat[splats::DEPTH]) = (0.9, 1.0, 3.0);
//! (splat[splats::RADIUS_X], splat[splats::RADIUS_Y]) = (5.0, 5.0);
//! let hidden = [0.0; N_COLUMNS];
//! let splats = Tensor::from_floats([splat, hidden], &Device::flex());
//! let options = RasterizeOptions { width: 9, height: 9, background: [0.0; 3] };
//! let alpha = rasterize(splats, &options)?.narrow(2, CHANNEL_ALPHA, 1);
//! assert!((alpha.max().into_scalar::<f32>() - 0.9).abs() < 1e-6);
//! # Ok::<(), dash_kernels::KernelError>(())
//! ```

/// Column of the centre, from the image's left edge, in pixels.
pub const MEAN_X: usize = 0;
/// Column of the centre, from the image's top edge, in pixels.
pub const MEAN_Y: usize = 1;
/// Column of the inverse covariance's entry (x, x), in 1 / px^2.
pub const CONIC_A: usize = 2;
/// Column of the inverse covariance's entry (x, y), in 1 / px^2.
pub const CONIC_B: usize = 3;
/// Column of the inverse covariance's entry (y, y), in 1 / px^2.
pub const CONIC_C: usize = 4;
/// Column of the opacity, in [0, 1].
pub const OPACITY: usize = 5;
/// Column of the red value; green and blue follow.
pub const RED: usize = 6;
/// Column of the green value.
pub const GREEN: usize = 7;
/// Column of the blue value.
pub const BLUE: usize = 8;
/// Column of the depth: the centre's z in camera coordinates.
pub const DEPTH: usize = 9;
/// Column of the half width of the box outside which alpha is under [`ALPHA_MIN`], in pixels.
/// Carries no gradient.
pub const RADIUS_X: usize = 10;
/// Column of the half height of that box, in pixels. Carries no gradient.
pub const RADIUS_Y: usize = 11;
/// Column of the unit vector across a needle's long axis, its x; y follows.
///
/// Of a needle the mean and the inverse covariance in single precision do not say where it runs: far from the mean
/// the terms of the exponent are huge and cancel. Its row says so once more, relative to the picture: with `n` this
/// vector, `l` the inverse variance across, `m` the mean and `t` the vector `n` turned by 90 degrees, the exponent at
/// `p` is `(l (n p - ACROSS_OFFSET)^2 + ALONG (t (p - m))^2) / 2`. Four zeros where the other columns suffice.
///
/// The gradient of a needle's shape is that of the inverse covariance in the frame `(n, t)`: the entries `(n, n)`,
/// `(n, t)` and `(t, t)` in the columns `ACROSS_X`, `ACROSS_Y` and `ACROSS_OFFSET`, in place of the three of the conic.
pub const ACROSS_X: usize = 12;
/// Column of that vector's y.
pub const ACROSS_Y: usize = 13;
/// Column of a needle's place across its long axis: the product of that vector with the axis' points, in pixels.
pub const ACROSS_OFFSET: usize = 14;
/// Column of a needle's inverse variance along its long axis, in 1 / px^2; zero for other splats.
pub const ALONG: usize = 15;
/// Number of columns.
pub const N_COLUMNS: usize = 16;
/// Number of leading columns that carry a gradient.
pub const N_DIFFERENTIABLE: usize = 10;

/// Gaussians nearer than this along the camera's z are not drawn, in world units (3DGS).
pub const NEAR_PLANE: f64 = 0.2;
/// Variance added to both axes of the projected covariance, in px^2 (3DGS).
pub const LOW_PASS_PX2: f64 = 0.3;
/// A splat contributes nothing to a pixel where its alpha is smaller (3DGS).
pub const ALPHA_MIN: f64 = 1.0 / 255.0;
/// Alpha is clamped to this, with zero gradient beyond (3DGS, gsplat).
pub const ALPHA_MAX: f64 = 0.99;
/// A pixel is finished before the splat that would bring its transmittance under this (3DGS).
pub const TRANSMITTANCE_STOP: f64 = 1e-4;

/// Ratio of the variances along and across a splat at which it is a needle: from there on rounding may change the
/// exponent in single precision by 1e-4, and the gradient of a length that is mostly seen end-on by a hundred times as much.
pub const NEEDLE: f64 = 1e3;

/// On a splat's long axis, where it is opaquest, rounding of the exponent's terms may make it negative by as much; the
/// largest of them are those of splats that are nearly needles.
pub(crate) const EXPONENT_ROUNDING: f32 = 4e-3;

/// Whether the value is neither infinite nor NaN, from its bits: `x != x` and the like are
/// optimised away by some shader compilers, and this contract is theirs too.
#[inline(always)]
pub(crate) fn is_finite(value: f32) -> bool {
    value.to_bits() & 0x7f80_0000 != 0x7f80_0000
}
