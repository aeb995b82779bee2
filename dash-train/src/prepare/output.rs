//! The output folder: whole, or not at all.

use std::fs;
use std::path::{Path, PathBuf};

use dash_model::unfinished::Unfinished;

use crate::Error;
use crate::files::free_parent;

/// A scratch folder beside the output, which takes the output's name at the end. Dropped before,
/// it leaves nothing behind.
pub(super) struct Output {
    out: PathBuf,
    scratch: Unfinished,
}

impl Output {
    /// Checks that `out` is free and makes the scratch folder.
    pub(super) fn create(out: &Path) -> Result<Self, Error> {
        let parent = free_parent(out)?;
        fs::create_dir_all(&parent).map_err(Error::access(&parent))?;
        // On the file system of `out`, so that the rename at the end is one step.
        let scratch = Unfinished::folder(out).map_err(Error::access(&parent))?;
        let output = Self {
            out: out.to_path_buf(),
            scratch,
        };
        for folder in [output.dataset(), output.workspace()] {
            fs::create_dir(&folder).map_err(Error::access(&folder))?;
        }
        Ok(output)
    }

    /// What becomes `out`.
    pub(super) fn dataset(&self) -> PathBuf {
        self.scratch.path().join("dataset")
    }

    /// For files that are not part of the dataset.
    pub(super) fn workspace(&self) -> PathBuf {
        self.scratch.path().join("workspace")
    }

    /// Puts the dataset under its name.
    pub(super) fn finish(self) -> Result<(), Error> {
        let (out, dataset) = (&self.out, self.dataset());
        self.scratch.finish(|_| {
            if out.exists() {
                // Not every system renames over an empty folder.
                fs::remove_dir(out).map_err(Error::access(out))?;
            }
            fs::rename(dataset, out).map_err(Error::access(out))
        })
    }
}
