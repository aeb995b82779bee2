//! The layout of D-NeRF, Blender and nerfstudio: `transforms*.json` beside the images.

use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use super::distortion::Distortion;
use super::image::dimensions;
use super::transforms::{Transforms, find_image, parse};
use super::view::{Context, Lens, PlannedView, Split};
use super::{DatasetError, Parts, every_eighth, files, find_points, pose};

const SINGLE: &str = "transforms.json";
const TRAIN: &str = "transforms_train.json";
const TEST: &str = "transforms_test.json";
const VAL: &str = "transforms_val.json";
/// Either of these makes a folder this layout's.
pub(super) const FILES: [&str; 2] = [TRAIN, SINGLE];
/// Times closer than this are one frame's.
const SAME_TIME: f64 = 1e-6;

/// A frame of any of the files.
struct Entry {
    file: PathBuf,
    name: String,
    camera_name: Option<String>,
    time: Option<f64>,
    camera: Camera,
    distortion: Distortion,
    listed_in: PathBuf,
    held_out: bool,
}

pub(super) fn read(context: &Context) -> Result<Parts, DatasetError> {
    let path = |name: &str| context.root.join(name);
    let mut entries = Vec::new();
    let first = if path(TRAIN).is_file() {
        path(TRAIN)
    } else {
        path(SINGLE)
    };
    let transforms = parse(&first)?;
    collect(context, &first, &transforms, false, &mut entries)?;
    // Validation views serve only where there are no test views.
    let held_out = [TEST, VAL]
        .map(path)
        .into_iter()
        .find(|p| first != path(SINGLE) && p.is_file());
    match held_out {
        Some(file) => collect(context, &file, &parse(&file)?, true, &mut entries)?,
        None => hold_out_every_eighth(&mut entries),
    }
    let (times, n_frames) = frames(context, &mut entries)?;
    let (camera_of, camera_names) = cameras(&entries);
    let n_cameras = camera_names.len();
    if context.options.test_cameras.is_some() {
        let held_out = context.options.held_out(vec![false; n_cameras])?;
        for (entry, &camera) in entries.iter_mut().zip(&camera_of) {
            entry.held_out = held_out[camera];
        }
    }
    let mut planned = Vec::with_capacity(entries.len());
    for ((entry, &camera_index), (frame, time)) in entries.into_iter().zip(&camera_of).zip(times) {
        planned.push(PlannedView {
            lens: Lens::new(entry.distortion, &entry.camera, &entry.listed_in)?,
            file: entry.file,
            name: entry.name,
            camera_name: camera_names[camera_index].clone(),
            camera_index,
            frame,
            time,
            split: Split::held_out(entry.held_out),
            camera: entry.camera,
        });
    }
    let named = transforms
        .ply_file_path
        .as_deref()
        .map(|name| files::confined(context.root, name, &first))
        .transpose()?;
    let points = find_points(context.root, named.as_deref())?;
    let views = context.load_views(planned)?;
    Ok(Parts {
        views,
        points,
        n_frames,
        n_cameras,
    })
}

fn collect(
    context: &Context,
    listed_in: &Path,
    transforms: &Transforms,
    held_out: bool,
    entries: &mut Vec<Entry>,
) -> Result<(), DatasetError> {
    for frame in &transforms.frames {
        let file = files::confined(context.root, &frame.file_path, listed_in)?;
        let file = find_image(file, listed_in)?;
        let (camera, distortion) = transforms.camera(listed_in, frame, || dimensions(&file))?;
        let finite = distortion.is_finite() && frame.time.is_none_or(f64::is_finite);
        if !finite {
            return Err(DatasetError::invalid(
                listed_in,
                "finite times and distortion coefficients",
                format!("NaN or infinity in frame `{}`", frame.file_path),
                "mend that frame's entry",
            ));
        }
        let inside = file.strip_prefix(context.root).unwrap_or(&file);
        entries.push(Entry {
            name: inside
                .with_extension("")
                .to_string_lossy()
                .replace('\\', "/"),
            file,
            camera_name: frame.camera_name().map(str::to_string),
            time: frame.time,
            camera,
            distortion,
            listed_in: listed_in.to_path_buf(),
            held_out,
        });
    }
    Ok(())
}

