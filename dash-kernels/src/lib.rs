//! Differentiable operations for dynamic Gaussian splatting on Burn tensors.
//!
//! Each operation is a function on [`burn::tensor::Tensor`]. It runs on every enabled backend (`ndarray`, `flex`,
//! `wgpu`, `cuda`) and differentiates on autodiff devices. There is no model here, no file format and no command line.
//!
//! # Modules
//! | module | operation |
//! | --- | --- |
//! | [`project`] | 3D Gaussians seen by a [`Camera`] -> packed 2D splats (EWA, spherical harmonics) |
//! | [`splats`] | columns of a packed splat, thresholds of drawing |
//! | [`rasterize`] | packed splats -> colour, alpha, depth |
//! | [`hash_encode`] | points in the unit box -> features of a multiresolution hash grid, in 2 to 4 dimensions |
//! | [`mlp`] | small fully connected network |
//! | [`ssim`], [`photometric`] | structural similarity; the loss of 3D Gaussian Splatting |
//! | [`adam`] | a fused step of Adam, of many parameters at once |
//! | [`space_time`] | positions and a time -> points of the 4D unit cube |
//! | [`deform`] | canonical Gaussians moved, turned and scaled by a field's offsets and their trajectories |
//! | [`smoothness`] | how much a field's features change beside some points |
//! | [`displacement`], [`trajectory`] | displacements of trajectories at a time; extents of trajectories |
//! | [`rows`] | some rows of a matrix, rows of two matrices joined |
//! | [`rgba8`] | pictures in 8 bits a channel, for screens and files, and back |
//! | [`tap`] | the gradient of a tensor in the middle of a graph |
//! | [`finite`] | which tensors and rows hold NaN or infinity |
//! | [`coverage`] | costs of visible motion and of floaters |
//! | [`screen_gradients`] | what density control gathers of a view |
//! | [`exposure`] | colours of splats as a camera with an exposure of its own sees them |
//! | [`limits`] | largest buffer of a device |
//! | [`counts`] | launches and reads of a piece of work |
//!
//! Each operation's folder has the public function with its checks (`mod.rs`), a plain f64 reference (`reference.rs`),
//! the CPU kernels (`cpu.rs`), the GPU kernels (`cube.rs`, feature `cube`) and the backward node (`autodiff.rs`).
//! `camera`, `error` and `determinism` hold the items at the root, `host`, `cube` and `outputs` what backends share.
//!
//! # Conventions
//! - Shape letters: `N` Gaussians or points, `D` input dimensions, `L` levels, `F` features per
//!   level, `T` table entries, `H W` image, `K` SH coefficients, `C` channels.
//! - Camera: OpenCV axes (x right, y down, z forward), transforms named `a_from_b`, pinhole in
//!   pixels, pixel centres at +0.5.
//! - Quaternions are (w, x, y, z) and normalised inside the operation.
//! - The gradient of `x` is `v_x`; the pullback of `f` is `f_vjp`.
//! - Tensors are `f32`. Values and gradients that are not finite count as zero, draw nothing or are passed on; each
//!   operation says which.
//! - CPU results are bit-identical for any number of threads. On GPUs a run repeats bit for bit
//!   after [`set_deterministic`].
//! - Operations don't wait for the device, unless determinism is asked for. A buffer that outgrows the device's limit
//!   is an error before it is made ([`limits`]).
//! - A mistake of the caller is a [`KernelError`], a broken invariant a panic.
//!
//! # One operation in your own model
//! An operation needs no other part of this crate: keep its inputs as parameters of a Burn module and call it in
//! `forward`. Backends are chosen by the device alone.
//!
//! ```
//! use burn::module::{Module, Param};
//! use burn::optim::{AdamConfig, GradientsParams, Optimizer};
//! use burn::tensor::{Device, Tensor};
//! use dash_kernels::KernelError;
//! use dash_kernels::mlp::{MlpLayout, mlp};
//!
//! /// A curve as a network of one input.
//! #[derive(Module, Debug)]
//! struct Curve {
//!     parameters: Param<Tensor<1>>,
//! }
//!
//! impl Curve {
//!     /// `[N, 1] -> [N, 1]`
//!     fn forward(&self, x: Tensor<2>) -> Result<Tensor<2>, KernelError> {
//!         mlp(x, self.parameters.val(), &MlpLayout::new(&[1, 16, 1])?)
//!     }
//! }
//!
//! let device = Device::flex().autodiff();
//! let n_parameters = MlpLayout::new(&[1, 16, 1])?.n_parameters();
//! // Any fixed start that is not the same for all units will do here.
//! let start = Tensor::arange(0..n_parameters as i64, &device).float().sin();
//! let mut curve = Curve { parameters: Param::from_tensor(start) };
//! let x = Tensor::<1>::from_floats([-1.0, -0.5, 0.0, 0.5, 1.0], &device).reshape([5, 1]);
//! let y = x.clone().powf_scalar(2.0);
//! let mut optimizer = AdamConfig::new().init();
//! let mut losses = Vec::new();
//! for _ in 0..100 {
//!     let loss = (curve.forward(x.clone())? - y.clone()).powf_scalar(2.0).mean();
//!     losses.push(loss.clone().into_scalar::<f32>());
//!     let gradients = GradientsParams::from_grads(loss.backward(), &curve);
//!     curve = optimizer.step(1e-2, curve, gradients);
//! }
//! assert!(losses[99] < 0.1 * losses[0]);
//! # Ok::<(), KernelError>(())
//! ```
//!
//! # Features
//! | feature | brings | default |
//! | --- | --- | --- |
//! | `flex` | the CPU through burn-flex | yes |
//! | `ndarray` | the CPU through burn-ndarray | yes |
//! | `wgpu` | GPUs through Vulkan, Metal or DX12 | yes |
//! | `cube` | the CubeCL kernels without a runtime; `wgpu` and `cuda` bring it | yes |
//! | `cuda` | NVIDIA GPUs through CUDA; its build downloads LLVM | no |

#![cfg_attr(
    feature = "ndarray",
    expect(
        deprecated,
        reason = "burn-ndarray is deprecated in favour of burn-flex; we support both while it exists"
    )
)]

pub mod adam;
mod camera;
pub mod counts;
pub mod coverage;
#[cfg(feature = "cube")]
mod cube;
pub mod deform;
mod determinism;
pub mod displacement;
mod error;
pub mod exposure;
pub mod finite;
pub mod hash_encode;
mod host;
mod isa;
pub mod limits;
pub mod mlp;
mod outputs;
pub mod photometric;
#[cfg(test)]
mod poison_tests;
pub mod project;
pub mod rasterize;
pub mod rgba8;
pub mod rows;
pub mod screen_gradients;
pub mod smoothness;
pub mod space_time;
pub mod splats;
pub mod ssim;
pub mod tap;
mod tensor_list;
#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub mod testing;
pub mod trajectory;

pub use camera::Camera;
pub use determinism::{is_deterministic, set_deterministic};
pub use error::KernelError;
pub use glam;
pub use host::HostBackend;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
