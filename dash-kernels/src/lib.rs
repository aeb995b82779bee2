//! Differentiable operations for dynamic Gaussian splatting on Burn tensors.
//!
//! No model, no files, no command line: each operation is a function on [`burn::tensor::Tensor`]
//! that runs on every enabled backend and differentiates on autodiff devices.
//!
//! # Conventions
//! - Shape letters: `N` Gaussians or points, `D` input dimensions, `L` levels, `F` features per
//!   level, `T` table entries, `H W` image, `K` SH coefficients, `C` channels.
//! - Camera: OpenCV axes (x right, y down, z forward), transforms named `a_from_b`, pinhole in
//!   pixels, pixel centres at +0.5.
//! - Quaternions are (w, x, y, z) and normalised inside the operation.
//! - The gradient of `x` is `v_x`; the pullback of `f` is `f_vjp`.
//! - CPU results are bit-identical for any number of threads. On GPUs a run repeats bit for bit
//!   after [`set_deterministic`].
//! - Operations don't wait for the device, unless determinism is asked for; a buffer that outgrows its limits is an error before it is
//!   made ([`limits`]).
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
#[cfg(feature = "cube")]
mod cube;
mod determinism;
pub mod displacement;
mod error;
pub mod finite;
pub mod hash_encode;
mod host;
mod isa;
pub mod limits;
pub mod mlp;
pub mod photometric;
#[cfg(test)]
mod poison_tests;
pub mod project;
pub mod rasterize;
pub mod rows;
pub mod space_time;
pub mod splats;
pub mod ssim;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod testing_hash;
pub mod trajectory;

pub use camera::Camera;
pub use determinism::{is_deterministic, set_deterministic};
pub use error::KernelError;
pub use host::HostBackend;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
