//! The Nerfies and HyperNeRF layout: one JSON file per image's camera, lists of ids, and a scene's
//! scale.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::Error;
use crate::dataset::broken::check_any;
use crate::dataset::format::{Capture, Folder, Format, Reader};
use crate::dataset::layout::Layout;
use crate::dataset::loader::{Loader, PlannedView};
use crate::dataset::partition::{Partition, every_eighth};
use crate::dataset::pixels::dimensions;
use crate::dataset::pixels::frames::Source;
use crate::dataset::pixels::lens::Lens;
use crate::dataset::pixels::sizes::Sizes;
use crate::dataset::points::{Models, colored, find_points};
use crate::dataset::poses::nerfies::CameraFile;
use crate::dataset::poses::npy::parse_points;
use crate::dataset::poses::pose;
use crate::dataset::times;
use crate::files::{self, find_image, parse_json};

const DATASET_FILE: &str = "dataset.json";
const METADATA_FILE: &str = "metadata.json";
const CAMERA_FOLDER: &str = "camera";
const SCENE_FILE: &str = "scene.json";
const POINTS_FILE: &str = "points.npy";
const IMAGE_FOLDER: &str = "rgb";

/// `dataset.json`.
#[derive(Deserialize)]
struct Ids {
    #[serde(default)]
    ids: Vec<Id>,
    #[serde(default)]
    train_ids: Vec<Id>,
    #[serde(default)]
    val_ids: Vec<Id>,
}

/// Ids are strings, and in some captures numbers.
#[derive(Deserialize)]
#[serde(untagged)]
enum Id {
    Text(String),
    Number(u64),
}

impl Id {
    fn text(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Number(number) => number.to_string(),
        }
    }
}

/// An entry of `metadata.json`; `warp_id` is the time of captures without `time_id`.
#[derive(Deserialize)]
struct Metadata {
    time_id: Option<f64>,
    warp_id: Option<f64>,
}

/// `scene.json`: world points `p` are used as `(p - center) * scale`.
#[derive(Deserialize)]
struct Scene {
    scale: f64,
    center: [f64; 3],
}

impl Scene {
    fn place(&self, point: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| (point[axis] - self.center[axis]) * self.scale)
    }
}

/// An image before its frame is known.
struct Item {
    id: String,
    file: PathBuf,
    camera: Camera,
    lens: Option<Lens>,
    held_out: bool,
}

/// Nerfies and HyperNeRF.
pub(super) struct Nerfies;

struct NerfiesReader;

impl Format for Nerfies {
    fn layout(&self) -> Layout {
        Layout::Nerfies
    }

    fn recognise(&self, folder: &Folder) -> Result<Option<Box<dyn Reader>>, Error> {
        [DATASET_FILE, METADATA_FILE, CAMERA_FOLDER]
            .iter()
            .all(|name| folder.has(name))
            .then(|| self.open(folder))
            .transpose()
    }

    fn open(&self, _: &Folder) -> Result<Box<dyn Reader>, Error> {
        Ok(Box::new(NerfiesReader))
    }
}

