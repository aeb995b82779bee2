//! Listings of folders.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use dash_model::unfinished::is_unfinished;

use super::names::{
    IMAGE_EXTENSIONS, UNREAD_EXTENSIONS, VIDEO_EXTENSIONS, has_extension, natural_cmp,
};
use crate::Error;

/// Refuses a file in place of a folder; a missing path is left to its reader.
pub(crate) fn require_folder(path: &Path) -> Result<(), Error> {
    if !path.is_file() {
        return Ok(());
    }
    if has_extension(&path.to_string_lossy(), &VIDEO_EXTENSIONS) {
        return Err(Error::invalid(
            path,
            "a folder",
            "a video",
            "put the videos of all cameras into one folder, and make a dataset of it with `dash prepare`",
        ));
    }
    Err(Error::invalid(
        path,
        "a folder",
        "a file",
        "name the folder that is meant (archives are not unpacked)",
    ))
}

/// Folders whose names that are not UTF-8 were told: several layouts look into one.
static TOLD: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// The names in a folder, hidden ones left out, in natural order. Names that are not UTF-8 are left out with a warning.
pub(crate) fn list(folder: &Path) -> Result<Vec<String>, Error> {
    let entries = entries(folder)?.into_iter();
    Ok(entries.map(|(name, _)| name).collect())
}

/// The names in a folder, and whether each is a folder's. The listing itself says so, except of links: where folders are
/// far away, a question for every file takes long.
fn entries(folder: &Path) -> Result<Vec<(String, bool)>, Error> {
    require_folder(folder)?;
    let (mut names, mut others) = (Vec::new(), Vec::new());
    for entry in fs::read_dir(folder).map_err(Error::access(folder))? {
        let entry = entry.map_err(Error::access(folder))?;
        let name = match entry.file_name().into_string() {
            Ok(name) if name.starts_with('.') => continue,
            Ok(name) => name,
            Err(name) => {
                others.push(name);
                continue;
            }
        };
        let kind = entry.file_type().map_err(Error::access(folder))?;
        let is_folder = kind.is_dir() || (!kind.is_file() && entry.path().is_dir());
        names.push((name, is_folder));
    }
    if let Some(told) = not_unicode(&mut others)
        && tracing::enabled!(tracing::Level::WARN)
        && TOLD
            .lock()
            .is_ok_and(|mut told| told.insert(folder.to_path_buf()))
    {
        tracing::warn!("{}: {told}", folder.display());
    }
    names.sort_by(|(a, _), (b, _)| natural_cmp(a, b));
    Ok(names)
}

/// What is said of names that are not UTF-8.
fn not_unicode(names: &mut [OsString]) -> Option<String> {
    const SHOWN: usize = 3;
    names.sort_unstable();
    let shown: Vec<String> = names
        .iter()
        .take(SHOWN)
        .map(|name| format!("{name:?}"))
        .collect();
    let more = if names.len() > SHOWN { ", .." } else { "" };
    (!names.is_empty()).then(|| {
        format!(
            "left out {} names that are not UTF-8: {}{more}; rename these files to use them",
            names.len(),
            shown.join(", ")
        )
    })
}

/// The image files directly in a folder, in natural order; links that lead nowhere among them, so that they are told.
pub(crate) fn list_images(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let entries = entries(folder)?.into_iter();
    let images =
        entries.filter(|(name, is_folder)| !is_folder && has_extension(name, &IMAGE_EXTENSIONS));
    Ok(images.map(|(name, _)| folder.join(name)).collect())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn names_that_are_not_unicode_are_told_and_links_that_lead_nowhere_are_listed() {
        use std::os::unix::ffi::OsStringExt;
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = |name: &str| folder.path().join(name);
        fs::write(path("b.png"), "").expect("writes");
        fs::create_dir(path("c.png")).expect("folder");
        symlink(path("b.png"), path("a10.png")).expect("a link");
        symlink("nowhere.png", path("a9.png")).expect("a link");
        let mut others: Vec<OsString> = (0..4u8)
            .rev()
            .map(|n| OsString::from_vec(vec![b'x', 0xff, b'0' + n, b'.', b'p', b'n', b'g']))
            .collect();
        for name in &others {
            fs::write(folder.path().join(name), "").expect("writes");
        }
        let images = list_images(folder.path()).expect("lists");
        assert_eq!(images, ["a9.png", "a10.png", "b.png"].map(path));
        let told = not_unicode(&mut others).expect("four names");
        assert!(told.starts_with("left out 4 names"), "{told}");
        assert!(
            told.contains(r#""x\xFF0.png""#) && told.contains(", .."),
            "{told}"
        );
        assert_eq!(not_unicode(&mut []), None);
    }
}
