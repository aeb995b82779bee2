//! The layout of D-NeRF, Blender and nerfstudio: `transforms*.json` beside the images.

mod entries;
mod partition;

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use crate::Error;
use crate::dataset::broken::check_any;
use crate::dataset::format::{Capture, Folder, Format, Reader};
use crate::dataset::layout::Layout;
use crate::dataset::loader::{Loader, PlannedView};
use crate::dataset::partition::Partition;
use crate::dataset::pixels::dimensions;
use crate::dataset::pixels::frames::Source;
use crate::dataset::pixels::lens::Lens;
use crate::dataset::pixels::sizes::Sizes;
use crate::dataset::points::points_of_transforms;
use crate::dataset::poses::transforms::{Transforms, parse, parse_any};
use crate::dataset::times::{self, Placement};
use crate::dataset::unposed;
use crate::files::{self, find_image};
use entries::{
    Entry, at_one_instant, cameras, check_times, collect, number_times, other_times, repeats,
};
use partition::{drop_held_out, hold_out};

const SINGLE: &str = "transforms.json";
const TRAIN: &str = "transforms_train.json";
const TEST: &str = "transforms_test.json";
const VAL: &str = "transforms_val.json";
/// Either of these makes a folder this layout's.
const FILES: [&str; 2] = [TRAIN, SINGLE];
/// The image size where neither the poses nor an image state it.
const UNKNOWN_SIZE: (usize, usize) = (800, 800);

/// D-NeRF, Blender and nerfstudio.
pub(super) struct Blender;

struct BlenderReader {
    /// The file with the views to train on, or with all views.
    first: PathBuf,
}

impl Format for Blender {
    fn layout(&self) -> Layout {
        Layout::Blender
    }

    fn recognise(&self, folder: &Folder) -> Result<Option<Box<dyn Reader>>, Error> {
        let is_any = FILES.iter().any(|name| folder.has(name));
        is_any.then(|| self.open(folder)).transpose()
    }

    fn open(&self, folder: &Folder) -> Result<Box<dyn Reader>, Error> {
        let [train, single] = FILES.map(|name| folder.root().join(name));
        let first = if train.is_file() { train } else { single };
        Ok(Box::new(BlenderReader { first }))
    }

    fn poses(&self, folder: &Folder) -> Result<Option<Vec<Camera>>, Error> {
        let root = folder.root();
        let files = FILES.map(|name| root.join(name));
        let Some(path) = files.iter().find(|path| path.is_file()) else {
            return Ok(Some(Vec::new()));
        };
        let listed = parse(path)?;
        let mut cameras = Vec::new();
        for frame in &listed.frames {
            let file = files::confined(root, &frame.file_path, path)?;
            let size = || {
                let found = find_image(file, path).and_then(|file| dimensions(&file));
                let by_middle = || listed.size_by_middle(frame).unwrap_or(UNKNOWN_SIZE);
                Ok(found.unwrap_or_else(|_| by_middle()))
            };
            cameras.push(listed.camera(path, frame, size)?.0);
        }
        Ok(Some(cameras))
    }
}

