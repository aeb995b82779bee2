//! The DASH model as Burn modules: dynamic-scene Gaussian splatting with 4D hash encoding and self-supervised
//! static/dynamic decomposition.
//!
//! A [`DynamicScene`] holds static [`Gaussians`] and an optional [`DynamicPart`]: canonical Gaussians with a
//! [`DeformationField`]. It renders a picture from a [`Camera`] at a time. Each module also works alone.
//!
//! # Conventions
//! Those of [`dash_kernels`], and:
//! - Time is in [0, 1] over the clip.
//! - Colours are sRGB in [0, 1].
//! - World units are the dataset's. Fields map a [`SpaceBox`] of the world onto the unit cube.
//! - Shape letters: `N` Gaussians or points, `D` input dimensions, `L` levels, `F` features per level, `T` table entries,
//!   `K` SH coefficients, `B` basis functions of trajectories, `E` values of an embedding, `H W` image.
//! - A module is built on a device, from the caller's random number generator. `device.autodiff()` makes it trainable.
//!
//! # Map
//! | items | are |
//! | --- | --- |
//! | [`Gaussians`], [`GaussianRows`] | a set of 3D Gaussians on a device, and its rows on the host for densify and prune |
//! | [`read_splats`], [`write_splats`] | files of Gaussians: 3DGS PLY (SuperSplat's compressed one is read, too), SPZ, `.splat`, GLB |
//! | [`HashEncoder`], [`mlp`] | building blocks of fields |
//! | [`SpaceBox`], [`TrajectoryBasis`] | the box that a field covers; coarse trajectories |
//! | [`MotionField`], [`decomposition`] | the first stage: coarse motion, and which Gaussians are dynamic (DASH Eqs. 3-5) |
//! | [`DeformationField`], [`Representation`] | the second stage: offsets over space and time (Eqs. 7-11), with DASH's encoder or those of other papers |
//! | [`Gaps`] | time gaps: where to interpolate and extrapolate |
//! | [`DynamicPart`], [`DynamicScene`] | deformation, rendering (Eqs. 1-2, 10), pruning of the field |
//! | [`Picture`] | a rendering in host memory |
//! | [`scene_file`] | the scene on disk |
//! | [`unfinished`] | files and folders that are not complete yet |
//! | [`parameters`] | parameters of any Burn module by name |
//!
//! # Features
//! | feature | brings | default |
//! | --- | --- | --- |
//! | `flex` | the CPU through burn-flex | yes |
//! | `ndarray` | the CPU through burn-ndarray | yes |
//! | `wgpu` | GPUs through Vulkan, Metal or DX12 | yes |
//! | `cuda` | NVIDIA GPUs through CUDA; its build downloads LLVM | no |
//!
//! # A module of this crate in your own model
//! All modules derive Burn's `Module`: put one into your own, and Burn's optimizers, records and visitors see it.
//!
//! ```
//! use burn::module::Module;
//! use burn::optim::{AdamConfig, GradientsParams};
//! use burn::tensor::{Device, Tensor};
//! use dash_model::mlp::Mlp;
//! use dash_model::{HashEncoder, HashEncoderConfig, ModelError};
//! use rand::SeedableRng;
//!
//! /// A colour for each point of a picture.
//! #[derive(Module, Debug)]
//! struct Picture {
//!     encoder: HashEncoder,
//!     decoder: Mlp,
//! }
//!
//! impl Picture {
//!     fn forward(&self, points: Tensor<2>) -> Result<Tensor<2>, ModelError> {
//!         Ok(self.decoder.forward(self.encoder.forward(points)?)?)
//!     }
//! }
//!
//! let device = Device::flex().autodiff();
//! let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
//! let encoder = HashEncoderConfig::new(4, 10, [4, 4], [64, 64]).init(&mut rng, &device)?;
//! let decoder = Mlp::new(&[encoder.n_output_features(), 16, 3], &mut rng, &device);
//! let picture = Picture { encoder, decoder };
//!
//! let points = Tensor::<2>::from_data([[0.1, 0.9], [0.5, 0.5]], &device);
//! let loss = picture.forward(points)?.powi_scalar(2).mean();
//! let gradients = GradientsParams::from_grads(loss.backward(), &picture);
//! let mut adam = AdamConfig::new().init();
//! let picture = adam.step(1e-2, picture, gradients);
//! assert!(picture.num_params() > 0);
//! # Ok::<(), ModelError>(())
//! ```

pub mod decomposition;
mod deformation;
mod dynamic_part;
mod encoders;
mod error;
mod gaussians;
mod hash_encoder;
pub mod mlp;
mod motion;
pub mod parameters;
mod picture;
mod scene;
pub mod scene_file;
mod space_box;
mod splat_file;
mod splat_ply;
mod time_gaps;
mod time_windows;
mod trajectory;
pub mod unfinished;

pub use dash_kernels::Camera;
pub use deformation::{DeformationConfig, DeformationField, Head, Heads, Offsets};
pub use dynamic_part::{Deformed, DynamicPart};
pub use encoders::{Grid4d, HexPlanes, Representation, SpaceTimeEncoder, TimeEmbedding};
pub use error::{ModelError, io_remedy};
pub use gaussians::{GaussianRows, Gaussians, SH_C0, gather_rows, logit};
pub use hash_encoder::{HashEncoder, HashEncoderConfig};
pub use motion::MotionField;
pub use picture::{NO_SURFACE_ALPHA, Picture, rgb8, to_host};
pub use scene::{DynamicScene, Layer, OffsetPlacement, Rendering, SceneSettings};
pub use space_box::SpaceBox;
pub use splat_file::{SplatFormat, read_splats, write_splats};
pub use splat_ply::{LeftOut, SplatFile, is_splat_ply, read_splat_ply, write_splat_ply};
pub use time_gaps::{GapExtrapolation, GapInterpolation, Gaps};
pub use time_windows::TimeWindows;
pub use trajectory::TrajectoryBasis;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
