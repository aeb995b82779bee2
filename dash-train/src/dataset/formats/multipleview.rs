//! The multi-view layout of 4DGaussians: `camNN/frame_00001.jpg`, .., and in `sparse_/` a COLMAP model with one image per
//! camera, `imageN.jpg` for `camNN`. Its `poses_bounds_multipleview.npy` holds a path to render and no pose that is read.

use std::path::Path;

use dash_kernels::Camera;

use super::n3dv::is_camera_folder;
use crate::Error;
use crate::dataset::format::{Capture, Folder, Format, Reader};
use crate::dataset::layout::Layout;
use crate::dataset::loader::Loader;
use crate::dataset::multi_view;
use crate::dataset::multi_view::assign::{find, pose_by_model};
use crate::dataset::multi_view::camera::{FrameFile, Frames, Source};
use crate::dataset::poses::colmap::{Model, read_model, read_model_points};
use crate::files;
use crate::ply::read_points;

const MODEL_FOLDER: &str = "sparse_";
const PATH_FILE: &str = "poses_bounds_multipleview.npy";
const POINT_FILE: &str = "points3D_multipleview.ply";

/// 4DGaussians' multi-view layout.
pub(super) struct Multipleview;

struct MultipleviewReader {
    folder: Folder,
}

impl Format for Multipleview {
    fn layout(&self) -> Layout {
        Layout::Multipleview
    }

    fn recognise(&self, folder: &Folder) -> Result<Option<Box<dyn Reader>>, Error> {
        let is_marked = [MODEL_FOLDER, PATH_FILE, POINT_FILE]
            .iter()
            .any(|name| folder.has(name));
        let has_cameras = || {
            let mut names = folder.names().iter();
            names.any(|name| is_camera_folder(folder.root(), name))
        };
        (is_marked && has_cameras())
            .then(|| self.open(folder))
            .transpose()
    }

    fn open(&self, folder: &Folder) -> Result<Box<dyn Reader>, Error> {
        Ok(Box::new(MultipleviewReader {
            folder: folder.clone(),
        }))
    }

    fn poses(&self, folder: &Folder) -> Result<Option<Vec<Camera>>, Error> {
        let images = read_model(&folder.root().join(MODEL_FOLDER))?.images;
        Ok(Some(images.into_iter().map(|image| image.camera).collect()))
    }
}

impl Reader for MultipleviewReader {
    fn read(self: Box<Self>, loader: &Loader) -> Result<Capture, Error> {
        let sources = sources(&self.folder)?;
        let sparse = loader.root.join(MODEL_FOLDER);
        let mut model = read_model(&sparse)?;
        name_after_cameras(&sources, &mut model);
        let cameras = pose_by_model(sources, model)?;
        let n_cameras = cameras.len();
        let suggested = (0..n_cameras).map(|index| index == 0).collect();
        let held_out = loader.options.held_out(suggested)?;
        let file = loader.root.join(POINT_FILE);
        let points = match file.is_file() {
            true => Some(read_points(&file)?).filter(|points| !points.is_empty()),
            false => read_model_points(&sparse)?,
        };
        multi_view::load(loader, &cameras, &held_out, points)
    }
}

/// The camera folders with images, in natural order.
fn sources(folder: &Folder) -> Result<Vec<Source>, Error> {
    let root = folder.root();
    let mut sources = Vec::new();
    for name in folder.names() {
        if !is_camera_folder(root, name) {
            continue;
        }
        let path = root.join(name);
        let images = files::list_images(&path)?;
        sources.push(Source {
            name: name.clone(),
            path,
            frames: Frames::Images(FrameFile::by_stems(images)),
        });
    }
    if !sources.iter().any(has_images) {
        return Err(Error::invalid(
            root,
            "camera folders with images (cam01/frame_00001.jpg, ..)",
            format!("{} camera folders without images", sources.len()),
            "put the frames there, one folder per camera",
        ));
    }
    Ok(sources)
}

fn has_images(source: &Source) -> bool {
    source.images().is_some_and(|images| !images.is_empty())
}

/// Gives the image of a camera's number (`image7.jpg`) its name (`cam07`), unless it is named after a camera already.
fn name_after_cameras(sources: &[Source], model: &mut Model) {
    for image in &mut model.images {
        let names = std::slice::from_ref(&image.name);
        if sources.iter().any(|source| !find(source, names).is_empty()) {
            continue;
        }
        let shown = number(&files::stem(Path::new(&image.name)));
        let same = |source: &&Source| shown.is_some() && number(&source.name) == shown;
        if let Some(source) = sources.iter().find(same) {
            image.name.clone_from(&source.name);
        }
    }
}

/// The number at a name's end.
fn number(name: &str) -> Option<u64> {
    let digits = name.rsplit(|c: char| !c.is_ascii_digit()).next()?;
    digits.parse().ok()
}
