//! The output folder: whole, or not at all.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use dash_model::unfinished::Unfinished;

use crate::Error;

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

/// Refuses an output that is not free; returns the folder it is to be in.
fn free_parent(out: &Path) -> Result<PathBuf, Error> {
    let refuse = |found| {
        Err(Error::OutputExists {
            path: out.to_path_buf(),
            found,
        })
    };
    if out.file_name().is_none() {
        return Err(Error::prepare_setting(
            "OUT",
            "a path that ends in a folder name, such as `data/room`",
            out.display(),
        ));
    }
    match fs::symlink_metadata(out) {
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        Err(error) => return Err(Error::access(out)(error)),
        Ok(found) if found.is_symlink() => return refuse("a link"),
        Ok(found) if !found.is_dir() => return refuse("a file"),
        Ok(_) => {
            let mut entries = fs::read_dir(out).map_err(Error::access(out))?;
            if entries.next().is_some() {
                return refuse("a folder with files in it");
            }
        }
    }
    Ok(match out.parent() {
        Some(parent) if parent != Path::new("") => parent.to_path_buf(),
        _ => PathBuf::from("."),
    })
}