impl Reader for BlenderReader {
    fn read(self: Box<Self>, loader: &Loader) -> Result<Capture, Error> {
        let first = self.first.as_path();
        let transforms = parse(first)?;
        let mut entries = list(loader, first, &transforms)?;
        let placed = place(loader, first, &transforms, &entries)?;
        let mut time_of = placed.pictures.iter();
        entries.retain(|_| time_of.next().is_some_and(Option::is_some));
        let frame_rate = frame_rate(&entries, placed.n_frames);
        let (camera_of, camera_names) = cameras(&entries);
        let n_cameras = camera_names.len();
        let is_timed = entries.iter().any(|entry| entry.time.is_some());
        if let Some(doubt) = at_one_instant(&camera_of, &camera_names).filter(|_| !is_timed) {
            tracing::warn!("{}: {doubt}", first.display());
        }
        if let Some(key) = transforms.key_like_time().filter(|_| !is_timed) {
            tracing::warn!(
                "{}: no frame has a `time`, and `{key}` differs from frame to frame: all are taken as one instant; if it is \
                 the time, call it `time`",
                first.display()
            );
        }
        if loader.options.test_cameras.is_some() {
            let held_out = loader.options.held_out(vec![false; n_cameras])?;
            for (entry, &camera) in entries.iter_mut().zip(&camera_of) {
                entry.held_out = held_out[camera];
            }
        }
        let mut planned = Vec::with_capacity(entries.len());
        for ((entry, &camera_index), (frame, time)) in entries
            .into_iter()
            .zip(&camera_of)
            .zip(placed.pictures.into_iter().flatten())
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
        let points = points_of_transforms(loader.root, first, &transforms)?;
        let views = loader.load_views(planned)?;
        Ok(Capture {
            views,
            points,
            n_frames: placed.n_frames,
            n_cameras,
            stated_span: placed.stated_span,
            frame_rate,
        })
    }
}

/// The frames of the first file, and of the file of views to hold out where there is one.
fn list(loader: &Loader, first: &Path, transforms: &Transforms) -> Result<Vec<Entry>, Error> {
    let mut entries = Vec::new();
    let mut sizes = Sizes::default();
    collect(loader, first, transforms, false, &mut sizes, &mut entries)?;
    // Validation views serve only where there are no test views.
    let mut held_out = None;
    for file in [TEST, VAL].map(|name| loader.root.join(name)) {
        if held_out.is_none() && !is_single(loader, first) && file.is_file() {
            let listed = parse_any(&file)?;
            held_out = Some((file, listed)).filter(|(_, listed)| !listed.frames.is_empty());
        }
    }
    match held_out {
        Some((file, listed)) => collect(loader, &file, &listed, true, &mut sizes, &mut entries)?,
        None => hold_out(loader.root, first, transforms, &mut entries),
    }
    check_any(first, !entries.is_empty())?;
    drop_held_out(loader, first, &mut entries)?;
    number_times(&mut entries);
    check_times(&entries)?;
    for doubt in [repeats(&entries), other_times(&entries)]
        .into_iter()
        .flatten()
    {
        tracing::warn!("{}: {doubt}", first.display());
    }
    sizes.warn(first);
    Ok(entries)
}

/// Where the entries are in time; warns of images without a pose.
fn place(
    loader: &Loader,
    first: &Path,
    transforms: &Transforms,
    entries: &[Entry],
) -> Result<Placement, Error> {
    let stated: Vec<f64> = entries.iter().map(|e| e.time.unwrap_or(0.0)).collect();
    let same_time = times::same_time(&stated, &cameras(entries).0);
    let placed = times::frames_within(loader.options, &stated, same_time)?;
    if let Some([start, end]) = placed.stated_span {
        tracing::info!(
            "{}: times from {start} to {end} are stretched over 0 to 1",
            first.display()
        );
    }
    if is_single(loader, first) {
        let listed = transforms.frames.iter();
        let posed: HashSet<PathBuf> = listed
            .filter_map(|frame| files::confined(loader.root, &frame.file_path, first).ok())
            .filter_map(|file| find_image(file, first).ok())
            .collect();
        unposed::warn_of_more(loader, first, &posed, placed.n_frames == 1);
    }
    Ok(placed)
}

/// Frames per second, where the file states seconds.
fn frame_rate(entries: &[Entry], n_frames: usize) -> Option<f64> {
    let seconds = entries.iter().map(|entry| entry.seconds);
    let seconds = seconds.collect::<Option<Vec<f64>>>()?;
    let first = seconds.iter().copied().reduce(f64::min)?;
    let last = seconds.into_iter().reduce(f64::max)?;
    (last > first && n_frames > 1).then(|| (n_frames - 1) as f64 / (last - first))
}

/// Whether one file lists all views.
fn is_single(loader: &Loader, first: &Path) -> bool {
    first == loader.root.join(SINGLE)
}
