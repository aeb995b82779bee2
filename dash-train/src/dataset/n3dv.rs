//! The Neural 3D Video layout: LLFF poses and, per camera, a folder of frames or a video.

use std::fs;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;
use rayon::prelude::*;

use super::image::{MAX_IMAGE_SIDE, dimensions};
use super::npy::{ROW, parse_rows};
use super::view::{Context, PlannedView, Split, View};
use super::{DatasetError, Parts, files, find_points, frame_time, pose, video};

pub(super) const POSES_FILE: &str = "poses_bounds.npy";
/// Frames may differ from the poses' aspect ratio by this much and one pixel.
const ASPECT_TOLERANCE: f64 = 0.01;

/// Where a camera's frames are.
enum Frames {
    Images(Vec<PathBuf>),
    Video(PathBuf),
}

struct Source {
    name: String,
    frames: Frames,
}

pub(super) fn read(context: &Context) -> Result<Parts, DatasetError> {
    let poses_file = context.root.join(POSES_FILE);
    let bytes = fs::read(&poses_file).map_err(DatasetError::io(&poses_file))?;
    let rows = parse_rows(&poses_file, &bytes)?;
    let cameras = rows
        .iter()
        .enumerate()
        .map(|(index, row)| camera(&poses_file, index, row))
        .collect::<Result<Vec<_>, _>>()?;
    let sources = sources(context.root)?;
    if sources.len() != cameras.len() {
        let names: Vec<&str> = sources.iter().map(|source| source.name.as_str()).collect();
        return Err(DatasetError::invalid(
            context.root,
            format!(
                "one camera per row of {POSES_FILE}, {} of them",
                cameras.len()
            ),
            format!("{} ({})", sources.len(), names.join(", ")),
            "remove the poses or the cameras that have no counterpart",
        ));
    }
    let n_cameras = cameras.len();
    let held_out = context
        .options
        .held_out((0..n_cameras).map(|index| index == 0).collect())?;
    let points = find_points(context.root, None)?;
    let (views, n_frames) = match image_lists(&sources) {
        Some(lists) => {
            check_frames(context.root, &sources, &lists)?;
            let planned = plan(context, &cameras, &sources, &lists, &held_out)?;
            let n_frames = planned.len() / n_cameras;
            (context.load_views(planned)?, n_frames)
        }
        None => decode_videos(context, &cameras, &sources, &held_out)?,
    };
    Ok(Parts {
        views,
        points,
        n_frames,
        n_cameras,
    })
}

/// The camera of one LLFF row: 3x5 of the axes down, right, backwards, the position and
/// (height, width, focal); then the depth bounds.
pub(super) fn camera(path: &Path, index: usize, row: &[f64; ROW]) -> Result<Camera, DatasetError> {
    let malformed = |found: String| {
        DatasetError::invalid(
            path,
            "in every row a finite pose, height, width, focal length and depth bounds",
            format!("{found} in row {index}"),
            "mend or remove that camera's row",
        )
    };
    if !row.iter().all(|v| v.is_finite()) {
        return Err(malformed("NaN or infinity".into()));
    }
    let column = |c: usize| [row[c], row[5 + c], row[10 + c]];
    let [height, width, focal] = column(4);
    let side = |v: f64| v >= 1.0 && v <= f64::from(MAX_IMAGE_SIDE);
    if !(side(height) && side(width) && focal > 0.0) {
        return Err(malformed(format!(
            "height {height}, width {width}, focal length {focal}"
        )));
    }
    let (width, height) = (width.round(), height.round());
    let intrinsics = Camera::new(
        focal,
        focal,
        width / 2.0,
        height / 2.0,
        width as usize,
        height as usize,
    );
    let axes = [column(1), column(0), column(2).map(|v| -v)];
    pose::place(intrinsics, axes, column(3)).map_err(malformed)
}

/// The camera folders that hold images, else the camera videos, in natural order.
fn sources(root: &Path) -> Result<Vec<Source>, DatasetError> {
    let is_camera = |name: &str| {
        name.get(..3)
            .is_some_and(|start| start.eq_ignore_ascii_case("cam"))
    };
    let names = files::list(root)?;
    let mut folders = Vec::new();
    for name in names
        .iter()
        .filter(|name| is_camera(name) && ends_in_digit(name))
    {
        let folder = root.join(name);
        if !folder.is_dir() {
            continue;
        }
        let inner = folder.join("images");
        let images = files::list_images(if inner.is_dir() { &inner } else { &folder })?;
        folders.push(Source {
            name: name.clone(),
            frames: Frames::Images(images),
        });
    }
    let has_images = |source: &Source| matches!(&source.frames, Frames::Images(i) if !i.is_empty());
    if folders.iter().any(has_images) {
        return Ok(folders);
    }
    let videos: Vec<Source> = names
        .iter()
        .filter(|name| is_camera(name) && files::has_extension(name, &["mp4"]))
        .map(|name| (root.join(name), name))
        .filter(|(path, _)| path.is_file())
        .map(|(path, name)| Source {
            name: files::stem(Path::new(name)),
            frames: Frames::Video(path),
        })
        .collect();
    if videos.is_empty() {
        let found = match folders.len() {
            0 => "none of these".into(),
            n => format!("{n} camera folders without images"),
        };
        return Err(DatasetError::invalid(
            root,
            "camera folders (cam00/images/0000.png, ..) or videos (cam00.mp4, ..)",
            found,
            "put the frames there, one folder or video per camera",
        ));
    }
    Ok(videos)
}

fn ends_in_digit(name: &str) -> bool {
    name.ends_with(|c: char| c.is_ascii_digit())
}

