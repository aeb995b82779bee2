//! The Neural 3D Video layout: LLFF poses and, per camera, a folder of frames or a video; without
//! cameras, one image per pose (LLFF). The k-th camera or image in plain order of names has row k.

use std::fs;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use crate::Error;
use crate::dataset::format::{Capture, Folder, Format, Reader};
use crate::dataset::layout::Layout;
use crate::dataset::loader::{Loader, PlannedView};
use crate::dataset::multi_view;
use crate::dataset::multi_view::camera::{FrameFile, Frames, RigCamera, Source};
use crate::dataset::multi_view::folders::image_folders;
use crate::dataset::partition::{Partition, every_eighth};
use crate::dataset::pixels::dimensions;
use crate::dataset::pixels::distortion::Distortion;
use crate::dataset::pixels::frames::Source as ImageSource;
use crate::dataset::pixels::sizes::Sizes;
use crate::dataset::points::{Models, find_points};
use crate::dataset::poses::npy::parse_poses;
use crate::dataset::poses::{llff, plain_order};
use crate::files::{self, VIDEO_EXTENSIONS};

pub(super) const POSES_FILE: &str = "poses_bounds.npy";
/// Folder of the images of a capture without cameras.
const LLFF_FOLDER: &str = "images";
/// Names that an error lists.
const MOST_SHOWN: usize = 32;

/// Neural 3D Video, and LLFF.
pub(super) struct N3dv;

struct N3dvReader {
    folder: Folder,
}

impl Format for N3dv {
    fn layout(&self) -> Layout {
        Layout::N3dv
    }

    fn recognise(&self, folder: &Folder) -> Result<Option<Box<dyn Reader>>, Error> {
        folder
            .has(POSES_FILE)
            .then(|| self.open(folder))
            .transpose()
    }

    fn open(&self, folder: &Folder) -> Result<Box<dyn Reader>, Error> {
        Ok(Box::new(N3dvReader {
            folder: folder.clone(),
        }))
    }

    fn poses(&self, folder: &Folder) -> Result<Option<Vec<Camera>>, Error> {
        read_poses(&folder.root().join(POSES_FILE)).map(Some)
    }
}

impl Reader for N3dvReader {
    fn read(self: Box<Self>, loader: &Loader) -> Result<Capture, Error> {
        let poses_file = loader.root.join(POSES_FILE);
        let cameras = read_poses(&poses_file)?;
        match static_images(&self.folder)? {
            Some(images) => read_llff(loader, &poses_file, cameras, images),
            None => read_rig(loader, &self.folder, poses_file, cameras),
        }
    }
}

/// The cameras of the rows of `poses_bounds.npy`.
fn read_poses(path: &Path) -> Result<Vec<Camera>, Error> {
    let bytes = fs::read(path).map_err(Error::access(path))?;
    let rows = parse_poses(path, &bytes)?;
    let rows = rows.iter().enumerate();
    rows.map(|(index, row)| llff::camera(path, index, row))
        .collect()
}

/// The images of a capture without cameras; `None` where there are cameras or no images.
fn static_images(folder: &Folder) -> Result<Option<Vec<PathBuf>>, Error> {
    let inner = folder.root().join(LLFF_FOLDER);
    if has_cameras(folder) || !inner.is_dir() {
        return Ok(None);
    }
    Ok(Some(files::list_images(&inner)?).filter(|images| !images.is_empty()))
}

/// A rig: the k-th of the cameras belongs to row k.
fn read_rig(
    loader: &Loader,
    folder: &Folder,
    poses_file: PathBuf,
    cameras: Vec<Camera>,
) -> Result<Capture, Error> {
    let (mut sources, passed_over) = sources(folder)?;
    plain_order::sort(&mut sources, &poses_file, |source| {
        plain_order::file_name(&source.path)
    });
    check_videos(loader.root, &sources, &passed_over, cameras.len())?;
    let names: Vec<&str> = sources.iter().map(|source| source.name.as_str()).collect();
    check_count(loader.root, cameras.len(), &names, "camera")?;
    let n_cameras = cameras.len();
    let suggested = (0..n_cameras).map(|index| index == 0).collect();
    let held_out = loader.options.held_out(suggested)?;
    let points = find_points(loader.root, None, Models::Rig)?;
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
    multi_view::load(loader, &rig, &held_out, points)
}

