//! Datasets: folders of images or videos with camera poses, read into memory.
//!
//! [`load`] asks each of the [`FORMATS`] whether it recognises a folder; the one that does hands back a
//! [`Reader`] of it. Cameras are converted to OpenCV axes, lens distortion is undone, times become [0, 1],
//! and images are kept as 8-bit pixels at the loaded size. Arrows between the rooms point downwards:
//!
//! | room | what |
//! | --- | --- |
//! | `formats/` | a file per layout: does it fit, and read |
//! | `format.rs`, `loader.rs`, `broken.rs` | what a format offers and what it is given; what can't be read |
//! | `multi_view/` | synchronised cameras: which of their frames show the same time |
//! | `points.rs`, `unposed.rs`, `times.rs`, `origin.rs`, `lenses.rs` | initial points, images without a pose, times, scenes far from the origin, odd intrinsics |
//! | `poses/` | files of poses |
//! | `view.rs`, `partition.rs`, `options.rs`, `frame_range.rs`, `layout.rs` | views, and what of a dataset is loaded |
//! | `pixels/` | decoding, sizes, masks, distortion, the frame store |
//! | `fuzzing.rs` | the parsers by name, for tests |

mod broken;
mod format;
mod formats;
mod frame_range;
pub(crate) mod fuzzing;
mod layout;
mod lenses;
mod loader;
mod multi_view;
mod options;
mod origin;
mod partition;
pub(crate) mod pixels;
mod points;
pub(crate) mod poses;
#[cfg(test)]
mod tests;
mod times;
mod unposed;
mod view;

use std::path::{Path, PathBuf};

pub use format::{Capture, Folder, Format, Reader};
pub use formats::FORMATS;
pub(crate) use formats::poses_alone;
pub use frame_range::FrameRange;
pub use layout::Layout;
pub(crate) use lenses::OddLens;
pub use loader::{Loader, PlannedView};
pub use options::LoadOptions;
pub(crate) use origin::FarScene;
pub use partition::Partition;
pub use pixels::frames::FrameStatistics;
pub(crate) use pixels::frames::{bytes_in_words, default_budget};
pub(crate) use points::known_point_file;
pub use view::View;

use crate::Error;
use crate::files;
use crate::numbers::median;
use crate::ply::PointCloud;
use broken::Broken;
use pixels::frames::{FrameStore, Pixels};

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
    /// The first and the last time of `transforms*.json` before they were stretched over [0, 1]; `None` where
    /// times are as stated, or frames are only numbered.
    pub stated_span: Option<[f64; 2]>,
    /// Frames per second of the loaded times, where the capture's videos or files of poses tell.
    pub frame_rate: Option<f64>,
    /// The colour behind transparent pixels: white when images have alpha, `None` otherwise.
    pub background: Option<[f32; 3]>,
}

impl Dataset {
    /// The views to train on, or those to test on, in order.
    pub fn views_of(&self, partition: Partition) -> impl Iterator<Item = &View> {
        self.views
            .iter()
            .filter(move |view| view.partition == partition)
    }

    /// Pixels of a picture; the median, where sizes differ.
    pub fn pixels(&self) -> usize {
        let pixels = |view: &View| (view.camera.width * view.camera.height) as f64;
        median(self.views.iter().map(pixels)).unwrap_or(0.0) as usize
    }

    /// Frames per second at which `n_frames` times, evenly over the clip, last as long as the recording.
    pub fn frame_rate_of(&self, n_frames: usize) -> Option<f64> {
        let spans = self.n_frames.checked_sub(1).filter(|spans| *spans > 0)?;
        let share = n_frames.checked_sub(1).filter(|share| *share > 0)? as f64 / spans as f64;
        Some(self.frame_rate? * share)
    }

    /// Whether the capture is static: it has one time only.
    pub fn is_static(&self) -> bool {
        self.n_frames == 1
    }

