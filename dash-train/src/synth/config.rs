//! What to render and how to write it.

use crate::Error;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Fewest pixels per side; below, the small object of [`SceneKind::Tiny`] is under one pixel.
pub const MIN_SIDE: usize = 16;
/// Most pixels per side; above, one view takes gigabytes.
pub const MAX_SIDE: usize = 8192;

/// Which scene to render.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum SceneKind {
    /// A textured room with clutter, a bouncing ball and a turning box.
    #[default]
    Bounce,
    /// The room of `bounce` with everything at rest.
    Static,
    /// The room at rest and one small fast object on under 0.5 % of the pixels.
    Tiny,
    /// Everything moves: the room sways, each object drifts and turns.
    Flow,
    /// For long clips: people carry something in and out, a door, a lamp that is switched on, a screen, a mirror, glass.
    Day,
}

/// How the files are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum SynthLayout {
    /// Neural 3D Video: `camNN/images/%04d.png` or `camNN.mp4`, and `poses_bounds.npy`.
    #[default]
    N3dv,
    /// Dynamic Blender (D-NeRF): `transforms_train.json` and `transforms_test.json`.
    Blender,
    /// COLMAP: the first frame as a static capture, `images/camNN.png` and a binary model.
    Colmap,
    /// Technicolor: `Synth_undist_%05d_%02d.png` and `cameras_parameters.txt`.
    Technicolor,
    /// Nerfies and HyperNeRF: `rgb/1x/ID.png`, `camera/ID.json` and lists of ids.
    Nerfies,
    /// Panoptic Sports, Dynamic 3D Gaussians: `ims/CAMERA/%06d.png`, `train_meta.json` and `test_meta.json`.
    Panoptic,
    /// A rig of videos: `videos/camNN.mp4` and `transforms.json` (needs ffmpeg).
    Rig,
}

macro_rules! named {
    ($name:ident, $setting:literal, $expected:literal, $($variant:ident => $text:literal),+) => {
        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(match self { $(Self::$variant => $text),+ })
            }
        }

        impl FromStr for $name {
            type Err = Error;

            fn from_str(text: &str) -> Result<Self, Error> {
                match text {
                    $($text => Ok(Self::$variant),)+
                    _ => Err(Error::setting($setting, $expected, format!("`{text}`"))),
                }
            }
        }
    };
}

named!(SceneKind, "--scene", "bounce, static, tiny, flow or day",
    Bounce => "bounce", Static => "static", Tiny => "tiny", Flow => "flow", Day => "day");
named!(SynthLayout, "--layout", "n3dv, blender, colmap, technicolor, nerfies, panoptic or rig",
    N3dv => "n3dv", Blender => "blender", Colmap => "colmap", Technicolor => "technicolor",
    Nerfies => "nerfies", Panoptic => "panoptic", Rig => "rig");

/// Settings of [`write`](fn@super::write).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SynthConfig {
    /// Which scene.
    pub scene: SceneKind,
    /// Which file layout.
    pub layout: SynthLayout,
    /// Number of cameras, 2 to 100; camera 0 is central, the others span the arc around it.
    pub cameras: usize,
    /// Number of frames, at least 1; frame `f` of `n` is at time `f / (n - 1)`. `colmap` holds
    /// the first one alone.
    pub frames: usize,
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// Varies colours, textures, the clutter's places and the noise of the point cloud.
    pub seed: u64,
    /// Write one MP4 per camera instead of PNG frames (`n3dv`, and always `rig`; needs ffmpeg).
    pub video: bool,
}

impl Default for SynthConfig {
    /// The quick start's clip: small enough to train on two CPU cores within minutes.
    fn default() -> Self {
        Self {
            scene: SceneKind::Bounce,
            layout: SynthLayout::N3dv,
            cameras: 12,
            frames: 24,
            width: 160,
            height: 120,
            seed: 0,
            video: false,
        }
    }
}

impl SynthConfig {
    /// Checks every setting against its range.
    ///
    /// # Errors
    /// [`Error::Setting`] for the first one outside.
    pub fn validate(&self) -> Result<(), Error> {
        let check = |good: bool, setting, found: String, expected| {
            if good {
                Ok(())
            } else {
                Err(Error::setting(setting, expected, found))
            }
        };
        check(
            (2..=100).contains(&self.cameras),
            "--cameras",
            self.cameras.to_string(),
            "2 to 100 (one is held out for testing)",
        )?;
        check(
            (1..=10_000).contains(&self.frames),
            "--frames",
            self.frames.to_string(),
            "1 to 10000",
        )?;
        check(
            [self.width, self.height]
                .iter()
                .all(|side| (MIN_SIDE..=MAX_SIDE).contains(side)),
            "--size",
            format!("{}x{}", self.width, self.height),
            "16 to 8192 pixels per side",
        )?;
        check(
            !self.video || matches!(self.layout, SynthLayout::N3dv | SynthLayout::Rig),
            "--video",
            format!("set with --layout {}", self.layout),
            "--layout n3dv or rig (the others hold images)",
        )
    }

    /// The settings with what the layout implies: one frame for `colmap`, videos for `rig`.
    pub(super) fn as_written(&self) -> Self {
        let layout = self.layout;
        Self {
            frames: if layout == SynthLayout::Colmap {
                1
            } else {
                self.frames
            },
            video: self.video || layout == SynthLayout::Rig,
            ..self.clone()
        }
    }

    /// The time of a frame, from 0 for the first to 1 for the last.
    pub fn time(&self, frame: usize) -> f64 {
        // A clip of one frame is the instant 0.
        frame as f64 / (self.frames - 1).max(1) as f64
    }
}
