//! The poses of a rig's cameras, from the pose files of any layout, by camera name.

use std::fs;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use super::colmap::{MODEL_FOLDERS, has_file, model_folder, read_model as read_registered};
use super::npy::parse_poses;
use super::{llff, plain_order, pose, transforms};
use crate::Error;
use crate::dataset::pixels::distortion::Distortion;
use crate::dataset::pixels::lens::Lens;
use crate::dataset::pixels::scale::has_shape_of;
use crate::files::{self};

/// A camera and its lens.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct KnownCamera {
    /// Pose and intrinsics.
    pub(crate) camera: Camera,
    /// What the lens does to them.
    pub(crate) distortion: Distortion,
}

impl KnownCamera {
    /// The camera for images of another size.
    pub(crate) fn resized(&self, [width, height]: [usize; 2]) -> Self {
        Self {
            camera: self.camera.resized(width, height),
            distortion: self.distortion,
        }
    }

    /// Whether the lens's distortion can be undone at load.
    pub(crate) fn lens_can_be_undone(&self) -> bool {
        Lens::new(self.distortion, &self.camera, Path::new("")).is_ok()
    }
}

/// The poses in `path` of the cameras `names`, for images of the `sizes` (width, height): rows of a
/// `poses_bounds.npy` in plain order of the names, or the frames of a `transforms.json` or the images of a
/// COLMAP model that are named after the cameras (`cam01.png`, `cam01/images/0000.png`).
///
/// # Errors
/// When the file is damaged, has no pose for a camera or several different ones, or has poses for
/// pictures of another shape.
pub(crate) fn read(
    path: &Path,
    names: &[String],
    sizes: &[[usize; 2]],
) -> Result<Vec<KnownCamera>, Error> {
    let is = |extension| files::has_extension(&path.to_string_lossy(), &[extension]);
    let (listed_in, cameras) = if path.is_dir() {
        let folder = if has_file(path, "images") {
            path.to_path_buf()
        } else {
            model_folder(path, &MODEL_FOLDERS).ok_or_else(|| {
                Error::invalid(
                    path,
                    "a COLMAP model (cameras.bin and images.bin, or .txt)",
                    "none in this folder",
                    "name its folder, often sparse/0",
                )
            })?
        };
        let listed = read_model(&folder, names)?;
        (folder, listed)
    } else if is("npy") {
        (path.to_path_buf(), read_rows(path, names)?)
    } else if is("json") {
        (path.to_path_buf(), read_transforms(path, names, sizes)?)
    } else {
        // A path that does not exist is told apart from one of another kind.
        fs::metadata(path).map_err(Error::access(path))?;
        return Err(Error::invalid(
            path,
            "poses as poses_bounds.npy, transforms.json or the folder of a COLMAP model",
            "another kind of file",
            "convert the poses to one of these",
        ));
    };
    cameras
        .into_iter()
        .zip(names.iter().zip(sizes))
        .map(|(known, (name, &size))| fit(known, size, name, &listed_in))
        .collect()
}

/// The cameras of a COLMAP model with the names of their images, in the file's order.
///
/// # Errors
/// When a file is missing or damaged, or a camera model has no pinhole counterpart.
pub(crate) fn model_cameras(folder: &Path) -> Result<Vec<(String, KnownCamera)>, Error> {
    let model = read_registered(folder)?;
    Ok(model
        .images
        .into_iter()
        .map(|image| {
            let known = KnownCamera {
                camera: image.camera,
                distortion: image.distortion,
            };
            (image.name, known)
        })
        .collect())
}

fn read_rows(path: &Path, names: &[String]) -> Result<Vec<KnownCamera>, Error> {
    let bytes = fs::read(path).map_err(Error::access(path))?;
    let rows = parse_poses(path, &bytes)?;
    if rows.len() != names.len() {
        return Err(Error::invalid(
            path,
            format!("one row per camera, {} ({})", names.len(), names.join(", ")),
            format!("{} rows", rows.len()),
            "remove the poses or the cameras that have no counterpart",
        ));
    }
    let mut order: Vec<usize> = (0..names.len()).collect();
    plain_order::sort(&mut order, path, |&index| names[index].clone());
    let mut cameras = Vec::with_capacity(rows.len());
    for (row_index, (row, &index)) in rows.iter().zip(&order).enumerate() {
        let camera = llff::camera(path, row_index, row)?;
        cameras.push((index, camera));
    }
    cameras.sort_by_key(|&(index, _)| index);
    let known = cameras.into_iter().map(|(_, camera)| KnownCamera {
        camera,
        distortion: Distortion::default(),
    });
    Ok(known.collect())
}