    /// Announces the order in which views will be asked for, so that images on demand are decoded ahead.
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

/// Reads the dataset in the folder `path`.
///
/// # Errors
/// Names the file at fault: missing, damaged or inconsistent poses, images, videos or points, or
/// an option that does not fit.
///
/// ```
/// use dash_train::dataset::{LoadOptions, Partition, load};
/// use dash_train::synth::{SynthConfig, write};
///
/// let folder = tempfile::tempdir()?;
/// let clip = folder.path().join("clip");
/// let config = SynthConfig { cameras: 3, frames: 2, width: 32, height: 24, ..Default::default() };
/// write(&clip, &config)?;
///
/// let dataset = load(&clip, &LoadOptions::default())?;
/// assert_eq!(dataset.views.len(), 6);
/// // Camera 0 is held out.
/// assert_eq!(dataset.views_of(Partition::Test).count(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn load(path: &Path, options: &LoadOptions) -> Result<Dataset, Error> {
    load_with(path, options, &FORMATS)
}

/// [`load`] with formats of one's own: the first that recognises the folder reads it.
///
/// # Errors
/// As [`load`].
pub fn load_with(
    path: &Path,
    options: &LoadOptions,
    formats: &[&dyn Format],
) -> Result<Dataset, Error> {
    load_in(&Loader::new(path, options), formats)
}

/// [`load`] without the views whose images can't be decoded, and the reason for each of these.
pub(crate) fn load_decodable(
    path: &Path,
    options: &LoadOptions,
) -> Result<(Dataset, Vec<Error>), Error> {
    let options = LoadOptions {
        skip_broken: true,
        ..options.clone()
    };
    let mut loader = Loader::new(path, &options);
    loader.broken = Broken::note_all();
    let loaded = load_in(&loader, &FORMATS);
    let broken = loader.broken.into_noted();
    match loaded {
        Ok(dataset) => Ok((dataset, broken)),
        // With no view left to train on, the first broken image says more.
        Err(error) => Err(broken.into_iter().next().unwrap_or(error)),
    }
}

fn load_in(loader: &Loader, formats: &[&dyn Format]) -> Result<Dataset, Error> {
    let (path, options) = (loader.root, loader.options);
    options.validate()?;
    files::require_folder(path)?;
    let folder = Folder::list(path)?;
    let (layout, reader) = match options.layout {
        Some(layout) => formats::open(layout, &folder, formats)?,
        None => formats::recognise(&folder, formats)?,
    };
    let capture = match options.threads {
        None => reader.read(loader)?,
        Some(threads) => rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| Error::LoadOption {
                option: "--threads",
                expected: "as many threads as the system can start".into(),
                found: format!("{threads} ({e})"),
            })?
            .install(|| reader.read(loader))?,
    };
    let is_train = |view: &View| view.partition == Partition::Train;
    if !capture.views.iter().any(is_train) {
        return Err(Error::invalid(
            path,
            "at least one camera to train on",
            format!(
                "{} camera(s), all of them held out for testing",
                capture.n_cameras
            ),
            "add cameras, or hold out others (or none) with --test-cameras",
        ));
    }
    // Callers that collect broken images check this themselves.
    if !loader.broken.is_noted() {
        if let Some(far) = FarScene::of(&capture.views, capture.points.as_ref()) {
            tracing::warn!("{}: {}; {}", path.display(), far.text(), far.mend());
        }
        if let Some(odd) = OddLens::of(&capture.views) {
            tracing::warn!("{}: {}; {}", path.display(), odd.text(), odd.mend());
        }
    }
    let name = path.canonicalize().map_err(Error::access(path))?;
    Ok(Dataset {
        name: name
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned(),
        root: path.to_path_buf(),
        layout,
        background: capture.views.iter().any(View::has_alpha).then_some(WHITE),
        views: capture.views,
        points: capture.points,
        n_frames: capture.n_frames,
        n_cameras: capture.n_cameras,
        stated_span: capture.stated_span,
        frame_rate: capture.frame_rate,
    })
}
