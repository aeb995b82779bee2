//! Files that are complete or absent.

use std::fs::{self, File};
use std::path::Path;

use crate::ModelError;

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
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".partial");
    let scratch = path.with_file_name(name);
    let result = File::create(&scratch).and_then(|file| {
        write(&file)?;
        file.sync_all()?;
        fs::rename(&scratch, path)
    });
    result.map_err(|e| {
        // The scratch file may not exist; what matters to the user is the first error.
        let _ = fs::remove_file(&scratch);
        ModelError::io(path, "write", e)
    })
}
