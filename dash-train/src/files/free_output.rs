//! Outputs that must not be there yet.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::Error;

/// Refuses an output that is not free; returns the folder it is to be in.
pub(crate) fn free_parent(out: &Path) -> Result<PathBuf, Error> {
    let refuse = |found| {
        Err(Error::OutputExists {
            path: out.to_path_buf(),
            found,
        })
    };
    if out.file_name().is_none() {
        return Err(Error::setting(
            "OUT",
            "a path that ends in a folder name, such as `out/room`",
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