impl Reader for NerfiesReader {
    fn read(self: Box<Self>, loader: &Loader) -> Result<Capture, Error> {
        let root = loader.root;
        let scene = read_scene(root)?;
        let ids = read_ids(&root.join(DATASET_FILE))?;
        let folder = image_folder(root)?;
        let stated = read_times(&root.join(METADATA_FILE), &ids)?;
        // Times are only numbered: their distance in seconds is unknown.
        let placed = times::frames(loader.options, &stated)?;
        let n_frames = placed.n_frames;
        let mut items = Vec::new();
        let mut frames = Vec::new();
        let mut sizes = Sizes::default();
        for ((id, held_out), frame) in ids.into_iter().zip(placed.pictures) {
            let Some(frame) = frame else { continue };
            let Some(item) = read_item(loader, &scene, &folder, id, held_out, &mut sizes)? else {
                continue;
            };
            items.push(item);
            frames.push(frame);
        }
        check_any(&root.join(DATASET_FILE), !items.is_empty())?;
        sizes.warn_of_stretched();
        if !items.iter().any(|item| item.held_out) {
            let held_out = every_eighth(items.len());
            for (item, held_out) in items.iter_mut().zip(held_out) {
                item.held_out = held_out;
            }
        }
        let (camera_of, n_cameras) = pose::distinct_poses(items.iter().map(|item| &item.camera));
        if loader.options.test_cameras.is_some() {
            let held_out = loader.options.held_out(vec![false; n_cameras])?;
            for (item, &camera) in items.iter_mut().zip(&camera_of) {
                item.held_out = held_out[camera];
            }
        }
        let planned = items.into_iter().zip(camera_of).zip(frames);
        let planned = planned.map(|((item, camera_index), (frame, time))| PlannedView {
            source: Source::File(item.file),
            name: item.id,
            camera_name: format!("cam{camera_index:02}"),
            camera_index,
            frame,
            time,
            partition: Partition::held_out(item.held_out),
            camera: item.camera,
            lens: item.lens,
            mask: None,
        });
        let views = loader.load_views(planned.collect())?;
        let points = match read_positions(root, &scene)? {
            Some(positions) => Some(colored(positions, &views)?),
            None => find_points(root, None, Models::Foreign)?,
        };
        Ok(Capture {
            views,
            points,
            n_frames,
            n_cameras,
            stated_span: None,
            frame_rate: None,
        })
    }
}

fn read_json<T: DeserializeOwned>(path: &Path, expected: &str) -> Result<T, Error> {
    let bytes = fs::read(path).map_err(Error::access(path))?;
    parse_json(&bytes).map_err(|e| {
        Error::invalid(
            path,
            expected,
            e.to_string(),
            "mend the file or write it again",
        )
    })
}

/// The scene's scale and centre; the identity without the file.
fn read_scene(root: &Path) -> Result<Scene, Error> {
    let path = root.join(SCENE_FILE);
    if !path.is_file() {
        return Ok(Scene {
            scale: 1.0,
            center: [0.0; 3],
        });
    }
    let scene: Scene = read_json(&path, "JSON with `scale` and `center`")?;
    if scene.scale > 0.0 && scene.scale.is_finite() && scene.center.iter().all(|v| v.is_finite()) {
        return Ok(scene);
    }
    Err(Error::invalid(
        &path,
        "a positive finite `scale` and a finite `center`",
        format!("{} and {:?}", scene.scale, scene.center),
        "mend the file",
    ))
}

/// Every id and whether it is held out: training ids, then the others of validation. An id in both lists is held out, unless
/// all training ids are.
fn read_ids(path: &Path) -> Result<Vec<(String, bool)>, Error> {
    let lists: Ids = read_json(path, "JSON with `train_ids` and `val_ids`")?;
    let all = if lists.train_ids.is_empty() {
        &lists.ids
    } else {
        &lists.train_ids
    };
    let mut held_out: HashSet<String> = lists.val_ids.iter().map(Id::text).collect();
    if all.iter().all(|id| held_out.contains(&id.text())) {
        tracing::warn!(
            "{}: all training ids are in `val_ids`, too: they are trained on",
            path.display()
        );
        held_out.clear();
    }
    let is_held_out = |id: &String| held_out.contains(id);
    let mut seen = HashSet::new();
    let mut ids = Vec::new();
    for id in all.iter().map(Id::text) {
        if seen.insert(id.clone()) {
            ids.push((id.clone(), is_held_out(&id)));
        }
    }
    for id in lists.val_ids.iter().map(Id::text) {
        if seen.insert(id.clone()) {
            ids.push((id, true));
        }
    }
    if ids.is_empty() {
        return Err(Error::invalid(
            path,
            "at least one id in `train_ids` or `ids`",
            "none",
            "list the images' ids",
        ));
    }
    Ok(ids)
}

