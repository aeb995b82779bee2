//! Files that are complete or absent.

use std::fs::{self, File};
use std::path::Path;

use crate::ModelError;
use crate::unfinished::Unfinished;

/// Writes a file through a sibling scratch file that replaces it once complete and on disk.
///
/// # Errors
/// [`ModelError::Io`] that names `path`.
///
/// # Example
/// ```
/// use std::io::Write;
///
/// # let path = std::env::temp_dir().join(format!("dash-atomic-{}", std::process::id()));
/// dash_model::scene_file::write_atomically(&path, |mut file| file.write_all(b"all of it"))?;
/// assert_eq!(std::fs::read(&path).expect("written"), b"all of it");
/// # std::fs::remove_file(path).expect("written above");
/// # Ok::<(), dash_model::ModelError>(())
/// ```
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&File) -> std::io::Result<()>,
) -> Result<(), ModelError> {
    let written = || {
        let scratch = Unfinished::file(path)?;
        let file = File::options().write(true).open(scratch.path())?;
        write(&file)?;
        file.sync_all()?;
        scratch.finish(|scratch| fs::rename(scratch, path))
    };
    written().map_err(|e| ModelError::io(path, "write", e))
}
