//! The names of layouts.

use std::fmt;
use std::str::FromStr;

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use crate::Error;

/// How a dataset's folder is organised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// Neural 3D Video: `poses_bounds.npy` (LLFF) and one folder or video per camera.
    N3dv,
    /// D-NeRF, Blender, nerfstudio: `transforms*.json`.
    Blender,
    /// COLMAP: `images/` and a sparse model; static.
    Colmap,
    /// Technicolor: `cameras_parameters.txt`, or `images/camNN/` and a COLMAP model of one frame.
    Technicolor,
    /// Nerfies, HyperNeRF: `dataset.json`, `metadata.json`, `camera/` and `rgb/`.
    Nerfies,
    /// A rig: `videos/` or `images/CAMERA/`, and poses by the cameras' names.
    Rig,
    /// 4DGaussians, multi-view: `camNN/frame_*.jpg` and a COLMAP model in `sparse_/`.
    Multipleview,
    /// Panoptic Sports, Dynamic 3D Gaussians: `train_meta.json`, `test_meta.json` and `ims/`.
    Panoptic,
    /// A format outside this crate; see [`Format`](super::Format).
    #[value(skip)]
    Custom,
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::N3dv => "n3dv",
            Self::Blender => "blender",
            Self::Colmap => "colmap",
            Self::Technicolor => "technicolor",
            Self::Nerfies => "nerfies",
            Self::Rig => "rig",
            Self::Multipleview => "multipleview",
            Self::Panoptic => "panoptic",
            Self::Custom => "custom",
        })
    }
}

impl FromStr for Layout {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        <Self as ValueEnum>::from_str(name, true).map_err(|_| Error::LoadOption {
            option: "--layout",
            expected: "n3dv, blender, colmap, technicolor, nerfies, rig, multipleview or panoptic"
                .into(),
            found: format!("`{name}`"),
        })
    }
}