/// The time index of every id.
fn read_times(path: &Path, ids: &[(String, bool)]) -> Result<Vec<f64>, Error> {
    let expected = "JSON with `time_id` or `warp_id` for every id";
    let metadata: HashMap<String, Metadata> = read_json(path, expected)?;
    let time = |(id, _): &(String, bool)| {
        let entry = metadata.get(id);
        let number = entry.and_then(|entry| entry.time_id.or(entry.warp_id));
        match number {
            Some(number) if number >= 0.0 && number.fract() == 0.0 => Ok(number),
            Some(number) => Err(Error::invalid(
                path,
                "whole numbers of times from 0 on",
                format!("{number} for `{id}`"),
                "number the times",
            )),
            None => Err(Error::invalid(
                path,
                expected,
                format!("none for `{id}`"),
                "add it",
            )),
        }
    };
    ids.iter().map(time).collect()
}

/// The folder with the largest images.
fn image_folder(root: &Path) -> Result<PathBuf, Error> {
    let folder = root.join(IMAGE_FOLDER);
    let mut scales: Vec<(u32, String)> = files::list(&folder)?
        .into_iter()
        .filter_map(|name| Some((name.strip_suffix('x')?.parse().ok()?, name)))
        .collect();
    scales.sort();
    for (_, name) in &scales {
        let scaled = folder.join(name);
        if scaled.is_dir() && !files::list_images(&scaled)?.is_empty() {
            return Ok(scaled);
        }
    }
    let first = scales.first().map(|(_, name)| folder.join(name));
    let unread = first.map_or_else(String::new, |first| files::unread_images(&first));
    Err(Error::invalid(
        &folder,
        "images in 1x, 2x, 4x or so",
        format!("none{unread}"),
        "put the images there, as PNG or JPEG",
    ))
}

/// An id's camera at its image's size; `None` for an image that is left out.
fn read_item(
    loader: &Loader,
    scene: &Scene,
    folder: &Path,
    id: String,
    held_out: bool,
    sizes: &mut Sizes,
) -> Result<Option<Item>, Error> {
    let listed_in = loader.root.join(DATASET_FILE);
    let camera_folder = loader.root.join(CAMERA_FOLDER);
    let camera_file = files::confined(&camera_folder, &format!("{id}.json"), &listed_in)?;
    let file = files::confined(folder, &id, &listed_in)?;
    let found = find_image(file, &listed_in).and_then(|file| {
        require_camera(&camera_file, &listed_in)?;
        Ok((dimensions(&file)?, file))
    });
    let Some((size, file)) = loader.broken.readable(&format!("the view {id}"), found)? else {
        return Ok(None);
    };
    let stated: CameraFile = read_json(&camera_file, "JSON of a Nerfies camera")?;
    let (camera, distortion) = stated.camera(&camera_file, |position| scene.place(position))?;
    let camera = sizes.resized(&camera, size, &file, &camera_file)?;
    Ok(Some(Item {
        lens: Lens::new(distortion, &camera, &camera_file)?,
        id,
        file,
        camera,
        held_out,
    }))
}

/// Refuses an id whose camera is missing.
fn require_camera(file: &Path, listed_in: &Path) -> Result<(), Error> {
    if file.is_file() {
        return Ok(());
    }
    Err(Error::invalid(
        listed_in,
        format!("the camera {}", file.display()),
        "no such file",
        "put the file there, remove the id, or leave it out with --skip-broken",
    ))
}

fn read_positions(root: &Path, scene: &Scene) -> Result<Option<Vec<[f64; 3]>>, Error> {
    let path = root.join(POINTS_FILE);
    if !path.is_file() {
        return Ok(None);
    }
    let bytes = fs::read(&path).map_err(Error::access(&path))?;
    let positions = parse_points(&path, &bytes)?.into_iter();
    let placed: Vec<[f64; 3]> = positions.map(|p| scene.place(p)).collect();
    Ok(Some(placed).filter(|placed| !placed.is_empty()))
}
