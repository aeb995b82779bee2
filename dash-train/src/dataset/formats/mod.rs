//! The formats that are read, and how one is recognised.
//!
//! | format | what it looks like |
//! | --- | --- |
//! | `n3dv.rs` | Neural 3D Video and LLFF: `poses_bounds.npy`, and `camNN/`, `cam*.mp4` or `images/` |
//! | `multipleview.rs` | 4DGaussians: `camNN/frame_*.jpg`, `sparse_/` |
//! | `technicolor.rs` | `cameras_parameters.txt`, or `images/camNN/` and COLMAP |
//! | `rig.rs` | a rig of the user's own: `videos/` or `images/CAMERA/`, and poses by camera |
//! | `blender/` | D-NeRF, Blender, nerfstudio: `transforms*.json` |
//! | `nerfies.rs` | Nerfies, HyperNeRF: `dataset.json`, `camera/`, `rgb/` |
//! | `panoptic.rs` | Panoptic Sports, Dynamic 3D Gaussians: `train_meta.json`, `ims/` |
//! | `colmap.rs` | a static capture: `sparse/0`, `images/`, or a model beside its images |
//!
//! A new format is a file here and a line in [`FORMATS`]; one outside this crate goes to
//! [`load_with`](super::load_with).

mod blender;
mod colmap;
mod multipleview;
mod n3dv;
mod nerfies;
mod panoptic;
mod rig;
mod technicolor;

use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use super::format::{Folder, Format, Reader};
use super::layout::Layout;
use crate::Error;
use crate::files::{self, VIDEO_EXTENSIONS};

/// The formats that are read; the first that recognises a folder reads it.
pub static FORMATS: [&dyn Format; 8] = [
    &technicolor::Technicolor,
    &n3dv::N3dv,
    &multipleview::Multipleview,
    &rig::Rig,
    &blender::Blender,
    &nerfies::Nerfies,
    &panoptic::Panoptic,
    &colmap::Colmap,
];
/// Files of captures that are not supported: what they are, and what the user can do.
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
/// Folders of images whose names start so are no cameras'.
const NO_CAMERAS: [&str; 3] = ["images", "masks", "depth"];
/// An error about a folder of datasets names so many of them,
const MOST_NAMED: usize = 3;
/// and looks into so many of its entries.
const MOST_LOOKED_INTO: usize = 256;

/// A layout and the reader of a folder.
pub(crate) type Recognised = (Layout, Box<dyn Reader>);

impl Layout {
    /// Recognises the layout of a folder by its files.
    ///
    /// # Errors
    /// When the folder cannot be listed or has none of the known files.
    pub fn detect(root: &Path) -> Result<Self, Error> {
        Ok(recognise(&Folder::list(root)?, &FORMATS)?.0)
    }
}

/// The layout and reader of a folder, by its files.
///
/// # Errors
/// When no format recognises the folder.
pub(crate) fn recognise(folder: &Folder, formats: &[&dyn Format]) -> Result<Recognised, Error> {
    match first_that_fits(folder, formats)? {
        Some(recognised) => Ok(recognised),
        None => Err(unknown(folder, formats)),
    }
}

/// The reader of a folder whose layout the user has chosen.
///
/// # Errors
/// When the folder lacks what the layout asks for.
pub(crate) fn open(
    layout: Layout,
    folder: &Folder,
    formats: &[&dyn Format],
) -> Result<Recognised, Error> {
    match formats.iter().find(|format| format.layout() == layout) {
        Some(format) => Ok((layout, format.open(folder)?)),
        None => Err(Error::LoadOption {
            option: "--layout",
            expected: "a layout that one of the formats reads".into(),
            found: format!("`{layout}`"),
        }),
    }
}

/// The cameras in a folder's poses; see [`Format::poses`].
///
/// # Errors
/// Names the file of poses that is missing or damaged.
pub(crate) fn poses_alone(root: &Path, layout: Layout) -> Result<Option<Vec<Camera>>, Error> {
    match FORMATS.iter().find(|format| format.layout() == layout) {
        Some(format) => format.poses(&Folder::list(root)?),
        None => Ok(None),
    }
}

fn first_that_fits(folder: &Folder, formats: &[&dyn Format]) -> Result<Option<Recognised>, Error> {
    for format in formats {
        if let Some(reader) = format.recognise(folder)? {
            return Ok(Some((format.layout(), reader)));
        }
    }
    Ok(None)
}

