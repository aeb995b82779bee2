//! The COLMAP layout: a sparse model and the images it was made from.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use crate::Error;
use crate::dataset::broken::check_any;
use crate::dataset::format::{Capture, Folder, Format, Reader};
use crate::dataset::layout::Layout;
use crate::dataset::loader::{Loader, PlannedView};
use crate::dataset::partition::{Partition, every_eighth};
use crate::dataset::pixels::frames::Source;
use crate::dataset::pixels::lens::Lens;
use crate::dataset::pixels::sizes::Sizes;
use crate::dataset::points::{Models, find_points};
use crate::dataset::poses::colmap::{
    MODEL_FOLDERS, Model, has_file, model_folder, read_model, read_model_points, warn_of_larger,
};
use crate::dataset::unposed;
use crate::files::{self, find_image};

const IMAGE_FOLDER: &str = "images";

/// COLMAP's own layout.
pub(super) struct Colmap;

struct ColmapReader {
    /// The folder of the model.
    sparse: PathBuf,
}

/// The folder of the model: COLMAP's own, or the dataset's folder (RealityScan's flat export).
fn find_model(root: &Path) -> Option<PathBuf> {
    let is_flat = || has_file(root, "cameras") && has_file(root, "images");
    model_folder(root, &MODEL_FOLDERS).or_else(|| is_flat().then(|| root.to_path_buf()))
}

/// The folder that names of images are relative to: `images/`, or that of a flat export.
fn image_folder(root: &Path, sparse: &Path) -> PathBuf {
    let images = root.join(IMAGE_FOLDER);
    match sparse == root && !images.is_dir() {
        true => root.to_path_buf(),
        false => images,
    }
}

impl Format for Colmap {
    fn layout(&self) -> Layout {
        Layout::Colmap
    }

    fn recognise(&self, folder: &Folder) -> Result<Option<Box<dyn Reader>>, Error> {
        let sparse = find_model(folder.root());
        Ok(sparse.map(|sparse| Box::new(ColmapReader { sparse }) as Box<dyn Reader>))
    }

    fn open(&self, folder: &Folder) -> Result<Box<dyn Reader>, Error> {
        self.recognise(folder)?.ok_or_else(|| {
            Error::invalid(
                folder.root(),
                "a sparse model (sparse/0/cameras.bin or .txt, or cameras.txt beside the images)",
                "none",
                "run COLMAP, or choose the layout with --layout",
            )
        })
    }

    fn poses(&self, folder: &Folder) -> Result<Option<Vec<Camera>>, Error> {
        let Some(model) = find_model(folder.root()) else {
            return Ok(None);
        };
        let images = read_model(&model)?.images;
        Ok(Some(images.into_iter().map(|image| image.camera).collect()))
    }
}

impl Reader for ColmapReader {
    fn read(self: Box<Self>, loader: &Loader) -> Result<Capture, Error> {
        // All images are of one time.
        loader.options.wanted(&[0])?;
        let mut model = read_model(&self.sparse)?;
        warn_of_larger(&self.sparse, &model);
        // Plain order of names, as 3DGS sorts before it holds out every eighth.
        model.images.sort_by(|a, b| a.name.cmp(&b.name));
        let n_cameras = model.images.len();
        let held_out = loader.options.held_out(every_eighth(n_cameras))?;
        let folder = image_folder(loader.root, &self.sparse);
        let planned = plan(loader, &folder, &model, &held_out)?;
        let posed = planned.iter().map(|view| view.source.path().to_path_buf());
        unposed::warn_of_more(loader, &model.images_file, &posed.collect(), true);
        check_any(&model.images_file, !planned.is_empty())?;
        let points = match find_points(loader.root, None, Models::Own)? {
            Some(points) => Some(points),
            None => read_model_points(&self.sparse)?,
        };
        let views = loader.load_views(planned)?;
        Ok(Capture {
            views,
            points,
            n_frames: 1,
            n_cameras,
            stated_span: None,
            frame_rate: None,
        })
    }
}

/// The image of this name below `folder`; else below `root`, as a name that starts with `images/` is meant.
fn find(root: &Path, folder: &Path, name: &str, listed_in: &Path) -> Result<PathBuf, Error> {
    let below = |folder: &Path| {
        let file = files::confined(folder, name, listed_in)?;
        find_image(file, listed_in)
    };
    below(folder).or_else(|error| below(root).map_err(|_| error))
}

/// The views of a model's images, in its order.
fn plan(
    loader: &Loader,
    folder: &Path,
    model: &Model,
    held_out: &[bool],
) -> Result<Vec<PlannedView>, Error> {
    // Many images share a lens, and working out how to undo one takes a while.
    let mut lenses: HashMap<(u32, usize, usize), Option<Lens>> = HashMap::new();
    let mut sizes = Sizes::default();
    let mut planned = Vec::with_capacity(model.images.len());
    let mut first_of = HashMap::new();
    let mut shared = None;
    for (camera_index, image) in model.images.iter().enumerate() {
        let found = find(loader.root, folder, &image.name, &model.images_file);
        let Some(file) = loader
            .broken
            .readable(&format!("the image {}", image.name), found)?
        else {
            continue;
        };
        let camera = sizes.fit(image.camera.clone(), &file);
        let lens_of = (image.camera_id, camera.width, camera.height);
        let lens = match lenses.get(&lens_of) {
            Some(known) => known.clone(),
            None => {
                let lens = Lens::new(image.distortion, &camera, &model.cameras_file)?;
                lenses.insert(lens_of, lens.clone());
                lens
            }
        };
        if let Some(other) = first_of.insert(file.clone(), &image.name) {
            shared.get_or_insert([other, &image.name]);
        }
        let inside = file.strip_prefix(folder);
        let inside = inside.or_else(|_| file.strip_prefix(loader.root));
        let inside = inside.unwrap_or(&file);
        let name = inside.with_extension("").to_string_lossy().into_owned();
        planned.push(PlannedView {
            source: Source::File(file),
            camera_name: name.clone(),
            name,
            camera_index,
            frame: 0,
            time: 0.0,
            partition: Partition::held_out(held_out[camera_index]),
            camera,
            lens,
            mask: None,
        });
    }
    sizes.warn(&model.cameras_file);
    if let Some([a, b]) = shared {
        tracing::warn!(
            "{}: {a} and {b} are one picture here: put pictures of one name into different folders",
            model.images_file.display()
        );
    }
    Ok(planned)
}
