//! Datasets: folders of images or videos with camera poses, read into memory.
//!
//! [`load`] recognises the layout by its files; each layout has a file of its own, which turns the
//! folder's listing and poses into views. Cameras are converted to OpenCV axes, lens distortion is
//! undone, times become [0, 1], and images are kept as 8-bit pixels at the loaded size.
//!
//! | file | what |
//! | --- | --- |
//! | [`Layout::N3dv`]: `n3dv.rs`, `plain_order.rs`, `npy.rs`, `video.rs` | `poses_bounds.npy`, `camNN/` or `cam*.mp4` |
//! | [`Layout::Blender`]: `blender.rs`, `blender_partition.rs`, `transforms.rs` | `transforms*.json` |
//! | [`Layout::Colmap`]: `colmap.rs`, `colmap_model.rs`, `colmap_binary.rs`, `colmap_text.rs` | `sparse/0`, `images/` |
//! | [`Layout::Technicolor`]: `technicolor.rs`, `technicolor_parameters.rs` | `cameras_parameters.txt`, or `images/camNN/` and COLMAP |
//! | [`Layout::Nerfies`]: `nerfies.rs`, `nerfies_camera.rs` | `dataset.json`, `camera/`, `rgb/` |
//! | [`Layout::Rig`]: `rig.rs` | `videos/` or `images/CAMERA/`, and poses by camera |
//! | `sources.rs`, `recordings.rs`, `times.rs`, `points.rs`, `broken.rs`, `unposed.rs` | frames and videos of synchronised cameras, times, initial points, what is damaged, what has no pose |
//! | `known_poses.rs`, `colmap_tracks.rs`, `shrink.rs` | what `prepare` makes a dataset from |
//! | `layout.rs`, `options.rs`, `frame_range.rs`, `plan.rs` | which reader, what of it, and from its list to views |
//! | `sizes.rs`, `view.rs`, `image.rs`, `decode.rs`, `distortion.rs`, `pose.rs`, `files.rs`, `error.rs` | what they share |
//! | `frames.rs`, `frames/`, `video.rs` | images in memory or made on demand |
//! | `image_files.rs`, `masks.rs`, `first_bytes.rs`, `origin.rs` | which files are meant, and what is odd about them or their world |
//! | `poses.rs` | the cameras of a folder whose pictures can't be loaded |
//! | `image_size.rs`, `fuzzing.rs` | what a header may claim; the parsers by name, for tests |

mod blender;
mod blender_partition;
mod broken;
mod colmap;
mod colmap_binary;
mod colmap_model;
mod colmap_text;
mod colmap_tracks;
mod decode;
pub(crate) mod distortion;
mod error;
pub(crate) mod files;
pub(crate) mod first_bytes;
mod frame_range;
mod frames;
pub(crate) mod fuzzing;
mod image;
pub(crate) mod image_files;
mod image_size;
pub(crate) mod known_poses;
mod layout;
pub(crate) mod masks;
mod n3dv;
mod nerfies;
mod nerfies_camera;
mod npy;
mod options;
mod origin;
mod plain_order;
mod plan;
mod points;
mod pose;
mod poses;
mod recordings;
mod rig;
pub(crate) mod shrink;
mod sizes;
mod sources;
mod technicolor;
mod technicolor_parameters;
#[cfg(test)]
mod tests;
mod times;
pub(crate) mod transforms;
mod unposed;
mod video;
mod view;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

pub(crate) use colmap_tracks::{TrackedPoint, read_tracked_points};
pub use error::DatasetError;
pub(crate) use files::frame_numbers;
pub use frame_range::FrameRange;
pub use frames::FrameStatistics;
pub(crate) use frames::{bytes_in_words, default_budget};
pub use layout::Layout;
pub use options::LoadOptions;
pub(crate) use origin::FarScene;
pub(crate) use points::known_point_file;
pub(crate) use poses::poses_alone;
pub use view::{Partition, View};

use crate::ply::PointCloud;
use frames::{FrameStore, Pixels};
use plan::Context;

/// Where nothing says which views are held out, one view of this many is held out (3DGS convention).
const HOLD_OUT_EVERY: usize = 8;
const WHITE: [f32; 3] = [1.0; 3];

/// A capture: its views with images in memory, and points to start from.
#[derive(Debug, Clone)]
pub struct Dataset {
    /// The folder's name.
    pub name: String,
    /// The folder.
    pub root: PathBuf,
    /// How the folder is organised.
    pub layout: Layout,
    /// Every view, of training and test cameras.
    pub views: Vec<View>,
    /// Initial points, where the folder has some.
    pub points: Option<PointCloud>,
    /// Number of distinct times; 1 for a static capture.
    pub n_frames: usize,
    /// Number of distinct cameras (for a moving camera, of poses).
    pub n_cameras: usize,
    /// The first and the last time as `transforms*.json` state them, where these were stretched over [0, 1]; `None`
    /// where times are as stated, and where frames are only numbered or counted.
    pub stated_span: Option<[f64; 2]>,
    /// The colour behind transparent pixels: white when images have alpha, `None` otherwise.
    pub background: Option<[f32; 3]>,
}

