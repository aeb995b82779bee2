//! Ray-traced multi-view videos with exact cameras and exact motion masks.
//!
//! [`write()`] renders a [`SceneKind`] and writes it as a dataset in one of the field's layouts.
//! [`render()`] renders one view of a [`Scene`].
//!
//! # World
//! Metres, y up, the floor at y = 0. A room 4.4 wide, open towards the cameras at +z, with clutter
//! on the floor, a table and a shelf. Cameras stand on an arc of +-30 degrees at 4.2 m from the
//! room's middle and at two heights; camera 0, the usual test camera, is in their middle. The room
//! fills every picture. Frame `f` of `n` is at time `f / (n - 1)`.
//!
//! # Motion masks
//! Surfaces are Lambertian under fixed light, without cast shadows or reflections, so that the
//! colour of a pixel depends on a moving object exactly where that object is the nearest surface
//! in one of its samples. A mask marks pixels where that holds for at least half of the samples.
//! Every frame is free of sensor noise, and all cameras share one exposure. In the scene `day` colours change for other
//! reasons, too: a lamp, a screen, and a mirror and glass that show what moves. Masks mark what moves alone.
//!
//! # Files
//! - `n3dv`: `camNN/images/%04d.png` or `camNN.mp4`; `poses_bounds.npy` (LLFF: camera-to-world
//!   columns down, right, backwards; height, width, focal length; near, far);
//!   `points3D_downsample2.ply`; `motion_masks/camNN/%04d.png`.
//! - `blender`: `transforms_train.json`, `transforms_test.json` (camera 0), `train/r_%04d.png` (one
//!   camera after another), `test/r_%04d.png`, `points3d.ply`, `motion_masks/train/`, `motion_masks/test/`.
//! - `colmap`: frame 0 as a static capture: `images/camNN.png`, `sparse/0/{cameras,images,points3D}.bin`.
//! - `technicolor`: `Synth_undist_%05d_%02d.png` (frame, camera), `cameras_parameters.txt`,
//!   `points3D_downsample2.ply`.
//! - `nerfies`: `rgb/1x/CC_FFFFF.png`, `camera/CC_FFFFF.json`, `dataset.json` (camera 0 in `val_ids`),
//!   `metadata.json`, `scene.json`, `points.npy`.
//! - `panoptic`: `ims/C/%06d.png`, `train_meta.json`, `test_meta.json` (camera 0), `init_pt_cld.npz`.
//! - `rig`: `videos/camNN.mp4`, `transforms.json`, `points3d.ply`.
//! - all: `motion_masks/`, and `truth.json`, see [`Truth`].
//!
//! # Modules
//! - `shape`: rays and solids; `texture`, `color` and `noise`: their surfaces; `motion`; `scene`: objects and light.
//! - `room`, `furniture`, `day` and `people`: the scenes; `rig`: cameras; `cloud`: points.
//! - `render`, `tracer` and `rendered`: pictures.
//! - `layout`, `poses`, `colmap`, `nerfies`, `panoptic` and `files`: formats; `truth`; `write`.

mod cloud;
mod colmap;
mod color;
mod config;
mod day;
mod files;
mod furniture;
mod layout;
mod motion;
mod nerfies;
mod noise;
mod panoptic;
mod people;
mod pose;
mod poses;
mod render;
mod rendered;
mod rig;
mod room;
mod scene;
mod shape;
mod texture;
mod tracer;
mod truth;
mod write;

#[cfg(test)]
mod tests;

pub use cloud::{CloudPoint, OUTLIER_EVERY, POINT_NOISE_M, cloud, cloud_size};
pub use config::{MAX_SIDE, MIN_SIDE, SceneKind, SynthConfig, SynthLayout};
pub use motion::{Drift, Motion};
pub use people::{Carried, Limb, Walk};
pub use pose::Pose;
pub use render::render;
pub use rendered::Rendered;
pub use rig::{focal_px, rig};
pub use room::BOX_TURN_RADIANS;
pub use scene::{Instant, Lamp, Look, Object, Posed, Role, Scene, Seen};
pub use shape::{Ray, Shape, SurfaceHit};
pub use texture::{EDGE_M, MOTTLE_CELL_M, Pattern, SHORTEST_PERIOD_M, Texture};
pub use tracer::SAMPLES_PER_SIDE;
pub use truth::{CameraTruth, MASK_RULE, ObjectTruth, Truth};
pub use write::{SynthSummary, write};

#[cfg(test)]
use crate::dataset::{Dataset, LoadOptions, load};

/// A clip of `bounce`, written and loaded again, all of it in memory.
#[cfg(test)]
pub(crate) fn loaded(cameras: usize, frames: usize, [width, height]: [usize; 2]) -> Dataset {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let config = SynthConfig {
        cameras,
        frames,
        width,
        height,
        ..SynthConfig::default()
    };
    write(folder.path(), &config).expect("writes");
    load(folder.path(), &LoadOptions::default()).expect("sound")
}
