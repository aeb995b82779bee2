//! The Technicolor light-field rig: 4x4 cameras, as published or prepared with a COLMAP model.

use std::collections::BTreeMap;
use std::fs;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use super::n3dv;
use crate::Error;
use crate::dataset::format::{Capture, Folder, Format, Reader};
use crate::dataset::layout::Layout;
use crate::dataset::loader::Loader;
use crate::dataset::multi_view;
use crate::dataset::multi_view::assign::pose_by_model;
use crate::dataset::multi_view::camera::{FrameFile, Frames, RigCamera, Source};
use crate::dataset::multi_view::folders::{IMAGE_FOLDER, image_folders};
use crate::dataset::pixels::distortion::Distortion;
use crate::dataset::points::{Models, find_points};
use crate::dataset::poses::colmap::{model_folder, read_model};
use crate::dataset::poses::technicolor::parse;
use crate::files::{self};

const PARAMETERS_FILE: &str = "cameras_parameters.txt";
/// Where the prepared layout has its model.
const MODEL_FOLDER: [&str; 1] = ["colmap/dense/workspace/sparse"];
/// Separates the scene from the numbers in a raw file's name.
const UNDISTORTED: &str = "_undist";
/// The held-out camera of published results.
const TEST_CAMERA: &str = "cam10";
/// The rig has this many; prepared folders with more are another rig's.
const MOST_CAMERAS: usize = 16;
/// The frames of published results, by scene.
const PUBLISHED: [(&str, RangeInclusive<u64>); 5] = [
    ("birthday", 151..=200),
    ("train", 151..=200),
    ("fabien", 51..=100),
    ("theater", 51..=100),
    ("painter", 100..=149),
];

/// The Technicolor rig.
pub(super) struct Technicolor;

enum TechnicolorReader {
    /// The file of parameters beside the published images.
    Raw(PathBuf),
    /// The COLMAP model beside a folder of frames per camera.
    Prepared(PathBuf),
}

impl Format for Technicolor {
    fn layout(&self) -> Layout {
        Layout::Technicolor
    }

    fn recognise(&self, folder: &Folder) -> Result<Option<Box<dyn Reader>>, Error> {
        if folder.has(PARAMETERS_FILE) {
            return self.open(folder).map(Some);
        }
        // Neural 3D Video has its cameras beside the poses.
        let is_n3dv = folder.has(n3dv::POSES_FILE) && n3dv::has_cameras(folder);
        let model = prepared_model(folder.root()).filter(|_| !is_n3dv);
        let reader = model.map(TechnicolorReader::Prepared);
        Ok(reader.map(|reader| Box::new(reader) as Box<dyn Reader>))
    }

    fn open(&self, folder: &Folder) -> Result<Box<dyn Reader>, Error> {
        let root = folder.root();
        let raw = root.join(PARAMETERS_FILE);
        if raw.is_file() {
            return Ok(Box::new(TechnicolorReader::Raw(raw)));
        }
        match model_folder(root, &MODEL_FOLDER) {
            Some(model) => Ok(Box::new(TechnicolorReader::Prepared(model))),
            None => Err(Error::invalid(
                root,
                format!(
                    "{PARAMETERS_FILE} beside <Scene>_undist_00000_00.png, .., or \
                     {} beside images/cam00/, ..",
                    MODEL_FOLDER[0]
                ),
                "neither",
                "check the path, or choose the layout with --layout",
            )),
        }
    }
}

/// The COLMAP model of a prepared scene, which has one folder of frames per camera.
fn prepared_model(root: &Path) -> Option<PathBuf> {
    let model = model_folder(root, &MODEL_FOLDER)?;
    let names = files::list(&root.join(IMAGE_FOLDER)).ok()?;
    let has_cameras = names.iter().any(|name| camera_number(name).is_some());
    has_cameras.then_some(model)
}

impl Reader for TechnicolorReader {
    fn read(self: Box<Self>, loader: &Loader) -> Result<Capture, Error> {
        let (cameras, is_rig) = match *self {
            Self::Raw(parameters) => (read_raw(loader, &parameters)?, true),
            Self::Prepared(model) => read_prepared(loader, &model)?,
        };
        let n_cameras = cameras.len();
        let mut names = cameras.iter().map(|camera| &camera.source.name);
        let test = names
            .position(|name| is_rig && name == TEST_CAMERA)
            .unwrap_or(0);
        let suggested = (0..n_cameras).map(|index| index == test).collect();
        let held_out = loader.options.held_out(suggested)?;
        let points = find_points(loader.root, None, Models::Rig)?;
        multi_view::load(loader, &cameras, &held_out, points)
    }
}

/// The prepared layout's cameras, and whether they can be the 4x4 rig's.
fn read_prepared(loader: &Loader, model: &Path) -> Result<(Vec<RigCamera>, bool), Error> {
    let mut sources = image_folders(loader.root)?;
    sources.retain(|source| camera_number(&source.name).is_some());
    if sources.is_empty() {
        return Err(Error::invalid(
            &loader.root.join(IMAGE_FOLDER),
            "a folder of frames per camera (cam00/0000.png, ..)",
            "none",
            "put the frames there",
        ));
    }
    let root = loader.root.canonicalize();
    let scene = root.unwrap_or_else(|_| loader.root.to_path_buf());
    let scene = scene.file_name().unwrap_or_default().to_string_lossy();
    let range = published(loader, &scene);
    for source in &mut sources {
        keep_published(source, &scene, range.as_ref());
    }
    let is_rig = sources.len() <= MOST_CAMERAS;
    let model = read_model(model)?;
    Ok((pose_by_model(sources, model)?, is_rig))
}

