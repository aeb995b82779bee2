//! How datasets are organised, and how that is recognised.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use super::{DatasetError, blender, colmap_model, files, n3dv, nerfies, rig, technicolor};

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
        })
    }
}

impl FromStr for Layout {
    type Err = DatasetError;

    fn from_str(name: &str) -> Result<Self, DatasetError> {
        <Self as ValueEnum>::from_str(name, true).map_err(|_| DatasetError::Option {
            option: "--layout",
            expected: "n3dv, blender, colmap, technicolor, nerfies or rig".into(),
            found: format!("`{name}`"),
        })
    }
}

impl Layout {
    /// Recognises the layout of a folder by its files.
    ///
    /// # Errors
    /// When the folder cannot be listed or has none of the known files.
    pub fn detect(root: &Path) -> Result<Self, DatasetError> {
        let names = files::list(root)?;
        let has = |wanted: &str| names.iter().any(|name| name == wanted);
        if has(technicolor::PARAMETERS_FILE) {
            Ok(Self::Technicolor)
        } else if has(n3dv::POSES_FILE)
            && (n3dv::has_cameras(root)? || !technicolor::is_prepared(root))
        {
            Ok(Self::N3dv)
        } else if technicolor::is_prepared(root) {
            Ok(Self::Technicolor)
        } else if rig::is_rig(root) {
            Ok(Self::Rig)
        } else if blender::FILES.iter().any(|name| has(name)) {
            Ok(Self::Blender)
        } else if [
            nerfies::DATASET_FILE,
            nerfies::METADATA_FILE,
            nerfies::CAMERA_FOLDER,
        ]
        .into_iter()
        .all(has)
        {
            Ok(Self::Nerfies)
        } else if colmap_model::model_folder(root, &colmap_model::MODEL_FOLDERS).is_some() {
            Ok(Self::Colmap)
        } else {
            let found = match names.as_slice() {
                [] => "an empty folder".into(),
                [first @ .., _] if first.len() >= 8 => format!("{}, ..", names[..8].join(", ")),
                _ => names.join(", "),
            };
            Err(DatasetError::invalid(
                root,
                "poses_bounds.npy (n3dv), transforms_train.json or transforms.json (blender, rig), \
                 sparse/0/cameras.bin (colmap, rig), dataset.json, metadata.json and camera/ (nerfies) \
                 or cameras_parameters.txt (technicolor)",
                found,
                "check the path, or choose the layout with --layout",
            ))
        }
    }
}
