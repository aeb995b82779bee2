//! The Neural 3D Video layout: LLFF poses and, per camera, a folder of frames or a video; without
//! cameras, one image per pose (LLFF). The k-th camera or image in plain order of names has row k.

use std::fs;
use std::path::Path;

use dash_kernels::Camera;

use super::decode::{MAX_IMAGE_SIDE, dimensions};
use super::distortion::Distortion;
use super::npy::{POSE_COLUMNS, parse_poses};
use super::plan::{Context, PlannedView};
use super::points::{Models, find_points};
use super::sources::{self, FrameFile, Frames, RigCamera, Source, VIDEO_EXTENSIONS};
use super::view::Partition;
use super::{DatasetError, Parts, every_eighth, files, frames, plain_order, pose, rig};

pub(super) const POSES_FILE: &str = "poses_bounds.npy";
/// Folder of the images of a capture without cameras.
const LLFF_FOLDER: &str = "images";
/// Names that an error lists.
const MOST_SHOWN: usize = 32;

pub(super) fn read(context: &Context) -> Result<Parts, DatasetError> {
    let poses_file = context.root.join(POSES_FILE);
    let bytes = fs::read(&poses_file).map_err(DatasetError::io(&poses_file))?;
    let cameras = parse_poses(&poses_file, &bytes)?
        .iter()
        .enumerate()
        .map(|(index, row)| camera(&poses_file, index, row))
        .collect::<Result<Vec<_>, _>>()?;
    let folder = context.root.join(LLFF_FOLDER);
    if !has_cameras(context.root)? && folder.is_dir() {
        let mut images = files::list_images(&folder)?;
        if !images.is_empty() {
            plain_order::sort(&mut images, &poses_file, |path| {
                plain_order::file_name(path)
            });
            return read_llff(context, &folder, cameras, FrameFile::by_stems(images));
        }
    }
    let (mut sources, passed_over) = sources(context.root)?;
    plain_order::sort(&mut sources, &poses_file, |source| {
        plain_order::file_name(&source.path)
    });
    check_videos(context.root, &sources, &passed_over, cameras.len())?;
    let names: Vec<&str> = sources.iter().map(|source| source.name.as_str()).collect();
    check_count(context.root, cameras.len(), &names, "camera")?;
    let n_cameras = cameras.len();
    let held_out = context
        .options
        .held_out((0..n_cameras).map(|index| index == 0).collect())?;
    let points = find_points(context.root, None, Models::Rig)?;
    let rig: Vec<RigCamera> = sources
        .into_iter()
        .zip(cameras)
        .map(|(source, camera)| RigCamera {
            source,
            camera,
            distortion: Distortion::default(),
            posed_by: poses_file.clone(),
        })
        .collect();
    let (views, n_frames) = sources::load(context, &rig, &held_out)?;
    Ok(Parts {
        views,
        points,
        n_frames,
        n_cameras,
        stated_span: None,
    })
}

fn check_count(path: &Path, n_rows: usize, names: &[&str], what: &str) -> Result<(), DatasetError> {
    if names.len() == n_rows {
        return Ok(());
    }
    Err(DatasetError::invalid(
        path,
        format!("one {what} per row of {POSES_FILE}, {n_rows} of them"),
        format!("{} ({})", names.len(), shown(names)),
        format!("remove the poses or the {what}s that have no counterpart"),
    ))
}

/// Names in a row, the first ones if they are many: all of a large folder of images would be a page.
fn shown(names: &[&str]) -> String {
    let most = names.len().min(MOST_SHOWN);
    let more = if names.len() > most { ", .." } else { "" };
    format!("{}{more}", names[..most].join(", "))
}

/// Refuses frames of some cameras beside videos of others, where without these not every row has its frames.
fn check_videos(
    path: &Path,
    sources: &[Source],
    passed_over: &[String],
    n_rows: usize,
) -> Result<(), DatasetError> {
    let whole = sources.len() == n_rows && sources.iter().all(has_images);
    if passed_over.is_empty() || whole {
        return Ok(());
    }
    let with_images = sources.iter().filter(|source| has_images(source));
    let with_images: Vec<&str> = with_images.map(|source| source.name.as_str()).collect();
    let videos: Vec<&str> = passed_over.iter().map(String::as_str).collect();
    Err(DatasetError::invalid(
        path,
        format!("frames of all {n_rows} cameras as images, or a video of each"),
        format!(
            "images of {}, beside which these videos are passed over: {}",
            shown(&with_images),
            shown(&videos)
        ),
        "extract the frames of all videos, or remove the folders of images",
    ))
}

