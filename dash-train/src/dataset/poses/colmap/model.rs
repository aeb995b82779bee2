//! COLMAP's sparse models: cameras with poses and points, from binary or text files.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use super::binary;
use super::rows::{ModelCamera, ModelImage};
use super::text;
use crate::Error;
use crate::dataset::pixels::MAX_IMAGE_SIDE;
use crate::dataset::pixels::distortion::Distortion;
use crate::dataset::poses::pose;
use crate::files::{self, without_mark};
use crate::ply::{PointCloud, read_points};

/// Where COLMAP's own layout has its model.
pub(crate) const MODEL_FOLDERS: [&str; 2] = ["sparse/0", "sparse"];
/// Where rigs have COLMAP models, apart from `colmap_FRAME/sparse/0`, one per frame.
pub(crate) const RIG_MODEL_FOLDERS: [&str; 5] = [
    "sparse/0",
    "sparse",
    "colmap/sparse/0",
    "colmap/sparse",
    "colmap/dense/workspace/sparse",
];
/// Coefficients below this move no pixel that matters.
const NEGLIGIBLE: f64 = 1e-6;

/// A registered image: its name in the model, camera and lens.
#[derive(Debug, Clone)]
pub(crate) struct Registered {
    pub(crate) name: String,
    pub(crate) camera_id: u32,
    pub(crate) camera: Camera,
    pub(crate) distortion: Distortion,
}

/// A model's images in its own order.
pub(crate) struct Model {
    pub(crate) cameras_file: PathBuf,
    pub(crate) images_file: PathBuf,
    pub(crate) images: Vec<Registered>,
}

/// The first of the folders that holds a sparse model, in either format, if there is one. Where COLMAP's first model
/// (`sparse/0`) was taken away, its next one counts.
pub(crate) fn model_folder(root: &Path, folders: &[&str]) -> Option<PathBuf> {
    let has_cameras = |folder: &PathBuf| has_file(folder, "cameras");
    let first = folders.iter().map(|name| root.join(name)).find(has_cameras);
    first.or_else(|| {
        let parents = folders.iter().filter_map(|name| name.strip_suffix("/0"));
        let numbered = |parent: &str| {
            let parent = root.join(parent);
            let names = files::list(&parent).unwrap_or_default();
            let numbers = names.into_iter().filter(|name| is_number(name));
            numbers.map(|name| parent.join(name)).find(has_cameras)
        };
        parents.map(numbered).find_map(|found| found)
    })
}

/// Whether the folder has one of a model's files, binary or text.
pub(crate) fn has_file(folder: &Path, name: &str) -> bool {
    ["bin", "txt"]
        .iter()
        .any(|extension| folder.join(format!("{name}.{extension}")).is_file())
}

fn is_number(name: &str) -> bool {
    name.parse::<u32>().is_ok()
}

/// Warns if COLMAP made several models (`sparse/0`, `sparse/1`, ..) and another has more images than this one.
pub(crate) fn warn_of_larger(folder: &Path, model: &Model) {
    let n = model.images.len();
    if let Some((larger, more)) = larger_model(folder, n) {
        tracing::warn!(
            "{} has {n} image{}, but {} has {more}: COLMAP did not connect them all; to use the larger model, \
             let the two folders change names",
            folder.display(),
            if n == 1 { "" } else { "s" },
            larger.display()
        );
    }
}

/// The largest of the models beside this one of `n` images that has more, and its number of images.
fn larger_model(folder: &Path, n: usize) -> Option<(PathBuf, usize)> {
    let own = folder.file_name()?.to_str()?;
    let all = folder.parent().filter(|_| is_number(own))?;
    let names = files::list(all).ok()?;
    let others = names.iter().filter(|name| is_number(name) && *name != own);
    let counted = others.filter_map(|name| {
        let other = all.join(name);
        let count = |path: &Path, bytes: &[u8]| binary::Reader::new(path, bytes).count(1, "images");
        let listed = |path: &Path, content: &str| Ok(text::images(path, content)?.len());
        let (_, images) = read_model_file(&other, "images", count, listed).ok()?;
        (images > n).then_some((other, images))
    });
    counted.max_by_key(|&(_, images)| images)
}