/// Without a file of test views every eighth in the order of names is held out.
fn hold_out_every_eighth(entries: &mut [Entry]) {
    let mut order: Vec<usize> = (0..entries.len()).collect();
    order.sort_by(|&a, &b| files::natural_cmp(&entries[a].name, &entries[b].name));
    for (index, held_out) in order.into_iter().zip(every_eighth(entries.len())) {
        entries[index].held_out = held_out;
    }
}

/// The frame index and time in [0, 1] of every entry, and the number of distinct times. Entries
/// whose frame is not wanted are removed. Times are kept where they lie in [0, 1] already, and
/// stretched over [0, 1] otherwise and when only some of the frames are loaded.
fn frames(
    context: &Context,
    entries: &mut Vec<Entry>,
) -> Result<(Vec<(usize, f32)>, usize), DatasetError> {
    let with_time = entries.iter().filter(|entry| entry.time.is_some()).count();
    if let Some(entry) = entries.iter().find(|entry| entry.time.is_none())
        && with_time > 0
    {
        return Err(DatasetError::invalid(
            &entry.listed_in,
            "`time` in every frame or in none",
            format!("none in frame `{}`", entry.name),
            "add the missing times",
        ));
    }
    let time_of = |entry: &Entry| entry.time.unwrap_or(0.0);
    let mut distinct: Vec<f64> = entries.iter().map(time_of).collect();
    distinct.sort_by(f64::total_cmp);
    distinct.dedup_by(|later, earlier| *later - *earlier < SAME_TIME);
    let index_of = |time: f64, all: &[f64]| all.partition_point(|&t| t <= time).saturating_sub(1);
    let keeps = |index: usize| context.options.keeps_frame(index);
    let n_all = distinct.len();
    entries.retain(|entry| keeps(index_of(time_of(entry), &distinct)));
    let mut index = 0..n_all;
    distinct.retain(|_| index.next().is_some_and(keeps));

    let n_frames = distinct.len();
    let (start, end) = (distinct[0], distinct[n_frames - 1]);
    let stated = n_all == n_frames && start >= 0.0 && end <= 1.0;
    let times = entries
        .iter()
        .map(|entry| {
            let time = time_of(entry);
            let unit = match (n_frames, stated) {
                (1, _) => 0.0,
                (_, true) => time,
                (_, false) => (time - start) / (end - start),
            };
            (index_of(time, &distinct), unit.clamp(0.0, 1.0) as f32)
        })
        .collect();
    Ok((times, n_frames))
}

/// For each entry the index of its camera, and the cameras' names: those that the file states, in their
/// order, where every entry has one; else numbers of the distinct poses.
fn cameras(entries: &[Entry]) -> (Vec<usize>, Vec<String>) {
    let stated: Option<Vec<&String>> = entries.iter().map(|e| e.camera_name.as_ref()).collect();
    let Some(stated) = stated else {
        let (indices, n) = distinct_poses(entries);
        return (indices, (0..n).map(|n| format!("cam{n:02}")).collect());
    };
    let mut names: Vec<String> = stated.iter().copied().cloned().collect();
    names.sort_by(|a, b| files::natural_cmp(a, b));
    names.dedup();
    let index = |name| names.binary_search_by(|other| files::natural_cmp(other, name));
    let indices = stated.iter().map(|name| index(name).unwrap_or_default());
    (indices.collect(), names)
}

/// For each entry the index of its pose among the distinct ones, and their number.
fn distinct_poses(entries: &[Entry]) -> (Vec<usize>, usize) {
    let mut distinct: Vec<&Camera> = Vec::new();
    let indices = entries
        .iter()
        .map(|entry| {
            let known = distinct
                .iter()
                .position(|camera| pose::same_pose(camera, &entry.camera));
            known.unwrap_or_else(|| {
                distinct.push(&entry.camera);
                distinct.len() - 1
            })
        })
        .collect();
    (indices, distinct.len())
}
