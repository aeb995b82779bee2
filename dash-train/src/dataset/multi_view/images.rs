//! Folders of images of a synchronised rig: which image is which camera's at which time.

use std::collections::BTreeMap;

use super::Plan;
use super::camera::{FrameFile, RigCamera, same_count};
use crate::Error;
use crate::dataset::loader::{Loader, PlannedView};
use crate::dataset::partition::Partition;
use crate::dataset::pixels::frames::Source;
use crate::dataset::pixels::sizes::Sizes;
use crate::dataset::times::{self, frame_time};
use crate::files;

/// A camera's images by frame; `None` where it lacks one.
type Row<'a> = Vec<Option<&'a FrameFile>>;

/// The views of all cameras at all wanted frames. `lists` has the images of each camera.
///
/// # Errors
/// When cameras differ in their frames, a frame in its shape from the poses, or one is damaged.
pub(super) fn plan(
    loader: &Loader,
    cameras: &[RigCamera],
    lists: &[&[FrameFile]],
    held_out: &[bool],
) -> Result<Plan, Error> {
    check_order(cameras, lists)?;
    let rows = match check_frames(cameras, lists) {
        Ok(()) => lists.iter().map(|l| l.iter().map(Some).collect()).collect(),
        Err(error) if !loader.options.skip_broken => return Err(error),
        Err(error) => {
            let Some(rows) = by_numbers(lists) else {
                return Err(error);
            };
            warn_of_missing(cameras, &rows);
            loader.broken.note(error);
            rows
        }
    };
    let frames = || {
        let n_frames = rows.first().map_or(0, Vec::len);
        (0..n_frames).map(|place| rows.iter().find_map(|row| row[place]))
    };
    let numbers: Vec<Option<u64>> = frames().map(|frame| frame?.number()).collect();
    let or_places = (0..).zip(&numbers).map(|(place, n)| n.unwrap_or(place));
    let wanted = loader.options.wanted(&or_places.collect::<Vec<u64>>())?;
    let stated: Option<Vec<u64>> = wanted.iter().map(|&place| numbers[place]).collect();
    let times = stated.and_then(|numbers| times::of_numbers(&numbers));
    let n_frames = wanted.len();
    let times = times.unwrap_or_else(|| (0..n_frames).map(|k| frame_time(k, n_frames)).collect());
    let wanted: Vec<(usize, f32)> = wanted.into_iter().zip(times).collect();
    Ok(Plan {
        views: views(loader, cameras, &rows, &wanted, held_out)?,
        n_frames,
        frame_rate: None,
    })
}

/// Refuses names whose order in time is not known, and tells the order of the first camera's where it may be another.
fn check_order(cameras: &[RigCamera], lists: &[&[FrameFile]]) -> Result<(), Error> {
    let mut is_told = false;
    for (camera, list) in cameras.iter().zip(lists) {
        let path = &camera.source.path;
        let labels: Vec<&str> = list.iter().map(|frame| frame.label.as_str()).collect();
        if let Some(told) = files::check_order(path, &labels)? {
            if !is_told {
                tracing::warn!("{}: {told}", path.display());
            }
            is_told = true;
        }
    }
    Ok(())
}

/// The frames of any camera by their numbers; `None` if images have no numbers, or most numbers of a camera occur in
/// no other.
fn by_numbers<'a>(lists: &[&'a [FrameFile]]) -> Option<Vec<Row<'a>>> {
    let mut cameras: Vec<BTreeMap<u64, &FrameFile>> = Vec::with_capacity(lists.len());
    let mut n_of: BTreeMap<u64, usize> = BTreeMap::new();
    for list in lists {
        let mut own = BTreeMap::new();
        for frame in *list {
            let number = frame.number()?;
            if own.insert(number, frame).is_some() {
                return None;
            }
            *n_of.entry(number).or_default() += 1;
        }
        cameras.push(own);
    }
    let is_shared = |number: &&u64| n_of[*number] > 1;
    let fits = |own: &BTreeMap<u64, _>| 2 * own.keys().filter(is_shared).count() >= own.len();
    cameras.iter().all(fits).then(|| {
        let row = |own: &BTreeMap<u64, &'a FrameFile>| -> Row<'a> {
            n_of.keys().map(|number| own.get(number).copied()).collect()
        };
        cameras.iter().map(row).collect()
    })
}

fn warn_of_missing(cameras: &[RigCamera], rows: &[Row]) {
    for (camera, row) in cameras.iter().zip(rows) {
        let n_missing = row.iter().filter(|frame| frame.is_none()).count();
        if n_missing > 0 {
            tracing::warn!(
                "{}: {n_missing} of {} frames are missing",
                camera.source.path.display(),
                row.len()
            );
        }
    }
}

/// Every camera must have the same frames, or times would be mixed up between cameras.
fn check_frames(cameras: &[RigCamera], lists: &[&[FrameFile]]) -> Result<(), Error> {
    let Some((first, expected)) = cameras.first().zip(lists.first()) else {
        return Ok(());
    };
    for (camera, list) in cameras.iter().zip(lists) {
        let source = &camera.source;
        let repeated =
            |pair: &[FrameFile]| pair[0].digits.is_some() && pair[0].digits == pair[1].digits;
        if let Some(pair) = list.windows(2).find(|pair| repeated(pair)) {
            return Err(Error::invalid(
                &source.path,
                "one image per frame",
                format!(
                    "{} twice (as {} too)",
                    pair[0].file.display(),
                    pair[1].described()
                ),
                "remove the duplicate, or number the files so that each frame has digits of its own",
            ));
        }
        same_count(&first.source, expected.len(), source, list.len())?;
        // Of a single frame the number tells nothing; it may be the camera's.
        let is_numbered = expected.len() > 1;
        let differs = |(a, b): &(&FrameFile, &FrameFile)| is_numbered && a.digits != b.digits;
        if let Some((wanted, found)) = expected.iter().zip(*list).find(differs) {
            return Err(Error::invalid(
                &source.path,
                format!(
                    "the frames of {}, the next being {}",
                    first.source.name,
                    wanted.described()
                ),
                found.described(),
                "give every camera the same frame numbers, or leave out what one lacks (--skip-broken)",
            ));
        }
    }
    Ok(())
}

/// The views of all cameras at the wanted frames, each a place in the rows and a time.
fn views(
    loader: &Loader,
    cameras: &[RigCamera],
    rows: &[Row],
    wanted: &[(usize, f32)],
    held_out: &[bool],
) -> Result<Vec<PlannedView>, Error> {
    let mut planned = Vec::new();
    let mut sizes = Sizes::default();
    for (camera_index, (rig_camera, row)) in cameras.iter().zip(rows).enumerate() {
        let files = wanted.iter().filter_map(|&(place, _)| row[place]);
        let mut files = files.map(|frame| frame.file.as_path()).peekable();
        let Some(&first) = files.peek() else {
            continue;
        };
        let Some(size) = loader.broken.first_size(files) else {
            continue;
        };
        let (camera, lens) = rig_camera.at_size(size?, first, &mut sizes)?;
        let camera_name = &rig_camera.source.name;
        for (frame, &(place, time)) in wanted.iter().enumerate() {
            let Some(image) = row[place] else { continue };
            planned.push(PlannedView {
                source: Source::File(image.file.clone()),
                name: format!("{camera_name}/{}", image.label),
                camera_name: camera_name.clone(),
                camera_index,
                frame,
                time,
                partition: Partition::held_out(held_out[camera_index]),
                camera: camera.clone(),
                lens: lens.clone(),
                mask: None,
            });
        }
    }
    sizes.warn_of_stretched();
    Ok(planned)
}