impl Dataset {
    /// The views of one split, in order.
    pub fn split(&self, partition: Partition) -> impl Iterator<Item = &View> {
        self.views
            .iter()
            .filter(move |view| view.partition == split)
    }

    /// Whether nothing moves, because there is only one time.
    pub fn is_static(&self) -> bool {
        self.n_frames == 1
    }

    /// Says in which order views of this dataset will be asked for next, so that images that are made on
    /// demand can be made ahead of that.
    pub fn announce<'a>(&self, order: impl Iterator<Item = &'a View>) {
        if let Some(store) = self.frame_store() {
            store.announce(order.filter_map(|view| view.pixels.place()).collect());
        }
    }

    /// How images on demand have kept up; `None` where all are in memory.
    pub fn frame_statistics(&self) -> Option<FrameStatistics> {
        Some(self.frame_store()?.statistics())
    }

    fn frame_store(&self) -> Option<&FrameStore> {
        self.views.iter().find_map(|view| match &view.pixels {
            Pixels::Ready(_) => None,
            Pixels::Stored { store, .. } => Some(store.as_ref()),
        })
    }

    /// Memory that the images take together.
    pub fn image_bytes(&self) -> u64 {
        self.views.iter().map(View::image_bytes).sum()
    }
}

/// What a layout's reader hands back.
struct Parts {
    views: Vec<View>,
    points: Option<PointCloud>,
    n_frames: usize,
    n_cameras: usize,
    /// As [`Dataset::stated_span`].
    stated_span: Option<[f64; 2]>,
}

/// Reads the dataset in the folder `path`.
///
/// # Errors
/// Names the file at fault: missing, damaged or inconsistent poses, images, videos or points, or
/// an option that does not fit.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Dataset, DatasetError> {
    load_in(&Context::new(path, options))
}

/// [`load`], but with views left out whose images can't be decoded; and for each of them why.
pub(crate) fn load_decodable(
    path: &Path,
    options: &LoadOptions,
) -> Result<(Dataset, Vec<DatasetError>), DatasetError> {
    let options = LoadOptions {
        skip_broken: true,
        ..options.clone()
    };
    let mut context = Context::new(path, &options);
    context.broken = Some(Mutex::default());
    let loaded = load_in(&context);
    let broken = context.broken.take().unwrap_or_default();
    let mut broken = broken.into_inner().unwrap_or_else(PoisonError::into_inner);
    // Threads decode in any order.
    broken.sort_by_key(ToString::to_string);
    match loaded {
        Ok(dataset) => Ok((dataset, broken)),
        // Without any view to train on, why there is none says more.
        Err(error) => Err(broken.into_iter().next().unwrap_or(error)),
    }
}

fn load_in(context: &Context) -> Result<Dataset, DatasetError> {
    let (path, options) = (context.root, context.options);
    options.validate()?;
    files::require_folder(path)?;
    let layout = match options.layout {
        Some(layout) => layout,
        None => Layout::detect(path)?,
    };
    let read = || match layout {
        Layout::N3dv => n3dv::read(context),
        Layout::Blender => blender::read(context),
        Layout::Colmap => colmap::read(context),
        Layout::Technicolor => technicolor::read(context),
        Layout::Nerfies => nerfies::read(context),
        Layout::Rig => rig::read(context),
    };
    let parts = match options.threads {
        None => read()?,
        Some(threads) => rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| DatasetError::Option {
                option: "--threads",
                expected: "as many threads as the system can start".into(),
                found: format!("{threads} ({e})"),
            })?
            .install(read)?,
    };
    let background = parts.views.iter().any(View::has_alpha).then_some(WHITE);
    if !parts
        .views
        .iter()
        .any(|view| view.partition == Partition::Train)
    {
        return Err(DatasetError::invalid(
            path,
            "at least one camera to train on",
            format!(
                "{} camera(s), all of them held out for testing",
                parts.n_cameras
            ),
            "add cameras, or hold out others (or none) with --test-cameras",
        ));
    }
    // Those who note what is broken look at this, too.
    if context.broken.is_none()
        && let Some(far) = FarScene::of(&parts.views, parts.points.as_ref())
    {
        tracing::warn!("{}: {}; {}", path.display(), far.text(), far.mend());
    }
    let name = path.canonicalize().map_err(DatasetError::io(path))?;
    Ok(Dataset {
        name: name
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned(),
        root: path.to_path_buf(),
        layout,
        views: parts.views,
        points: parts.points,
        n_frames: parts.n_frames,
        n_cameras: parts.n_cameras,
        stated_span: parts.stated_span,
        background,
    })
}

/// A time in [0, 1] for each of `n` evenly spaced frames; 0 for a single one.
fn frame_time(frame: usize, n: usize) -> f32 {
    if n > 1 {
        (frame as f64 / (n - 1) as f64) as f32
    } else {
        0.0
    }
}

/// Every [`HOLD_OUT_EVERY`]-th of `n` views, unless there is only one.
fn every_eighth(n: usize) -> Vec<bool> {
    (0..n)
        .map(|index| n > 1 && index.is_multiple_of(HOLD_OUT_EVERY))
        .collect()
}
