//! How datasets are organised, and how that is recognised.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use super::{DatasetError, blender, colmap_model, files, n3dv, nerfies, rig, technicolor};

/// Files of captures that are not read, what these are, and what can be done.
const UNSUPPORTED: [(&str, &str, &str); 2] = [
    (
        "models.json",
        "a light field of Google's immersive videos, whose lenses are fisheye, which are not supported",
        "make perspective videos of it, put them into videos/, and write a pose for each into transforms.json (rig)",
    ),
    (
        "annots.npy",
        "a raw capture of ZJU-MoCap, whose cameras stand in a pickled array, which is not read",
        "put the pictures into images/CAMERA/, and write a pose for each camera into transforms.json (rig)",
    ),
];
/// Datasets that are named where a folder of them is given,
const MOST_NAMED: usize = 3;
/// and how many of its entries are looked into for them.
const MOST_LOOKED_INTO: usize = 256;

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
        if let Some(layout) = Self::known(root, &names)? {
            return Ok(layout);
        }
        for (file, found, remedy) in UNSUPPORTED {
            if names.iter().any(|name| name == file) {
                let expected = "a capture in one of the layouts that are read";
                let path = root.join(file);
                return Err(DatasetError::invalid(&path, expected, found, remedy));
            }
        }
        let mut found: String = match names.as_slice() {
            [] => "an empty folder".into(),
            [first @ .., _] if first.len() >= 8 => format!("{}, ..", names[..8].join(", ")),
            _ => names.join(", "),
        };
        let inner = datasets_in(root, &names);
        let mut remedy = "check the path, or choose the layout with --layout";
        if !inner.is_empty() {
            found += &format!(" (datasets among them: {})", inner.join(", "));
            remedy = "name the folder of one dataset";
        }
        Err(DatasetError::invalid(
            root,
            "poses_bounds.npy (n3dv), transforms_train.json or transforms.json (blender, rig), \
             sparse/0/cameras.bin (colmap, rig), dataset.json, metadata.json and camera/ (nerfies) \
             or cameras_parameters.txt (technicolor)",
            found,
            remedy,
        ))
    }

    /// The layout of a folder with these files; `None` where they are no layout's.
    fn known(root: &Path, names: &[String]) -> Result<Option<Self>, DatasetError> {
        let has = |wanted: &str| names.iter().any(|name| name == wanted);
        Ok(Some(if has(technicolor::PARAMETERS_FILE) {
            Self::Technicolor
        } else if has(n3dv::POSES_FILE)
            && (n3dv::has_cameras(root)? || !technicolor::is_prepared(root))
        {
            Self::N3dv
        } else if technicolor::is_prepared(root) {
            Self::Technicolor
        } else if rig::is_rig(root) {
            Self::Rig
        } else if blender::FILES.iter().any(|name| has(name)) {
            Self::Blender
        } else if [
            nerfies::DATASET_FILE,
            nerfies::METADATA_FILE,
            nerfies::CAMERA_FOLDER,
        ]
        .into_iter()
        .all(has)
        {
            Self::Nerfies
        } else if colmap_model::model_folder(root, &colmap_model::MODEL_FOLDERS).is_some() {
            Self::Colmap
        } else {
            return Ok(None);
        }))
    }
}

/// The first of the folders in `root` that are datasets themselves.
fn datasets_in<'a>(root: &Path, names: &'a [String]) -> Vec<&'a str> {
    let is_dataset = |name: &&String| {
        let folder = root.join(name.as_str());
        match files::list(&folder).and_then(|names| Layout::known(&folder, &names)) {
            // What COLMAP leaves beside images is none.
            Ok(Some(Layout::Colmap)) => folder.join("images").is_dir(),
            Ok(layout) => layout.is_some(),
            Err(_) => false,
        }
    };
    let looked_into = names.iter().take(MOST_LOOKED_INTO);
    let found = looked_into.filter(is_dataset).take(MOST_NAMED);
    found.map(String::as_str).collect()
}
