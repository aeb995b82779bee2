//! The layout of D-NeRF, Blender and nerfstudio: `transforms*.json` beside the images.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use super::blender_partition::{drop_held_out, hold_out};
use super::broken::{check_any, readable};
use super::decode::dimensions;
use super::distortion::Distortion;
use super::frames::Source;
use super::image_files::find_image;
use super::plan::{Context, Lens, PlannedView};
use super::points::{Models, find_named_points};
use super::sizes::Sizes;
use super::transforms::{Frame, Transforms, parse, parse_any};
use super::view::Partition;
use super::{DatasetError, Parts, files, pose, times, unposed};

const SINGLE: &str = "transforms.json";
const TRAIN: &str = "transforms_train.json";
const TEST: &str = "transforms_test.json";
const VAL: &str = "transforms_val.json";
/// Either of these makes a folder this layout's.
pub(super) const FILES: [&str; 2] = [TRAIN, SINGLE];

/// A frame of any of the files.
pub(super) struct Entry {
    pub(super) file: PathBuf,
    mask: Option<PathBuf>,
    pub(super) name: String,
    camera_name: Option<String>,
    time: Option<f64>,
    timestep_index: Option<f64>,
    camera: Camera,
    distortion: Distortion,
    pub(super) listed_in: PathBuf,
    pub(super) held_out: bool,
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
    let mut held_out = None;
    for file in [TEST, VAL].map(path) {
        if held_out.is_none() && first != path(SINGLE) && file.is_file() {
            let listed = parse_any(&file)?;
            held_out = Some((file, listed)).filter(|(_, listed)| !listed.frames.is_empty());
        }
    }
    match held_out {
        Some((file, listed)) => collect(context, &file, &listed, true, &mut sizes, &mut entries)?,
        None => hold_out(context.root, &first, &transforms, &mut entries),
    }
    check_any(&first, !entries.is_empty())?;
    drop_held_out(context, &first, &mut entries)?;
    number_times(&mut entries);
    check_times(&entries)?;
    sizes.warn(&first);
    let stated: Vec<f64> = entries.iter().map(|e| e.time.unwrap_or(0.0)).collect();
    let same_time = times::same_time(&stated, &cameras(&entries).0);
    let placed = times::frames_within(context.options, &stated, same_time)?;
    let (times, n_frames) = (placed.pictures, placed.n_frames);
    if let Some([start, end]) = placed.stated_span {
        tracing::info!(
            "{}: times from {start} to {end} are stretched over 0 to 1",
            first.display()
        );
    }
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
    let is_timed = entries.iter().any(|entry| entry.time.is_some());
    if let Some(doubt) = at_one_instant(&camera_of, &camera_names).filter(|_| !is_timed) {
        tracing::warn!("{}: {doubt}", first.display());
    }
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
            mask: entry.mask,
            name: entry.name,
            camera_name: camera_names[camera_index].clone(),
            camera_index,
            frame,
            time,
            partition: Partition::held_out(entry.held_out),
            camera: entry.camera,
        });
    }
    let named = (transforms.ply_file_path.as_deref(), first.as_path());
    let points = find_named_points(context.root, named, Models::Own)?;
    let views = context.load_views(planned)?;
    Ok(Parts {
        views,
        points,
        n_frames,
        n_cameras,
        stated_span: placed.stated_span,
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
    let mut lacking_masks = 0;
    for frame in &transforms.frames {
        let file = files::confined(context.root, &frame.file_path, listed_in)?;
        let mut found = find_image(file, listed_in);
        if context.options.skip_broken {
            found = found.and_then(|file| dimensions(&file).map(|_| file));
        }
        let name = format!("the frame {}", frame.file_path);
        let Some(file) = readable(context, &name, found)? else {
            continue;
        };
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
        let mask = named_mask(context.root, frame, listed_in);
        lacking_masks += usize::from(mask.is_none() && frame.mask_path().is_some());
        let inside = file.strip_prefix(context.root).unwrap_or(&file);
        entries.push(Entry {
            name: entry_name(inside),
            mask,
            file,
            camera_name: frame.camera_name().map(str::to_string),
            time: frame.time,
            timestep_index: frame.timestep_index(),
            camera,
            distortion,
            listed_in: listed_in.to_path_buf(),
            held_out,
        });
    }
    if lacking_masks > 0 {
        tracing::warn!(
            "{}: {lacking_masks} masks named by mask_path are not there; masks/NAME.png is looked for instead",
            listed_in.display()
        );
    }
    Ok(())
}

/// The mask that a frame names, where it is there.
fn named_mask(root: &Path, frame: &Frame, listed_in: &Path) -> Option<PathBuf> {
    let mask = files::confined(root, frame.mask_path()?, listed_in).ok()?;
    mask.is_file().then_some(mask)
}

/// A path below the dataset without its extension.
pub(super) fn entry_name(inside: &Path) -> String {
    let stem = inside.with_extension("");
    stem.to_string_lossy().replace('\\', "/")
}

/// Takes the numbers of the times where no frame has a time and each has a number.
fn number_times(entries: &mut [Entry]) {
    let is_numbered = |entry: &Entry| entry.time.is_none() && entry.timestep_index.is_some();
    if entries.iter().all(is_numbered) {
        for entry in entries {
            entry.time = entry.timestep_index;
        }
    }
}

/// What there is to say where no frame has a time, and a camera has several.
fn at_one_instant(camera_of: &[usize], names: &[String]) -> Option<String> {
    let count = |camera: usize| camera_of.iter().filter(|&&of| of == camera).count();
    let (n, name) = (0..names.len())
        .map(|camera| (count(camera), &names[camera]))
        .find(|(n, _)| *n > 1)?;
    Some(format!(
        "no frame has a `time`, and {name} has {n} pictures: all are taken as one instant"
    ))
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
/// order, where every entry has one, and each is of one pose; else numbers of the distinct poses.
fn cameras(entries: &[Entry]) -> (Vec<usize>, Vec<String>) {
    let stated: Option<Vec<&String>> = entries.iter().map(|e| e.camera_name.as_ref()).collect();
    let Some(stated) = stated.filter(|names| stand_still(names, entries)) else {
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

/// Whether entries of one name have one pose: else it is that of a camera that is carried.
fn stand_still(names: &[&String], entries: &[Entry]) -> bool {
    let extent = pose::extent(entries.iter().map(|entry| &entry.camera));
    let mut poses: HashMap<&str, &Camera> = HashMap::new();
    names.iter().zip(entries).all(|(name, entry)| {
        let first = poses.entry(name.as_str()).or_insert(&entry.camera);
        pose::same_pose(first, &entry.camera, extent)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_pictures_of_a_camera_without_times_are_told() {
        let names = ["left".to_string(), "right".to_string()];
        assert_eq!(at_one_instant(&[0, 1], &names), None);
        let said = at_one_instant(&[0, 1, 1], &names).expect("two of one camera");
        assert!(said.contains("right has 2 pictures"), "{said}");
    }
}