/// A static capture: the k-th of the images belongs to row k.
fn read_llff(
    context: &Context,
    folder: &Path,
    cameras: Vec<Camera>,
    images: Vec<FrameFile>,
) -> Result<Parts, DatasetError> {
    let names: Vec<&str> = images.iter().map(|image| image.label.as_str()).collect();
    check_count(folder, cameras.len(), &names, "image")?;
    // All images are of one time.
    context.options.wanted(&[0])?;
    let n_cameras = cameras.len();
    let held_out = context.options.held_out(every_eighth(n_cameras))?;
    let poses_file = context.root.join(POSES_FILE);
    let mut planned = Vec::with_capacity(n_cameras);
    for (camera_index, (camera, image)) in cameras.iter().zip(images).enumerate() {
        let size = match dimensions(&image.file) {
            Ok(size) => size,
            // Left out below, with a warning.
            Err(_) if context.options.skip_broken => (camera.width, camera.height),
            Err(error) => return Err(error),
        };
        planned.push(PlannedView {
            camera: sources::resized(camera, size, &image.file, &poses_file)?,
            source: frames::Source::File(image.file),
            name: image.label.clone(),
            camera_name: image.label,
            camera_index,
            frame: 0,
            time: 0.0,
            partition: Partition::held_out(held_out[camera_index]),
            lens: None,
            mask: None,
        });
    }
    let points = find_points(context.root, None, Models::Rig)?;
    Ok(Parts {
        views: context.load_views(planned)?,
        points,
        n_frames: 1,
        n_cameras,
        stated_span: None,
    })
}

/// The camera of one LLFF row: 3x5 of the axes down, right, backwards, the position and
/// (height, width, focal); then the depth bounds.
pub(super) fn camera(
    path: &Path,
    index: usize,
    row: &[f64; POSE_COLUMNS],
) -> Result<Camera, DatasetError> {
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

/// Whether the folder has camera folders or videos.
pub(super) fn has_cameras(root: &Path) -> Result<bool, DatasetError> {
    Ok(files::list(root)?
        .iter()
        .any(|name| is_camera_folder(root, name) || (is_camera(name) && is_video(root, name))))
}

fn is_camera(name: &str) -> bool {
    name.get(..3)
        .is_some_and(|start| start.eq_ignore_ascii_case("cam"))
}

fn is_camera_folder(root: &Path, name: &str) -> bool {
    is_camera(name) && name.ends_with(|c: char| c.is_ascii_digit()) && root.join(name).is_dir()
}

fn is_video(root: &Path, name: &str) -> bool {
    files::has_extension(name, &VIDEO_EXTENSIONS) && root.join(name).is_file()
}

fn has_images(source: &Source) -> bool {
    matches!(&source.frames, Frames::Images(images) if !images.is_empty())
}

/// The camera folders that hold images, else the camera videos, else camera folders in `images/`; and the
/// videos of cameras without images that are passed over for other cameras' folders.
fn sources(root: &Path) -> Result<(Vec<Source>, Vec<String>), DatasetError> {
    let names = files::list(root)?;
    let mut folders = Vec::new();
    for name in names.iter().filter(|name| is_camera_folder(root, name)) {
        let path = root.join(name);
        let inner = path.join("images");
        let images = files::list_images(if inner.is_dir() { &inner } else { &path })?;
        folders.push(Source {
            name: name.clone(),
            path,
            frames: Frames::Images(FrameFile::by_stems(images)),
        });
    }
    let is_camera_video = |name: &&String| is_camera(name) && is_video(root, name);
    let videos = names.iter().filter(is_camera_video);
    if folders.iter().any(has_images) {
        let is_extracted = |video: &String| {
            let camera = files::stem(Path::new(video));
            let mut with_images = folders.iter().filter(|folder| has_images(folder));
            with_images.any(|folder| folder.name == camera)
        };
        let passed_over = videos.filter(|video| !is_extracted(video)).cloned();
        let passed_over = passed_over.collect();
        return Ok((folders, passed_over));
    }
    let videos: Vec<Source> = videos
        .map(|name| Source {
            name: files::stem(Path::new(name)),
            path: root.join(name),
            frames: Frames::Video,
        })
        .collect();
    if videos.is_empty() {
        let mut inner = rig::image_folders(root)?;
        inner.retain(|source| is_camera(&source.name));
        if !inner.is_empty() {
            return Ok((inner, Vec::new()));
        }
        let found = match folders.len() {
            0 => "none of these".into(),
            n => {
                let other = files::unread_images(&folders[0].path);
                format!("{n} camera folders without images{other}")
            }
        };
        return Err(DatasetError::invalid(
            root,
            "camera folders (cam00/images/0000.png, ..) or videos (cam00.mp4, ..)",
            found,
            "put the frames there, one folder or video per camera",
        ));
    }
    Ok((videos, Vec::new()))
}