/// The points of a sparse model, if it has any: in its own file, or in the PLY that it was exported to.
pub(crate) fn read_model_points(model: &Path) -> Result<Option<PointCloud>, Error> {
    let own = has_file(model, "points3D").then(|| read_own_points(model));
    let own = own.transpose()?.filter(|points| !points.is_empty());
    let exported = model.join("points3D.ply");
    match own {
        None if exported.is_file() => {
            Ok(Some(read_points(&exported)?).filter(|points| !points.is_empty()))
        }
        own => Ok(own),
    }
}

fn read_own_points(model: &Path) -> Result<PointCloud, Error> {
    let (points, dropped) = read_model_file(model, "points3D", binary::points, text::points)?.1;
    if dropped > 0 {
        tracing::warn!(
            "{}: left out {dropped} points that are not finite",
            model.display()
        );
    }
    Ok(points)
}

/// Reads one of the model's files, binary if there is one, and says which.
pub(crate) fn read_model_file<T>(
    model: &Path,
    name: &str,
    parse_binary: impl Fn(&Path, &[u8]) -> Result<T, Error>,
    parse_text: impl Fn(&Path, &str) -> Result<T, Error>,
) -> Result<(PathBuf, T), Error> {
    let path = model.join(format!("{name}.txt"));
    if path.is_file() && !model.join(format!("{name}.bin")).is_file() {
        let content = fs::read_to_string(&path).map_err(Error::access(&path))?;
        let parsed = parse_text(&path, without_mark(&content))?;
        return Ok((path, parsed));
    }
    let path = model.join(format!("{name}.bin"));
    let content = fs::read(&path).map_err(Error::access(&path))?;
    let parsed = parse_binary(&path, &content)?;
    Ok((path, parsed))
}

/// Reads the cameras and poses of the model in a folder.
///
/// # Errors
/// Names the file: missing, damaged, without images, or with an image's lens that is not supported.
pub(crate) fn read_model(model: &Path) -> Result<Model, Error> {
    let (cameras_file, cameras) =
        read_model_file(model, "cameras", binary::cameras, text::cameras)?;
    let (images_file, images) = read_model_file(model, "images", binary::images, text::images)?;
    if images.is_empty() {
        return Err(Error::invalid(
            &images_file,
            "registered images",
            "none",
            "run COLMAP's mapper until it registers images",
        ));
    }
    let used: HashSet<u32> = images.iter().map(|image| image.camera_id).collect();
    let mut intrinsics = HashMap::new();
    for camera in cameras.iter().filter(|camera| used.contains(&camera.id)) {
        intrinsics.insert(camera.id, pinhole(camera, &cameras_file)?);
    }
    let registered = |image: ModelImage| {
        let malformed = |expected: &str, found: String| {
            let found = format!("{found} for image `{}`", image.name);
            Error::invalid(&images_file, expected, found, "export the model again")
        };
        let Some((camera, distortion)) = intrinsics.get(&image.camera_id) else {
            let found = format!("camera id {}", image.camera_id);
            let listed_in = cameras_file.file_name().unwrap_or_default();
            let expected = format!("cameras listed in {}", listed_in.to_string_lossy());
            return Err(malformed(&expected, found));
        };
        let camera = place(camera, &image).map_err(|e| malformed("a finite pose", e))?;
        Ok(Registered {
            name: image.name,
            camera_id: image.camera_id,
            camera,
            distortion: *distortion,
        })
    };
    let images = images
        .into_iter()
        .map(registered)
        .collect::<Result<Vec<_>, Error>>()?;
    Ok(Model {
        cameras_file,
        images_file,
        images,
    })
}

