//! The traits of a dataset format. Formats outside this crate implement the same ones.

use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use super::layout::Layout;
use super::loader::Loader;
use super::view::View;
use crate::Error;
use crate::files::{self};
use crate::ply::PointCloud;

/// A layout of files that datasets come in.
pub trait Format: Sync {
    /// The layout's name; [`Layout::Custom`] for formats outside this crate.
    fn layout(&self) -> Layout;

    /// The reader of the folder, if its files are of this format.
    ///
    /// # Errors
    /// When the folder can't be listed.
    fn recognise(&self, folder: &Folder) -> Result<Option<Box<dyn Reader>>, Error>;

    /// The reader of a folder for which the user has chosen this format.
    ///
    /// # Errors
    /// Says what the folder lacks.
    fn open(&self, folder: &Folder) -> Result<Box<dyn Reader>, Error> {
        self.recognise(folder)?.ok_or_else(|| {
            Error::invalid(
                folder.root(),
                format!("a dataset of the layout {}", self.layout()),
                "none",
                "check the path, or choose the layout with --layout",
            )
        })
    }

    /// The cameras in the folder's file of poses, without its images; `None` where the format can't tell.
    ///
    /// # Errors
    /// Names the file of poses that is missing or damaged.
    fn poses(&self, folder: &Folder) -> Result<Option<Vec<Camera>>, Error> {
        let _ = folder;
        Ok(None)
    }
}

/// Reads a folder that was recognised. It keeps what recognising found, so that nothing is inspected twice.
pub trait Reader: Send {
    /// Reads the folder.
    ///
    /// # Errors
    /// Names the file at fault.
    fn read(self: Box<Self>, loader: &Loader) -> Result<Capture, Error>;
}

/// The views and points of a folder.
#[derive(Debug, Clone)]
pub struct Capture {
    /// Every view, of training and test cameras.
    pub views: Vec<View>,
    /// Initial points, where the folder has some.
    pub points: Option<PointCloud>,
    /// Number of distinct times; 1 for a static capture.
    pub n_frames: usize,
    /// Number of distinct cameras (for a moving camera, of poses).
    pub n_cameras: usize,
    /// As [`Dataset::stated_span`](super::Dataset::stated_span).
    pub stated_span: Option<[f64; 2]>,
    /// As [`Dataset::frame_rate`](super::Dataset::frame_rate).
    pub frame_rate: Option<f64>,
}

/// A folder that may be a dataset, with its listing.
#[derive(Debug, Clone)]
pub struct Folder {
    root: PathBuf,
    names: Vec<String>,
}

impl Folder {
    /// Lists a folder.
    ///
    /// # Errors
    /// The system's, naming the folder.
    pub fn list(root: &Path) -> Result<Self, Error> {
        Ok(Self {
            root: root.to_path_buf(),
            names: files::list(root)?,
        })
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The names in it without hidden ones, in natural order: `cam2` before `cam10`.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Whether a file or folder of this name is in it.
    pub fn has(&self, name: &str) -> bool {
        self.names.iter().any(|known| known == name)
    }
}