fn read_transforms(
    path: &Path,
    names: &[String],
    sizes: &[[usize; 2]],
) -> Result<Vec<KnownCamera>, Error> {
    let transforms = transforms::parse(path)?;
    transforms.warn_of_keys(path);
    let mut poses = Vec::new();
    let mut unused = Vec::new();
    for frame in &transforms.frames {
        let Some(index) = camera_of(&frame.file_path, names) else {
            unused.push(frame.file_path.as_str());
            continue;
        };
        let [width, height] = sizes[index];
        let (camera, distortion) = transforms.camera(path, frame, || Ok((width, height)))?;
        poses.push((index, KnownCamera { camera, distortion }));
    }
    if !unused.is_empty() {
        tracing::warn!(
            "{}: poses of no camera of the recordings are not used: {}",
            path.display(),
            unused.join(", ")
        );
    }
    one_each(path, names, poses)
}

fn read_model(folder: &Path, names: &[String]) -> Result<Vec<KnownCamera>, Error> {
    let poses = model_cameras(folder)?
        .into_iter()
        .filter_map(|(image, known)| Some((camera_of(&image, names)?, known)))
        .collect();
    one_each(folder, names, poses)
}

/// The camera after which a file or one of its folders is named.
fn camera_of(file: &str, names: &[String]) -> Option<usize> {
    let file = PathBuf::from(files::one_form(file).replace('\\', "/"));
    let stem = files::stem(&file);
    let is_named = |name: &String| {
        let name = files::one_form(name);
        *name == stem
            || file
                .components()
                .any(|part| part.as_os_str().to_str() == Some(&*name))
    };
    names.iter().position(is_named)
}

/// One pose per camera out of those that were found.
fn one_each(
    path: &Path,
    names: &[String],
    poses: Vec<(usize, KnownCamera)>,
) -> Result<Vec<KnownCamera>, Error> {
    let mut found: Vec<Option<KnownCamera>> = vec![None; names.len()];
    let extent = pose::extent(poses.iter().map(|(_, known)| &known.camera));
    for (index, known) in poses {
        match &found[index] {
            Some(first) if !pose::same_pose(&first.camera, &known.camera, extent) => {
                return Err(Error::invalid(
                    path,
                    "one pose for each camera, which stands still",
                    format!("several different ones for {}", names[index]),
                    "leave one pose per camera, named after it",
                ));
            }
            Some(_) => {}
            None => found[index] = Some(known),
        }
    }
    let missing: Vec<&str> = names
        .iter()
        .zip(&found)
        .filter_map(|(name, found)| found.is_none().then_some(name.as_str()))
        .collect();
    if !missing.is_empty() {
        return Err(Error::invalid(
            path,
            "a pose for each camera, in an entry with its name (cam01.png or cam01/images/0000.png)",
            format!("none for {}", missing.join(", ")),
            "add their poses, rename the entries, or remove these cameras",
        ));
    }
    Ok(found.into_iter().flatten().collect())
}

/// The camera at the images' size, which may be another than the poses were made at.
fn fit(
    known: KnownCamera,
    size @ [width, height]: [usize; 2],
    name: &str,
    listed_in: &Path,
) -> Result<KnownCamera, Error> {
    let camera = &known.camera;
    if !has_shape_of(camera, (width, height)) {
        return Err(Error::invalid(
            listed_in,
            format!("poses for pictures shaped like the {width}x{height} of {name}"),
            format!("{}x{}", camera.width, camera.height),
            "use uncropped pictures, or correct the intrinsics",
        ));
    }
    Ok(known.resized(size))
}