/// The intrinsics and lens distortion of a model's camera.
pub(crate) fn pinhole(camera: &ModelCamera, path: &Path) -> Result<(Camera, Distortion), Error> {
    let malformed = |expected: &str, found: String| {
        let found = format!("{found} for camera {}", camera.id);
        let remedy = "undistort the images and export the model again (`colmap image_undistorter`)";
        Error::invalid(path, expected, found, remedy)
    };
    let lens = |k: [f64; 2], p| Distortion {
        k: [k[0], k[1], 0.0, 0.0],
        p,
    };
    let (fx, fy, cx, cy, distortion) = match (camera.model.as_str(), &camera.parameters[..]) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => (f, f, cx, cy, Distortion::default()),
        ("PINHOLE", &[fx, fy, cx, cy]) => (fx, fy, cx, cy, Distortion::default()),
        ("SIMPLE_RADIAL", &[f, cx, cy, k]) => (f, f, cx, cy, lens([k, 0.0], [0.0; 2])),
        ("RADIAL", &[f, cx, cy, k1, k2]) => (f, f, cx, cy, lens([k1, k2], [0.0; 2])),
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => (fx, fy, cx, cy, lens([k1, k2], [p1, p2])),
        ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) => {
            if [k4, k5, k6].iter().any(|k| k.abs() > NEGLIGIBLE) {
                return Err(malformed(
                    "FULL_OPENCV lenses whose k4, k5 and k6 are 0",
                    format!("{k4}, {k5}, {k6}"),
                ));
            }
            let k = [k1, k2, k3, 0.0];
            (fx, fy, cx, cy, Distortion { k, p: [p1, p2] })
        }
        (model, parameters) => {
            let kind = if model.contains("FISHEYE") || model == "FOV" {
                " (a fisheye lens)"
            } else {
                ""
            };
            return Err(malformed(
                "a camera model among SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV and \
                 FULL_OPENCV",
                format!("{model}{kind} with {} parameters", parameters.len()),
            ));
        }
    };
    let side = |v: u64| (1..=u64::from(MAX_IMAGE_SIDE)).contains(&v);
    if !(side(camera.width) && side(camera.height)) {
        let found = format!("{}x{}", camera.width, camera.height);
        return Err(malformed(
            &format!("image sizes from 1 to {MAX_IMAGE_SIDE}"),
            found,
        ));
    }
    let positive = |v: f64| v > 0.0 && v.is_finite();
    if !(positive(fx) && positive(fy) && cx.is_finite() && cy.is_finite() && distortion.is_finite())
    {
        return Err(malformed(
            "positive finite intrinsics",
            format!("{:?}", camera.parameters),
        ));
    }
    let (width, height) = (camera.width as usize, camera.height as usize);
    Ok((Camera::new(fx, fy, cx, cy, width, height), distortion))
}

/// The camera at an image's pose.
pub(crate) fn place(intrinsics: &Camera, image: &ModelImage) -> Result<Camera, String> {
    pose::place_by_quaternion(intrinsics.clone(), image.quaternion, image.translation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_larger_model_beside_is_found() {
        let root = tempfile::tempdir().expect("temporary folder");
        let model = |name: &str| root.path().join(name);
        let write = |name: &str, file: &str, bytes: &[u8]| {
            fs::create_dir_all(model(name)).expect("folder");
            fs::write(model(name).join(file), bytes).expect("writes");
        };
        let image = "1 1 0 0 0 0 0 0 1 a.png\n\n";
        write("0", "images.txt", image.as_bytes());
        write("1", "images.txt", image.repeat(3).as_bytes());
        let mut binary = 5u64.to_le_bytes().to_vec();
        binary.extend([0; 5]);
        write("12", "images.bin", &binary);
        write("13", "notes.txt", b"no model");
        write("old", "images.txt", image.repeat(9).as_bytes());
        assert_eq!(larger_model(&model("0"), 1), Some((model("12"), 5)));
        assert_eq!(larger_model(&model("12"), 5), None);
        assert_eq!(larger_model(&model("old"), 1), None);
        // Without a first model, the next one with cameras is read.
        let found = || model_folder(root.path(), &["a/0", "/0"]);
        assert_eq!(found(), None);
        write("12", "cameras.bin", b"");
        assert_eq!(found(), Some(model("12")));
        write("1", "cameras.txt", b"");
        assert_eq!(found(), Some(model("1")));
        write("0", "cameras.txt", b"");
        assert_eq!(found(), Some(model("0")));
    }
}
