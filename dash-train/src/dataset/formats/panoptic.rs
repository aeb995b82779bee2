//! Panoptic Sports as Dynamic 3D Gaussians (Luiten et al. 2023) published it, and captures made for that code: pictures in
//! `ims/`, cameras in `train_meta.json` and `test_meta.json`, points in `init_pt_cld.npz`. `seg/` is not read.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use crate::Error;
use crate::dataset::broken::check_any;
use crate::dataset::format::{Capture, Folder, Format, Reader};
use crate::dataset::layout::Layout;
use crate::dataset::loader::{Loader, PlannedView};
use crate::dataset::partition::Partition;
use crate::dataset::pixels::frames::Source;
use crate::dataset::pixels::sizes::Sizes;
use crate::dataset::points::{Models, find_points};
use crate::dataset::poses::npy::parse_cloud;
use crate::dataset::poses::npz;
use crate::dataset::poses::panoptic::{Picture, parse};
use crate::dataset::times;
use crate::files::{self, find_image, frame_numbers};
use crate::ply::{PointCloud, white};

const TRAIN_FILE: &str = "train_meta.json";
const TEST_FILE: &str = "test_meta.json";
const IMAGE_FOLDER: &str = "ims";
const POINTS_FILE: &str = "init_pt_cld.npz";
/// The array of points: position, colour in [0, 1], and a label.
const POINTS_ARRAY: &str = "data";

/// Dynamic 3D Gaussians' layout.
pub(super) struct Panoptic;

struct PanopticReader;

/// A picture, the number of its time, and whether it is listed for testing.
struct Listed {
    picture: Picture,
    number: u64,
    is_test: bool,
}

impl Format for Panoptic {
    fn layout(&self) -> Layout {
        Layout::Panoptic
    }

    fn recognise(&self, folder: &Folder) -> Result<Option<Box<dyn Reader>>, Error> {
        [TRAIN_FILE, IMAGE_FOLDER]
            .iter()
            .all(|name| folder.has(name))
            .then(|| self.open(folder))
            .transpose()
    }

    fn open(&self, _: &Folder) -> Result<Box<dyn Reader>, Error> {
        Ok(Box::new(PanopticReader))
    }

    fn poses(&self, folder: &Folder) -> Result<Option<Vec<Camera>>, Error> {
        let listed = list(folder.root())?;
        let cameras: BTreeMap<u64, Camera> = listed
            .into_iter()
            .rev()
            .map(|listed| (listed.picture.camera_id, listed.picture.camera))
            .collect();
        Ok(Some(cameras.into_values().collect()))
    }
}

impl Reader for PanopticReader {
    fn read(self: Box<Self>, loader: &Loader) -> Result<Capture, Error> {
        let root = loader.root;
        let listed = list(root)?;
        let ids: BTreeSet<u64> = listed.iter().map(|l| l.picture.camera_id).collect();
        let has_tests = listed.iter().any(|listed| listed.is_test);
        let suggested = ids.iter().enumerate().map(|(index, id)| match has_tests {
            true => listed
                .iter()
                .any(|l| l.is_test && l.picture.camera_id == *id),
            false => index == 0,
        });
        let by_camera = loader.options.held_out(suggested.collect())?;
        let numbers: Vec<f64> = listed.iter().map(|listed| listed.number as f64).collect();
        let placed = times::frames(loader.options, &numbers)?;
        let mut sizes = Sizes::default();
        let mut planned = Vec::new();
        for (listed, place) in listed.into_iter().zip(placed.pictures) {
            let Some((frame, time)) = place else { continue };
            let Picture {
                camera_id, name, ..
            } = &listed.picture;
            let camera_index = ids.range(..camera_id).count();
            // Listed views keep their part, unless cameras are chosen.
            let held_out = match (&loader.options.test_cameras, has_tests) {
                (None, true) => listed.is_test,
                _ => by_camera[camera_index],
            };
            let file = picture_file(root, name, listed.is_test);
            let view = format!("the view {name}");
            let Some(file) = loader.broken.readable(&view, file)? else {
                continue;
            };
            planned.push(PlannedView {
                name: without_extension(name),
                camera_name: camera_id.to_string(),
                camera_index,
                frame,
                time,
                partition: Partition::held_out(held_out),
                camera: sizes.fit(listed.picture.camera, &file),
                source: Source::File(file),
                lens: None,
                mask: None,
            });
        }
        sizes.warn(&root.join(TRAIN_FILE));
        check_any(&root.join(TRAIN_FILE), !planned.is_empty())?;
        Ok(Capture {
            views: loader.load_views(planned)?,
            points: match cloud(root)? {
                Some(points) => Some(points),
                None => find_points(root, None, Models::Foreign)?,
            },
            n_frames: placed.n_frames,
            n_cameras: ids.len(),
            stated_span: None,
            frame_rate: None,
        })
    }
}

