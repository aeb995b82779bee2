//! Listings of folders.

use std::fs;
use std::path::{Path, PathBuf};

use dash_model::unfinished::is_unfinished;

use super::names::{IMAGE_EXTENSIONS, UNREAD_EXTENSIONS, has_extension, natural_cmp};
use crate::Error;

/// Refuses a file in place of a folder; a missing path is left to its reader.
pub(crate) fn require_folder(path: &Path) -> Result<(), Error> {
    if !path.is_file() {
        return Ok(());
    }
    Err(Error::invalid(
        path,
        "a folder",
        "a file",
        "name the folder that is meant (archives are not unpacked)",
    ))
}

/// The names in a folder, hidden ones left out, in natural order.
pub(crate) fn list(folder: &Path) -> Result<Vec<String>, Error> {
    require_folder(folder)?;
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(Error::access(folder))? {
        let entry = entry.map_err(Error::access(folder))?;
        if let Ok(name) = entry.file_name().into_string()
            && !name.starts_with('.')
        {
            names.push(name);
        }
    }
    names.sort_by(|a, b| natural_cmp(a, b));
    Ok(names)
}

/// The image files directly in a folder, in natural order.
pub(crate) fn list_images(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let names = list(folder)?;
    let images = names
        .iter()
        .filter(|name| has_extension(name, &IMAGE_EXTENSIONS));
    Ok(images
        .map(|name| folder.join(name))
        .filter(|path| path.is_file())
        .collect())
}

/// Whether a folder is there and has something in it, beside what a killed program left unfinished.
pub(crate) fn is_occupied(folder: &Path) -> std::io::Result<bool> {
    match fs::read_dir(folder) {
        Ok(mut entries) => Ok(entries.any(|entry| !entry.is_ok_and(|e| is_unfinished(&e.path())))),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

/// A note for errors about missing images: the folder or its `images/` has images of formats that are not read.
pub(crate) fn unread_images(folder: &Path) -> String {
    for folder in [folder.to_path_buf(), folder.join("images")] {
        let names = list(&folder).unwrap_or_default();
        let is_unread = |name: &&String| has_extension(name, &UNREAD_EXTENSIONS);
        if let Some(name) = names.iter().find(is_unread) {
            let file = folder.join(name);
            return format!(" (but {}: only PNG and JPEG are read)", file.display());
        }
    }
    String::new()
}