fn image_lists(sources: &[Source]) -> Option<Vec<&[PathBuf]>> {
    sources
        .iter()
        .map(|source| match &source.frames {
            Frames::Images(images) => Some(images.as_slice()),
            Frames::Video(_) => None,
        })
        .collect()
}

/// Every camera must have the same frames, or times would be mixed up between cameras.
fn check_frames(root: &Path, sources: &[Source], lists: &[&[PathBuf]]) -> Result<(), DatasetError> {
    let stems: Vec<Vec<String>> = lists
        .iter()
        .map(|list| list.iter().map(|path| files::stem(path)).collect())
        .collect();
    for (index, source) in sources.iter().enumerate() {
        let numbers: Vec<_> = stems[index]
            .iter()
            .map(|stem| files::frame_number(stem))
            .collect();
        if let Some(at) = numbers
            .windows(2)
            .position(|pair| pair[0].is_some() && pair[0] == pair[1])
        {
            return Err(DatasetError::invalid(
                &root.join(&source.name),
                "one image per frame",
                format!(
                    "{} twice (as {} too)",
                    lists[index][at].display(),
                    stems[index][at + 1]
                ),
                "remove the duplicate",
            ));
        }
        same_count(
            root,
            &sources[0].name,
            stems[0].len(),
            &source.name,
            stems[index].len(),
        )?;
        let differs = |at: &usize| files::frame_number(&stems[0][*at]) != numbers[*at];
        if let Some(at) = (0..numbers.len()).find(differs) {
            return Err(DatasetError::invalid(
                &root.join(&source.name),
                format!(
                    "the frames of {}, the next being {}",
                    sources[0].name, stems[0][at]
                ),
                stems[index][at].clone(),
                "give every camera the same frame numbers",
            ));
        }
    }
    Ok(())
}

fn same_count(
    root: &Path,
    first: &str,
    expected: usize,
    name: &str,
    found: usize,
) -> Result<(), DatasetError> {
    if found == expected {
        return Ok(());
    }
    Err(DatasetError::invalid(
        &root.join(name),
        format!("{expected} frames, as many as {first} has"),
        found.to_string(),
        "give every camera the same frames",
    ))
}

fn plan(
    context: &Context,
    cameras: &[Camera],
    sources: &[Source],
    lists: &[&[PathBuf]],
    held_out: &[bool],
) -> Result<Vec<PlannedView>, DatasetError> {
    let mut planned = Vec::new();
    for (camera_index, images) in lists.iter().enumerate() {
        let kept: Vec<&PathBuf> = (0..images.len())
            .filter(|&index| context.options.keeps_frame(index))
            .map(|index| &images[index])
            .collect();
        let Some(first) = kept.first() else { continue };
        let camera = at_size(&cameras[camera_index], dimensions(first)?, first)?;
        let camera_name = &sources[camera_index].name;
        for (frame, file) in kept.iter().enumerate() {
            planned.push(PlannedView {
                file: file.to_path_buf(),
                name: format!("{camera_name}/{}", files::stem(file)),
                camera_name: camera_name.clone(),
                camera_index,
                frame,
                time: frame_time(frame, kept.len()),
                split: Split::held_out(held_out[camera_index]),
                camera: camera.clone(),
                lens: None,
            });
        }
    }
    Ok(planned)
}

/// The camera at the frames' size, which may be another than the poses were estimated at.
fn at_size(
    camera: &Camera,
    (width, height): (usize, usize),
    path: &Path,
) -> Result<Camera, DatasetError> {
    let expected_height = width as f64 * camera.height as f64 / camera.width as f64;
    if (height as f64 - expected_height).abs() > 1.0 + ASPECT_TOLERANCE * expected_height {
        return Err(DatasetError::invalid(
            path,
            format!(
                "frames shaped like the {}x{} of {POSES_FILE}",
                camera.width, camera.height
            ),
            format!("{width}x{height}"),
            "use uncropped frames, or correct height, width and focal length in the poses",
        ));
    }
    Ok(camera.resized(width, height))
}

fn decode_videos(
    context: &Context,
    cameras: &[Camera],
    sources: &[Source],
    held_out: &[bool],
) -> Result<(Vec<View>, usize), DatasetError> {
    let options = context.options;
    let last_needed = options.max_frames.map(|max| {
        (max - 1)
            .saturating_mul(options.frame_stride)
            .saturating_add(1)
    });
    let decode = |(camera_index, source): (usize, &Source)| -> Result<Vec<View>, DatasetError> {
        let Frames::Video(path) = &source.frames else {
            return Ok(Vec::new());
        };
        let mut views: Vec<View> = Vec::new();
        video::decode_frames(path, last_needed, |index, image| {
            if !options.keeps_frame(index) {
                return Ok(());
            }
            let camera = at_size(&cameras[camera_index], (image.width, image.height), path)?;
            let planned = PlannedView {
                file: path.clone(),
                name: format!("{}/{index:04}", source.name),
                camera_name: source.name.clone(),
                camera_index,
                frame: views.len(),
                time: 0.0,
                split: Split::held_out(held_out[camera_index]),
                camera,
                lens: None,
            };
            views.push(context.finish(planned, image)?);
            Ok(())
        })?;
        Ok(views)
    };
    let per_camera = sources
        .par_iter()
        .enumerate()
        .map(decode)
        .collect::<Result<Vec<Vec<View>>, DatasetError>>()?;
    let n_frames = per_camera[0].len();
    for (source, views) in sources.iter().zip(&per_camera) {
        same_count(
            context.root,
            &sources[0].name,
            n_frames,
            &source.name,
            views.len(),
        )?;
    }
    let mut views: Vec<View> = per_camera.into_iter().flatten().collect();
    for view in &mut views {
        view.time = frame_time(view.frame, n_frames);
    }
    Ok((views, n_frames))
}
