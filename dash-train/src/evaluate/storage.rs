//! Sizes on disk.

use std::fs;
use std::path::Path;

use crate::Error;

/// Bytes of the files in a folder and its subfolders.
///
/// # Errors
/// When something in it can't be read.
pub fn storage_bytes(folder: &Path) -> Result<u64, Error> {
    let io = |e| Error::io(folder, "list", e);
    let mut bytes = 0;
    for entry in fs::read_dir(folder).map_err(io)? {
        let entry = entry.map_err(io)?;
        let metadata = entry.metadata().map_err(io)?;
        bytes += if metadata.is_dir() {
            storage_bytes(&entry.path())?
        } else {
            metadata.len()
        };
    }
    Ok(bytes)
}