/// The raw layout's cameras.
fn read_raw(loader: &Loader, path: &Path) -> Result<Vec<RigCamera>, Error> {
    let bytes = fs::read(path).map_err(Error::access(path))?;
    let rows = parse(path, &String::from_utf8_lossy(&bytes))?;
    let (scene, frames) = raw_frames(loader.root)?;
    let range = published(loader, &scene);
    let mut cameras = Vec::with_capacity(frames.len());
    for (number, images) in frames {
        let name = format!("cam{number:02}");
        let Some(row) = rows.get(number) else {
            return Err(Error::invalid(
                path,
                format!("a line for every camera, {name} among them"),
                format!("{} lines", rows.len()),
                "complete the file, or remove that camera's images",
            ));
        };
        let mut source = Source {
            path: images[0]
                .file
                .with_file_name(format!("{scene}{UNDISTORTED}_*_{number:02}")),
            name,
            frames: Frames::Images(images),
        };
        keep_published(&mut source, &scene, range.as_ref());
        cameras.push(RigCamera {
            camera: row.camera(path, image_size(loader, &source)?)?,
            source,
            distortion: Distortion::default(),
            posed_by: path.to_path_buf(),
        });
    }
    Ok(cameras)
}

/// The scene's name and each camera's frames, from file names in the folder or its `images/`.
fn raw_frames(root: &Path) -> Result<(String, BTreeMap<usize, Vec<FrameFile>>), Error> {
    let mut found: Option<String> = None;
    let mut cameras: BTreeMap<usize, (Vec<PathBuf>, Vec<String>)> = BTreeMap::new();
    let inner = root.join(IMAGE_FOLDER);
    let mut images = files::list_images(root)?;
    if inner.is_dir() {
        images.extend(files::list_images(&inner)?);
    }
    for file in images {
        let stem = files::stem(&file);
        let Some((scene, frame, camera)) = raw_name(&stem) else {
            continue;
        };
        match &found {
            Some(first) if first != scene => {
                return Err(Error::invalid(
                    &file,
                    format!("images of one scene, {first}"),
                    format!("one of {scene}"),
                    "give every scene a folder of its own",
                ));
            }
            _ => found = Some(scene.to_string()),
        }
        let (files, labels) = cameras.entry(camera).or_default();
        labels.push(frame.to_string());
        files.push(file);
    }
    let cameras = cameras
        .into_iter()
        .map(|(camera, (files, labels))| (camera, FrameFile::labelled(files, labels)))
        .collect();
    match found {
        Some(scene) => Ok((scene, cameras)),
        None => Err(Error::invalid(
            root,
            format!("images called <Scene>{UNDISTORTED}_00000_00.png (frame, camera)"),
            "none",
            format!("put the undistorted images beside {PARAMETERS_FILE}"),
        )),
    }
}

/// Scene, frame and camera of `<Scene>_undist_%05d_%02d`.
fn raw_name(stem: &str) -> Option<(&str, &str, usize)> {
    let (rest, camera) = stem.rsplit_once('_')?;
    let (rest, frame) = rest.rsplit_once('_')?;
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|c| c.is_ascii_digit());
    let scene = rest.strip_suffix(UNDISTORTED)?;
    (digits(frame) && digits(camera)).then_some(())?;
    Some((scene, frame, camera.parse().ok()?))
}

/// The number in `camNN`.
fn camera_number(name: &str) -> Option<usize> {
    let start = name.get(..3)?;
    start.eq_ignore_ascii_case("cam").then_some(())?;
    name[3..].parse().ok()
}

/// The frames of published results, unless `--frames` chooses others.
fn published(loader: &Loader, scene: &str) -> Option<RangeInclusive<u64>> {
    if loader.options.frames.is_some() {
        return None;
    }
    let scene = scene.to_lowercase();
    let mut known = PUBLISHED.iter();
    known
        .find(|(name, _)| scene == *name)
        .map(|(_, range)| range.clone())
}

/// Drops a camera's other frames if it has all of the published ones.
fn keep_published(source: &mut Source, scene: &str, range: Option<&RangeInclusive<u64>>) {
    let (Frames::Images(images), Some(range)) = (&mut source.frames, range) else {
        return;
    };
    let inside = |image: &FrameFile| image.number().is_some_and(|n| range.contains(&n));
    let n_inside = images.iter().filter(|image| inside(image)).count();
    if n_inside == range.clone().count() && n_inside < images.len() {
        tracing::info!(
            "{}: only the published frames of {scene}, {} to {} (--frames all takes the others too)",
            source.path.display(),
            range.start(),
            range.end()
        );
        images.retain(inside);
    }
}

/// The size of a camera's images, which the parameters do not state.
fn image_size(loader: &Loader, source: &Source) -> Result<(usize, usize), Error> {
    let images = match &source.frames {
        Frames::Images(images) => images.as_slice(),
        Frames::Video => &[],
    };
    let files = images.iter().map(|image| image.file.as_path());
    loader.broken.first_size(files).unwrap_or_else(|| {
        Err(Error::invalid(
            &source.path,
            "at least one frame",
            "none",
            "put the frames there",
        ))
    })
}
