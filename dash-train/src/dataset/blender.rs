//! The layout of D-NeRF, Blender and nerfstudio: `transforms*.json` beside the images.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use super::broken::check_any;
use super::decode::dimensions;
use super::distortion::Distortion;
use super::frames::Source;
use super::plan::{Context, Lens, PlannedView};
use super::points::{Models, find_points};
use super::sizes::Sizes;
use super::transforms::{Transforms, find_image, parse};
use super::view::Split;
use super::{DatasetError, Parts, every_eighth, files, pose, times, unposed};

const SINGLE: &str = "transforms.json";
const TRAIN: &str = "transforms_train.json";
const TEST: &str = "transforms_test.json";
const VAL: &str = "transforms_val.json";
/// Either of these makes a folder this layout's.
pub(super) const FILES: [&str; 2] = [TRAIN, SINGLE];

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
    let mut sizes = Sizes::default();
    collect(
        context,
        &first,
        &transforms,
        false,
        &mut sizes,
        &mut entries,
    )?;
    // Validation views serve only where there are no test views.
    let held_out = [TEST, VAL]
        .map(path)
        .into_iter()
        .find(|p| first != path(SINGLE) && p.is_file());
    match held_out {
        Some(file) => collect(
            context,
            &file,
            &parse(&file)?,
            true,
            &mut sizes,
            &mut entries,
        )?,
        None if !hold_out_listed(&transforms, &mut entries) => hold_out_every_eighth(&mut entries),
        None => {}
    }
    check_any(&first, !entries.is_empty())?;
    check_times(&entries)?;
    sizes.warn(&first);
    let stated: Vec<f64> = entries.iter().map(|e| e.time.unwrap_or(0.0)).collect();
    let same_time = times::same_time(&stated, &cameras(&entries).0);
    let (times, n_frames) = times::frames_within(context.options, &stated, same_time)?;
    if first == path(SINGLE) {
        let listed = transforms.frames.iter();
        let posed = listed
            .filter_map(|frame| files::confined(context.root, &frame.file_path, &first).ok())
            .filter_map(|file| find_image(file, &first).ok())
            .collect();
        unposed::warn_of_more(context, &first, &posed, n_frames == 1);
    }
    let mut time_of = times.iter();
    entries.retain(|_| time_of.next().is_some_and(Option::is_some));
    let (camera_of, camera_names) = cameras(&entries);
    let n_cameras = camera_names.len();
    if context.options.test_cameras.is_some() {
        let held_out = context.options.held_out(vec![false; n_cameras])?;
        for (entry, &camera) in entries.iter_mut().zip(&camera_of) {
            entry.held_out = held_out[camera];
        }
    }
    let mut planned = Vec::with_capacity(entries.len());
    for ((entry, &camera_index), (frame, time)) in entries
        .into_iter()
        .zip(&camera_of)
        .zip(times.into_iter().flatten())
    {
        planned.push(PlannedView {
            lens: Lens::new(entry.distortion, &entry.camera, &entry.listed_in)?,
            source: Source::File(entry.file),
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
    let points = find_points(context.root, named.as_deref(), Models::Own)?;
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
    sizes: &mut Sizes,
    entries: &mut Vec<Entry>,
) -> Result<(), DatasetError> {
    for frame in &transforms.frames {
        let file = files::confined(context.root, &frame.file_path, listed_in)?;
        let file = find_image(file, listed_in)?;
        if context.options.skip_broken
            && let Err(error) = dimensions(&file)
        {
            tracing::warn!("left out the frame {}: {error}", frame.file_path);
            continue;
        }
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
        let camera = sizes.fit(camera, &file);
        let inside = file.strip_prefix(context.root).unwrap_or(&file);
        entries.push(Entry {
            name: entry_name(inside),
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

/// Holds out the frames that nerfstudio's lists name; `false` when they name none of them.
fn hold_out_listed(transforms: &Transforms, entries: &mut [Entry]) -> bool {
    let mut held_out = false;
    for list in [&transforms.test_filenames, &transforms.val_filenames] {
        if held_out {
            break;
        }
        let names: HashSet<String> = list
            .iter()
            .filter_map(|name| files::confine(name))
            .map(|path| entry_name(&path))
            .collect();
        for entry in entries.iter_mut() {
            entry.held_out = names.contains(&entry.name);
            held_out |= entry.held_out;
        }
    }
    held_out
}

/// A path below the dataset without its extension.
fn entry_name(inside: &Path) -> String {
    let stem = inside.with_extension("");
    stem.to_string_lossy().replace('\\', "/")
}

/// Without a file or list of test views every eighth in the order of names is held out.
fn hold_out_every_eighth(entries: &mut [Entry]) {
    let mut order: Vec<usize> = (0..entries.len()).collect();
    order.sort_by(|&a, &b| files::natural_cmp(&entries[a].name, &entries[b].name));
    for (index, held_out) in order.into_iter().zip(every_eighth(entries.len())) {
        entries[index].held_out = held_out;
    }
}

/// Either every frame has a time or none has.
fn check_times(entries: &[Entry]) -> Result<(), DatasetError> {
    let with_time = entries.iter().any(|entry| entry.time.is_some());
    match entries.iter().find(|entry| entry.time.is_none()) {
        Some(entry) if with_time => Err(DatasetError::invalid(
            &entry.listed_in,
            "`time` in every frame or in none",
            format!("none in frame `{}`", entry.name),
            "add the missing times",
        )),
        _ => Ok(()),
    }
}

/// For each entry the index of its camera, and the cameras' names: those that the file states, in their
/// order, where every entry has one; else numbers of the distinct poses.
fn cameras(entries: &[Entry]) -> (Vec<usize>, Vec<String>) {
    let stated: Option<Vec<&String>> = entries.iter().map(|e| e.camera_name.as_ref()).collect();
    let Some(stated) = stated else {
        let (indices, n) = pose::distinct_poses(entries.iter().map(|e| &e.camera));
        return (indices, (0..n).map(|n| format!("cam{n:02}")).collect());
    };
    let mut names: Vec<String> = stated.iter().copied().cloned().collect();
    names.sort_by(|a, b| files::natural_cmp(a, b));
    names.dedup();
    let index = |name| names.binary_search_by(|other| files::natural_cmp(other, name));
    let indices = stated.iter().map(|name| index(name).unwrap_or_default());
    (indices.collect(), names)
}