fn check_count(path: &Path, n_rows: usize, names: &[&str], what: &str) -> Result<(), Error> {
    if names.len() == n_rows {
        return Ok(());
    }
    Err(Error::invalid(
        path,
        format!("one {what} per row of {POSES_FILE}, {n_rows} of them"),
        format!("{} ({})", names.len(), shown(names)),
        format!("remove the poses or the {what}s that have no counterpart"),
    ))
}

/// The names, or the first of them where they would fill a page.
fn shown(names: &[&str]) -> String {
    let most = names.len().min(MOST_SHOWN);
    let more = if names.len() > most { ", .." } else { "" };
    format!("{}{more}", names[..most].join(", "))
}

/// Refuses image folders of some cameras beside videos of others, unless the folders cover every row.
fn check_videos(
    path: &Path,
    sources: &[Source],
    passed_over: &[String],
    n_rows: usize,
) -> Result<(), Error> {
    let whole = sources.len() == n_rows && sources.iter().all(has_images);
    if passed_over.is_empty() || whole {
        return Ok(());
    }
    let with_images = sources.iter().filter(|source| has_images(source));
    let with_images: Vec<&str> = with_images.map(|source| source.name.as_str()).collect();
    let videos: Vec<&str> = passed_over.iter().map(String::as_str).collect();
    Err(Error::invalid(
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
    loader: &Loader,
    poses_file: &Path,
    cameras: Vec<Camera>,
    mut images: Vec<PathBuf>,
) -> Result<Capture, Error> {
    plain_order::sort(&mut images, poses_file, |path| plain_order::file_name(path));
    let images = FrameFile::by_stems(images);
    let folder = loader.root.join(LLFF_FOLDER);
    let names: Vec<&str> = images.iter().map(|image| image.label.as_str()).collect();
    check_count(&folder, cameras.len(), &names, "image")?;
    // All images are of one time.
    loader.options.wanted(&[0])?;
    let n_cameras = cameras.len();
    let held_out = loader.options.held_out(every_eighth(n_cameras))?;
    let mut planned = Vec::with_capacity(n_cameras);
    let mut sizes = Sizes::default();
    for (camera_index, (camera, image)) in cameras.iter().zip(images).enumerate() {
        let size = match dimensions(&image.file) {
            Ok(size) => size,
            // Left out below, with a warning.
            Err(_) if loader.options.skip_broken => (camera.width, camera.height),
            Err(error) => return Err(error),
        };
        planned.push(PlannedView {
            camera: sizes.resized(camera, size, &image.file, poses_file)?,
            source: ImageSource::File(image.file),
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
    sizes.warn_of_stretched();
    let points = find_points(loader.root, None, Models::Rig)?;
    Ok(Capture {
        views: loader.load_views(planned)?,
        points,
        n_frames: 1,
        n_cameras,
        stated_span: None,
        frame_rate: None,
    })
}

/// Whether the folder has camera folders or videos.
pub(super) fn has_cameras(folder: &Folder) -> bool {
    let root = folder.root();
    let is_any =
        |name: &String| is_camera_folder(root, name) || (is_camera(name) && is_video(root, name));
    folder.names().iter().any(is_any)
}

fn is_camera(name: &str) -> bool {
    name.get(..3)
        .is_some_and(|start| start.eq_ignore_ascii_case("cam"))
}

pub(super) fn is_camera_folder(root: &Path, name: &str) -> bool {
    is_camera(name) && name.ends_with(|c: char| c.is_ascii_digit()) && root.join(name).is_dir()
}

fn is_video(root: &Path, name: &str) -> bool {
    files::has_extension(name, &VIDEO_EXTENSIONS) && root.join(name).is_file()
}

fn has_images(source: &Source) -> bool {
    matches!(&source.frames, Frames::Images(images) if !images.is_empty())
}

/// The camera folders with images, else the camera videos, else camera folders in `images/`; and the videos that
/// are ignored in favour of other cameras' folders.
fn sources(folder: &Folder) -> Result<(Vec<Source>, Vec<String>), Error> {
    let (root, names) = (folder.root(), folder.names());
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
        let mut inner = image_folders(root)?;
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
        return Err(Error::invalid(
            root,
            "camera folders (cam00/images/0000.png, ..) or videos (cam00.mp4, ..)",
            found,
            "put the frames there, one folder or video per camera",
        ));
    }
    Ok((videos, Vec::new()))
}
