//! The DASH model as Burn modules.
//!
//! Each module can be taken alone: [`HashEncoder`], [`Gaussians`], [`MotionField`],
//! [`DeformationField`], or the whole [`DynamicScene`].
//!
//! # Map
//! - `gaussians`: a set of 3D Gaussians and its host rows; `splat_ply`: the standard 3DGS PLY file.
//! - `hash_encoder`, `mlp`: the building blocks of fields.
//! - `space`: the box that a field covers, the basis of coarse trajectories.
//! - `motion`, `decomposition`: what moves (DASH Eqs. 3-5).
//! - `deformation`: how it moves (Eqs. 7-11); `encoders`: the features of that, in DASH's form and in others'.
//! - `gaps`, `unseen`: times of which nothing was seen, and the way through them.
//! - `scene`, `scene_file`: rendering (Eqs. 1-2, 10), and the scene on disk.
//! - `parameters`: parameters by name.
//!
//! # Features
//! | feature | brings | default |
//! | --- | --- | --- |
//! | `flex` | the CPU through burn-flex | yes |
//! | `ndarray` | the CPU through burn-ndarray | yes |
//! | `wgpu` | GPUs through Vulkan, Metal or DX12 | yes |
//! | `cuda` | NVIDIA GPUs through CUDA; its build downloads LLVM | no |
//!
//! Conventions are those of [`dash_kernels`]. Time is in [0, 1] over the clip, images are sRGB in
//! [0, 1].

pub mod decomposition;
mod deformation;
mod dynamic_part;
mod encoders;
mod error;
mod gaps;
mod gaussians;
mod hash_encoder;
pub mod mlp;
mod motion;
pub mod parameters;
mod scene;
pub mod scene_file;
mod space;
mod splat_ply;
mod unseen;

pub use dash_kernels::Camera;
pub use deformation::{DeformationConfig, DeformationField, Head, Heads, Offsets};
pub use dynamic_part::{Deformed, DynamicPart};
pub use encoders::{Grid4d, HexPlanes, Representation, SpaceTimeEncoder, TimeEmbedding};
pub use error::ModelError;
pub use gaps::{End, Gap, Gaps};
pub use gaussians::{GaussianRows, Gaussians, SH_C0, gather_rows, logit};
pub use hash_encoder::{HashEncoder, HashEncoderConfig};
pub use motion::MotionField;
pub use scene::{DynamicScene, Layer, OffsetPlacement, Rendering, SceneSettings};
pub use space::{SpaceBox, TrajectoryBasis};
pub use splat_ply::{Clipping, read_splat_ply, write_splat_ply};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
