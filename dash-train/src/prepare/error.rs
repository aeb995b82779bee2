//! Why a dataset can't be prepared.

use std::path::{Path, PathBuf};
use std::process::ExitStatus;

use crate::files::DatasetError;

/// Why a dataset could not be prepared.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// A file of the input can't be used.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// An option is out of its range, or options contradict each other.
    #[error("{option}: expected {expected}, found {found}")]
    Setting {
        /// The option as it is written on the command line.
        option: &'static str,
        /// What would fit.
        expected: String,
        /// What was given.
        found: String,
    },
    /// The output exists and is not an empty folder.
    #[error("{}: expected no such path or an empty folder, found {found}; choose another name or remove it", .path.display())]
    OutputExists {
        /// The output that was asked for.
        path: PathBuf,
        /// What is there.
        found: &'static str,
    },
    /// The `colmap` program is not installed.
    #[error(
        "finding {purpose} needs the program `{program}`, which was not found; install it \
         (Debian/Ubuntu: `apt install colmap`, macOS: `brew install colmap`, any: `conda install -c \
         conda-forge colmap`){instead}"
    )]
    ColmapMissing {
        /// What it was to find.
        purpose: &'static str,
        /// The program that was looked for.
        program: String,
        /// What else can be done.
        instead: &'static str,
    },
    /// `colmap` ran and failed.
    #[error("colmap {step} failed ({status}); its last words: {words}; {remedy}")]
    ColmapFailed {
        /// The command of `colmap` that failed.
        step: &'static str,
        /// How it ended.
        status: ExitStatus,
        /// The last lines that it wrote.
        words: String,
        /// What the user can do.
        remedy: &'static str,
    },
    /// Structure from motion did not find where some cameras stand.
    #[error(
        "COLMAP found the poses of {} of {n_cameras} cameras{}; {REGISTRATION_REMEDY}",
        .n_cameras - .missing.len(), not_found(.missing, *.n_cameras)
    )]
    NotRegistered {
        /// The cameras without a pose.
        missing: Vec<String>,
        /// Number of cameras.
        n_cameras: usize,
    },
}

/// What to try where cameras were not registered.
const REGISTRATION_REMEDY: &str = "neighbouring cameras must share much of a textured picture: try \
     --lens shared if all cameras have the same lens, --start at a moment with more to see, remove these cameras, \
     add cameras between them and the others, or give known poses with --poses";

/// The cameras without a pose, unless that is all of them.
fn not_found(missing: &[String], n_cameras: usize) -> String {
    if missing.len() == n_cameras {
        return String::new();
    }
    format!(", not of {}", missing.join(", "))
}

impl PrepareError {
    /// A [`DatasetError::Io`] about `path`.
    pub(super) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| DatasetError::io(&path)(source).into()
    }

    /// A [`DatasetError::Invalid`] from its four parts.
    pub(super) fn invalid(
        path: &Path,
        expected: impl Into<String>,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        DatasetError::invalid(path, expected, found, remedy).into()
    }

    /// A [`PrepareError::Setting`] from its three parts.
    pub(super) fn setting(
        option: &'static str,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        Self::Setting {
            option,
            expected: expected.into(),
            found: found.to_string(),
        }
    }
}