/// The error for a folder that no format recognises.
fn unknown(folder: &Folder, formats: &[&dyn Format]) -> Error {
    let (root, names) = (folder.root(), folder.names());
    for (file, found, remedy) in UNSUPPORTED {
        if folder.has(file) {
            let expected = "a capture in one of the layouts that are read";
            return Error::invalid(&root.join(file), expected, found, remedy);
        }
    }
    if let Some(error) = registration(folder) {
        return error;
    }
    let inner = datasets_in(folder, formats);
    if inner.is_empty()
        && let Some(error) = without_poses(folder)
    {
        return error;
    }
    if names.is_empty() || folder.has("config.toml") {
        let (found, remedy) = match names {
            [] => ("an empty folder", "check the path"),
            _ => (
                "a run",
                "name the run's dataset; `dash info` shows what the run holds",
            ),
        };
        return Error::invalid(root, "a dataset", found, remedy);
    }
    let mut found: String = match names {
        [first @ .., _] if first.len() >= 8 => format!("{}, ..", names[..8].join(", ")),
        _ => names.join(", "),
    };
    let mut remedy = "check the path, or choose the layout with --layout";
    if !inner.is_empty() {
        found += &format!(" (datasets among them: {})", inner.join(", "));
        remedy = "name the folder of one dataset";
    }
    Error::invalid(
        root,
        "poses_bounds.npy (n3dv), sparse_/ and camNN/ (multipleview), transforms_train.json or \
         transforms.json (blender, rig), sparse/0/cameras.bin (colmap, rig), cameras.txt and images.txt (colmap), \
         dataset.json, metadata.json and camera/ (nerfies), train_meta.json and ims/ (panoptic) \
         or cameras_parameters.txt (technicolor)",
        found,
        remedy,
    )
}

/// The error for recordings without poses: videos, or a folder of images for each camera.
fn without_poses(folder: &Folder) -> Option<Error> {
    let videos = |names: &[String]| {
        let videos = names.iter();
        videos
            .filter(|name| files::has_extension(name, &VIDEO_EXTENSIONS))
            .count()
    };
    let inner = |name: &str| Folder::list(&folder.root().join(name)).ok();
    let in_folder = inner("videos").map_or(0, |inner| videos(inner.names()));
    let n_videos = videos(folder.names()).max(in_folder);
    let has_images = |name: &&String| {
        if NO_CAMERAS.iter().any(|start| name.starts_with(start)) {
            return false;
        }
        let listed = inner(name).map(|inner| files::list_images(inner.root()));
        matches!(listed, Some(Ok(images)) if !images.is_empty())
    };
    let looked_into = folder.names().iter().take(MOST_LOOKED_INTO);
    let n_folders = looked_into.filter(has_images).count();
    let found = match (n_videos, n_folders) {
        (2.., _) => format!("{n_videos} videos, and no poses"),
        (_, 2..) => format!("{n_folders} folders of images, and no poses"),
        _ => return None,
    };
    Some(Error::invalid(
        folder.root(),
        "poses beside the recordings of the cameras",
        found,
        "make a dataset of them: `dash prepare FOOTAGE DATASET` finds poses with COLMAP, or takes yours",
    ))
}

/// The error for RealityScan's table of registrations, whose angles and sensor units are not read.
fn registration(folder: &Folder) -> Option<Error> {
    const COLUMNS: [&str; 4] = ["name", "heading", "pitch", "roll"];
    let is_table = |file: &PathBuf| {
        let text = std::fs::read(file).unwrap_or_default();
        let line = text.split(|&c| c == b'\n').next().unwrap_or_default();
        let line = String::from_utf8_lossy(line).to_lowercase();
        let columns: Vec<&str> = line.split([',', ';', '#']).map(str::trim).collect();
        COLUMNS.iter().all(|column| columns.contains(column))
    };
    let tables = folder
        .names()
        .iter()
        .filter(|name| files::has_extension(name, &["csv"]));
    let mut files = tables.take(MOST_NAMED).map(|name| folder.root().join(name));
    let file = files.find(is_table)?;
    Some(Error::invalid(
        &file,
        "a capture in one of the layouts that are read",
        "a table of registrations of RealityScan (RealityCapture), which is not read",
        "export the registration in COLMAP's format (cameras.txt, images.txt, points3D.txt) with its undistorted images",
    ))
}

/// The first of the folders in a folder that are datasets themselves.
fn datasets_in<'a>(folder: &'a Folder, formats: &[&dyn Format]) -> Vec<&'a str> {
    let is_dataset = |name: &&String| {
        let inner = Folder::list(&folder.root().join(name.as_str()));
        let Ok(inner) = inner else { return false };
        match first_that_fits(&inner, formats) {
            // A COLMAP model without its images is no dataset.
            Ok(Some((Layout::Colmap, _))) => inner.root().join("images").is_dir(),
            Ok(recognised) => recognised.is_some(),
            Err(_) => false,
        }
    };
    let looked_into = folder.names().iter().take(MOST_LOOKED_INTO);
    let found = looked_into.filter(is_dataset).take(MOST_NAMED);
    found.map(String::as_str).collect()
}
