//! The COLMAP layout: a sparse model and the images it was made from.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use super::distortion::Distortion;
use super::image::MAX_IMAGE_SIDE;
use super::view::{Context, Lens, PlannedView, Split};
use super::{
    DatasetError, Parts, colmap_binary as binary, colmap_text as text, every_eighth, files,
    find_points, pose,
};
use crate::ply::PointCloud;

const MODEL_FOLDERS: [&str; 2] = ["sparse/0", "sparse"];
const IMAGE_FOLDER: &str = "images";

/// A row of `cameras.bin` or `cameras.txt`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ModelCamera {
    pub(super) id: u32,
    pub(super) model: String,
    pub(super) width: u64,
    pub(super) height: u64,
    pub(super) parameters: Vec<f64>,
}

/// A row of `images.bin` or `images.txt`: the pose is world to camera, OpenCV axes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ModelImage {
    /// (w, x, y, z).
    pub(super) quaternion: [f64; 4],
    pub(super) translation: [f64; 3],
    pub(super) camera_id: u32,
    pub(super) name: String,
}

/// Name and number of parameters of COLMAP's camera models, by their ids.
pub(super) fn parameter_names(model: u32) -> Option<(&'static str, usize)> {
    const MODELS: [(&str, usize); 11] = [
        ("SIMPLE_PINHOLE", 3),
        ("PINHOLE", 4),
        ("SIMPLE_RADIAL", 4),
        ("RADIAL", 5),
        ("OPENCV", 8),
        ("OPENCV_FISHEYE", 8),
        ("FULL_OPENCV", 12),
        ("FOV", 5),
        ("SIMPLE_RADIAL_FISHEYE", 4),
        ("RADIAL_FISHEYE", 5),
        ("THIN_PRISM_FISHEYE", 12),
    ];
    MODELS.get(model as usize).copied()
}

/// The folder with a sparse model, in either format, if there is one.
pub(super) fn model_folder(root: &Path) -> Option<PathBuf> {
    let has_cameras = |folder: &PathBuf| {
        ["cameras.bin", "cameras.txt"]
            .iter()
            .any(|name| folder.join(name).is_file())
    };
    MODEL_FOLDERS
        .iter()
        .map(|name| root.join(name))
        .find(has_cameras)
}

/// The points of a sparse model, if it has the file.
pub(super) fn read_model_points(model: &Path) -> Result<Option<PointCloud>, DatasetError> {
    if !["points3D.bin", "points3D.txt"]
        .iter()
        .any(|name| model.join(name).is_file())
    {
        return Ok(None);
    }
    let (points, dropped) = read_model_file(model, "points3D", binary::points, text::points)?.1;
    if dropped > 0 {
        tracing::warn!(
            "{}: left out {dropped} points that are not finite",
            model.display()
        );
    }
    Ok(Some(points))
}

/// Reads one of the model's files, binary if there is one, and says which.
pub(super) fn read_model_file<T>(
    model: &Path,
    name: &str,
    parse_binary: impl Fn(&Path, &[u8]) -> Result<T, DatasetError>,
    parse_text: impl Fn(&Path, &str) -> Result<T, DatasetError>,
) -> Result<(PathBuf, T), DatasetError> {
    let path = model.join(format!("{name}.txt"));
    if path.is_file() && !model.join(format!("{name}.bin")).is_file() {
        let content = fs::read_to_string(&path).map_err(DatasetError::io(&path))?;
        let parsed = parse_text(&path, &content)?;
        return Ok((path, parsed));
    }
    let path = model.join(format!("{name}.bin"));
    let content = fs::read(&path).map_err(DatasetError::io(&path))?;
    let parsed = parse_binary(&path, &content)?;
    Ok((path, parsed))
}