/// Every picture once, those of training first. One that is listed both to train on and to test with is for testing.
fn list(root: &Path) -> Result<Vec<Listed>, Error> {
    let read = |name: &str| {
        let path = root.join(name);
        let bytes = fs::read(&path).map_err(Error::access(&path))?;
        parse(&path, &bytes)
    };
    let train = read(TRAIN_FILE)?;
    let test = match root.join(TEST_FILE).is_file() {
        true => read(TEST_FILE)?,
        false => Vec::new(),
    };
    let tested: BTreeSet<&str> = test.iter().map(|picture| picture.name.as_str()).collect();
    let train: Vec<Picture> = train
        .iter()
        .filter(|picture| !tested.contains(picture.name.as_str()))
        .cloned()
        .collect();
    let numbers = [&train, &test].map(|pictures| numbers_of_times(pictures));
    // Where names don't count the times, both files count from 0.
    let counted = numbers.iter().all(Option::is_some);
    let parts = [train, test].into_iter().zip(numbers).zip([false, true]);
    let mut listed = Vec::new();
    for ((pictures, numbers), is_test) in parts {
        let numbers = numbers.filter(|_| counted).unwrap_or_default();
        listed.extend(pictures.into_iter().map(|picture| {
            Listed {
                number: numbers
                    .get(&picture.time)
                    .copied()
                    .unwrap_or(picture.time as u64),
                picture,
                is_test,
            }
        }));
    }
    Ok(listed)
}

/// For each time the frame number in the name of its first picture; `None` where these don't rise.
fn numbers_of_times(pictures: &[Picture]) -> Option<BTreeMap<usize, u64>> {
    let firsts: Vec<&Picture> = pictures
        .chunk_by(|a, b| a.time == b.time)
        .map(|time| &time[0])
        .collect();
    let stems: Vec<String> = firsts
        .iter()
        .map(|first| files::stem(Path::new(&first.name)))
        .collect();
    let numbers = frame_numbers(&stems)
        .into_iter()
        .map(|number| number?.parse().ok());
    let numbers: Vec<u64> = numbers.collect::<Option<_>>()?;
    let rise = numbers.is_sorted_by(|a, b| a < b);
    rise.then(|| firsts.iter().map(|first| first.time).zip(numbers).collect())
}

fn picture_file(root: &Path, name: &str, is_test: bool) -> Result<PathBuf, Error> {
    let listed_in = root.join(if is_test { TEST_FILE } else { TRAIN_FILE });
    let file = files::confined(&root.join(IMAGE_FOLDER), name, &listed_in)?;
    find_image(file, &listed_in)
}

/// `27/000000` of `27/000000.jpg`.
fn without_extension(name: &str) -> String {
    Path::new(name)
        .with_extension("")
        .to_string_lossy()
        .into_owned()
}

/// The points of [`POINTS_FILE`], if it is there and has some.
fn cloud(root: &Path) -> Result<Option<PointCloud>, Error> {
    let path = root.join(POINTS_FILE);
    if !path.is_file() {
        return Ok(None);
    }
    let bytes = fs::read(&path).map_err(Error::access(&path))?;
    let rows = parse_cloud(&path, &npz::array(&path, &bytes, POINTS_ARRAY)?)?;
    let mut points = PointCloud::default();
    // Other writers of this file have colours up to 255.
    let white = white(rows.iter().flat_map(|row| row[3..6].iter().copied()));
    for [x, y, z, r, g, b, _] in rows {
        let byte = |value: f64| (255.0 / white * value).clamp(0.0, 255.0).round() as u8;
        points.push_finite([x, y, z], [r, g, b].map(byte));
    }
    Ok(Some(points).filter(|points| !points.is_empty()))
}
