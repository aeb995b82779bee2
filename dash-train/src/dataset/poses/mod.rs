//! Files of poses: cameras by LLFF, `transforms*.json`, COLMAP, Nerfies, Panoptic and Technicolor.
//!
//! | file | what |
//! | --- | --- |
//! | `pose.rs` | from axes or a quaternion to a camera; which poses are one camera's |
//! | `npy.rs`, `llff.rs`, `plain_order.rs` | `poses_bounds.npy`: rows, their cameras, and the order of names that they follow |
//! | `transforms.rs`, `nerfies.rs`, `panoptic.rs`, `technicolor.rs`, `colmap/` | the other files |
//! | `intrinsics.rs` | sizes, focal lengths and principal points, checked |
//! | `npz.rs` | one array of a NumPy archive |
//! | `known.rs` | poses by the names of cameras, from any of them |

pub(crate) mod colmap;
pub(crate) mod intrinsics;
pub(crate) mod known;
pub(crate) mod llff;
pub(crate) mod nerfies;
pub(crate) mod npy;
pub(crate) mod npz;
pub(crate) mod panoptic;
pub(crate) mod plain_order;
pub(crate) mod pose;
pub(crate) mod technicolor;
pub(crate) mod transforms;
