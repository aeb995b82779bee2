//! The COLMAP layout: a sparse model and the images it was made from.

use std::collections::HashMap;

use super::broken::{check_any, readable};
use super::colmap_model::{MODEL_FOLDERS, Registered, model_folder, read_model, warn_of_larger};
use super::frames::Source;
use super::image_files::find_image;
use super::plan::{Context, Lens, PlannedView};
use super::points::{Models, find_points};
use super::sizes::Sizes;
use super::view::Partition;
use super::{DatasetError, Parts, every_eighth, files, unposed};

const IMAGE_FOLDER: &str = "images";

pub(super) fn read(context: &Context) -> Result<Parts, DatasetError> {
    let Some(sparse) = model_folder(context.root, &MODEL_FOLDERS) else {
        return Err(DatasetError::invalid(
            context.root,
            "a sparse model (sparse/0/cameras.bin or .txt)",
            "none",
            "run COLMAP, or choose the layout with --layout",
        ));
    };
    // All images are of one time.
    context.options.wanted(&[0])?;
    let mut model = read_model(&sparse)?;
    warn_of_larger(&sparse, &model);
    // Plain order of names, as 3DGS sorts before it holds out every eighth.
    model.images.sort_by(|a, b| a.name.cmp(&b.name));
    let n_cameras = model.images.len();
    let held_out = context.options.held_out(every_eighth(n_cameras))?;
    let folder = context.root.join(IMAGE_FOLDER);
    // Many images share a lens, and working out how to undo one takes a while.
    let mut lenses: HashMap<(u32, usize, usize), Option<Lens>> = HashMap::new();
    let mut sizes = Sizes::default();
    let mut planned = Vec::with_capacity(n_cameras);
    for (camera_index, image) in model.images.into_iter().enumerate() {
        let Registered {
            name,
            camera_id,
            camera,
            distortion,
        } = image;
        let file = files::confined(&folder, &name, &model.images_file)?;
        let found = find_image(file, &model.images_file);
        let Some(file) = readable(context, &format!("the image {name}"), found)? else {
            continue;
        };
        let camera = sizes.fit(camera, &file);
        let lens_of = (camera_id, camera.width, camera.height);
        let lens = match lenses.get(&lens_of) {
            Some(known) => known.clone(),
            None => {
                let lens = Lens::new(distortion, &camera, &model.cameras_file)?;
                lenses.insert(lens_of, lens.clone());
                lens
            }
        };
        let inside = file.strip_prefix(&folder).unwrap_or(&file);
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
    let posed = planned.iter().map(|view| view.source.path().to_path_buf());
    unposed::warn_of_more(context, &model.images_file, &posed.collect(), true);
    check_any(&model.images_file, !planned.is_empty())?;
    let points = find_points(context.root, None, Models::Own)?;
    let views = context.load_views(planned)?;
    Ok(Parts {
        views,
        points,
        n_frames: 1,
        n_cameras,
        stated_span: None,
    })
}