pub(super) fn read(context: &Context) -> Result<Parts, DatasetError> {
    let Some(model) = model_folder(context.root) else {
        return Err(DatasetError::invalid(
            context.root,
            "a sparse model (sparse/0/cameras.bin or .txt)",
            "none",
            "run COLMAP, or choose the layout with --layout",
        ));
    };
    let (cameras_file, cameras) =
        read_model_file(&model, "cameras", binary::cameras, text::cameras)?;
    let (images_file, mut images) =
        read_model_file(&model, "images", binary::images, text::images)?;
    if images.is_empty() {
        let remedy = "run COLMAP's mapper until it registers images";
        return Err(DatasetError::invalid(
            &images_file,
            "registered images",
            "none",
            remedy,
        ));
    }
    // Plain order of names, as 3DGS sorts before it holds out every eighth.
    images.sort_by(|a, b| a.name.cmp(&b.name));
    let mut intrinsics = HashMap::new();
    for camera in &cameras {
        let (pinhole, distortion) = pinhole(camera, &cameras_file)?;
        let lens = Lens::new(distortion, &pinhole, &cameras_file)?;
        intrinsics.insert(camera.id, (pinhole, lens));
    }
    let n_cameras = images.len();
    let held_out = context.options.held_out(every_eighth(n_cameras))?;
    let mut planned = Vec::with_capacity(n_cameras);
    for (camera_index, image) in images.iter().enumerate() {
        let malformed = |expected: &str, found: String| {
            let remedy = "export the model again";
            let found = format!("{found} for image `{}`", image.name);
            DatasetError::invalid(&images_file, expected, found, remedy)
        };
        let Some((camera, lens)) = intrinsics.get(&image.camera_id) else {
            let found = format!("camera id {}", image.camera_id);
            return Err(malformed("cameras listed in the cameras file", found));
        };
        let camera = place(camera, image).map_err(|e| malformed("a finite pose", e))?;
        let folder = context.root.join(IMAGE_FOLDER);
        let file = files::confined(&folder, &image.name, &images_file)?;
        if !file.is_file() {
            let found = "no such file".to_string();
            return Err(malformed(&format!("the image {}", file.display()), found));
        }
        let inside = file.strip_prefix(&folder).unwrap_or(&file);
        let name = inside.with_extension("").to_string_lossy().into_owned();
        planned.push(PlannedView {
            file,
            camera_name: name.clone(),
            name,
            camera_index,
            frame: 0,
            time: 0.0,
            split: Split::held_out(held_out[camera_index]),
            camera,
            lens: lens.clone(),
        });
    }
    let points = find_points(context.root, None)?;
    let views = context.load_views(planned)?;
    Ok(Parts {
        views,
        points,
        n_frames: 1,
        n_cameras,
    })
}

/// The intrinsics and lens distortion of a model's camera.
pub(super) fn pinhole(
    camera: &ModelCamera,
    path: &Path,
) -> Result<(Camera, Distortion), DatasetError> {
    let malformed = |expected: &str, found: String| {
        let found = format!("{found} for camera {}", camera.id);
        let remedy = "undistort the images and export the model again (`colmap image_undistorter`)";
        DatasetError::invalid(path, expected, found, remedy)
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
        (model, parameters) => {
            return Err(malformed(
                "a camera model among SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL and OPENCV",
                format!("{model} with {} parameters", parameters.len()),
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
pub(super) fn place(intrinsics: &Camera, image: &ModelImage) -> Result<Camera, String> {
    let norm = image.quaternion.iter().map(|v| v * v).sum::<f64>().sqrt();
    if !(norm > 1e-12 && norm.is_finite()) {
        return Err("a quaternion that is zero, NaN or infinite".into());
    }
    let [w, x, y, z] = image.quaternion.map(|v| v / norm);
    let rows = [
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        ],
        [
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
        ],
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ];
    let position = [0, 1, 2].map(|axis| {
        -(0..3)
            .map(|row| rows[row][axis] * image.translation[row])
            .sum::<f64>()
    });
    pose::place(intrinsics.clone(), rows, position)
}
