//! Paths that a file lists: they must stay inside the dataset's folder.

use std::path::{Component, Path, PathBuf};

use super::find_image::find_image;
use super::unicode::in_either_form;
use crate::Error;

/// `name` in tidy form (no `.`, no `..`), or `None` when it is absolute, empty or would leave its folder.
pub(crate) fn confine(name: &str) -> Option<PathBuf> {
    let mut inside = PathBuf::new();
    for component in Path::new(name).components() {
        match component {
            Component::Normal(part) => inside.push(part),
            Component::CurDir => {}
            Component::ParentDir if inside.pop() => {}
            _ => return None,
        }
    }
    (!inside.as_os_str().is_empty() && !name.contains('\0')).then_some(inside)
}

/// Where a file that is listed by this name lies below `root`: [`confine`], but backslashes may separate
/// folders, and a path that is absolute or leaves the folder may lead back into it. Of an absolute path of another
/// computer, or of where the folder was before, the longest end that is there counts.
///
/// # Errors
/// Names the file that lists it, when it lies outside.
pub(crate) fn confined(root: &Path, name: &str, listed_in: &Path) -> Result<PathBuf, Error> {
    // Except on Windows, a name may contain backslashes.
    let written = match name.contains('\\') && !root.join(name).exists() {
        true => name.replace('\\', "/"),
        false => name.to_string(),
    };
    let here =
        confine(&written).filter(|inside| !has_drive(&written) || root.join(inside).exists());
    let inside = here
        .or_else(|| lead_back(root, &written))
        .or_else(|| moved(root, &written, listed_in));
    let inside = inside.ok_or_else(|| {
        Error::invalid(
            listed_in,
            "file names inside the dataset's folder",
            format!("{name:?}"),
            "copy the file into the folder and write its path relative to it",
        )
    })?;
    Ok(in_either_form(root, &inside))
}

/// The path relative to `root` of a path that is absolute or has `..`; `None` if it lies outside, also by a link.
fn lead_back(root: &Path, name: &str) -> Option<PathBuf> {
    if name.is_empty() || name.contains('\0') {
        return None;
    }
    let path = root.join(name);
    let root = root.canonicalize().ok()?;
    // The file itself may still lack its extension.
    let path = path.parent()?.canonicalize().ok()?.join(path.file_name()?);
    if path.exists() && !path.canonicalize().ok()?.starts_with(&root) {
        return None;
    }
    let inside = path.strip_prefix(&root).ok()?;
    (!inside.as_os_str().is_empty()).then(|| inside.to_path_buf())
}

/// Whether a path starts as `C:/` does.
fn has_drive(name: &str) -> bool {
    let bytes = name.as_bytes();
    bytes.len() > 2 && bytes[0].is_ascii_alphabetic() && &bytes[1..3] == b":/"
}

/// The longest end of an absolute path, of this system or of Windows, that names a file below `root`; else one that does with
/// another extension.
fn moved(root: &Path, name: &str, listed_in: &Path) -> Option<PathBuf> {
    if !(name.starts_with('/') || has_drive(name)) {
        return None;
    }
    let parts: Vec<&str> = name.split('/').collect();
    let ends = (1..parts.len()).map(|start| parts[start..].join("/"));
    let inside: Vec<PathBuf> = ends.filter_map(|end| confine(&end)).collect();
    let is_file = |inside: &&PathBuf| in_either_form(root, inside).is_file();
    let is_image = |inside: &&PathBuf| find_image(in_either_form(root, inside), listed_in).is_ok();
    let found = inside.iter().find(is_file);
    found.or_else(|| inside.iter().find(is_image)).cloned()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn paths_stay_inside() {
        assert_eq!(
            confine("./train/r_0").expect("inside"),
            Path::new("train/r_0")
        );
        assert_eq!(confine("a/../b.png").expect("inside"), Path::new("b.png"));
        for bad in [
            "../x.png",
            "a/../../x.png",
            "/etc/passwd",
            "",
            ".",
            "a/..",
            "x\0.png",
        ] {
            assert!(confine(bad).is_none(), "{bad:?}");
        }
    }

    #[test]
    fn paths_of_windows_and_paths_that_lead_back_are_found_inside() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let root = folder.path().join("scene");
        fs::create_dir_all(root.join("images")).expect("folders");
        fs::create_dir_all(folder.path().join("other")).expect("folders");
        let find = |name: &str| confined(&root, name, Path::new("transforms.json")).ok();
        let absolute = root.join("images/a.png");
        let absolute = absolute.to_str().expect("a name in UTF-8");
        for name in [
            "images\\a.png",
            ".\\images\\a.png",
            "../scene/images/a.png",
            "images/../../scene/images/a.png",
            absolute,
        ] {
            let expected = Some(root.join("images/a.png"));
            assert_eq!(find(name), expected, "{name}");
        }
        let outside = folder.path().join("other/a.png");
        fs::write(&outside, "").expect("writes");
        for name in [
            "../other/a.png",
            "..\\other\\a.png",
            outside.to_str().expect("a name in UTF-8"),
            "../scene",
            "nowhere/../../scene/a.png",
        ] {
            assert_eq!(find(name), None, "{name}");
        }
        // The folder was copied from elsewhere: the longest end that is there.
        fs::create_dir_all(root.join("scene/images")).expect("folders");
        for file in ["images/a.png", "scene/images/a.png", "images/b.png"] {
            fs::write(root.join(file), "").expect("writes");
        }
        for (name, expected) in [
            ("/home/ann/scene/images/a.png", Some("scene/images/a.png")),
            ("/home/ann/room/images/a.png", Some("images/a.png")),
            ("D:\\scene\\images\\b.png", Some("images/b.png")),
            ("D:/images/b.png", Some("images/b.png")),
            ("/home/ann/room/images/b", Some("images/b")),
            ("/home/ann/room/images/b.jpg", Some("images/b.jpg")),
            ("/home/ann/scene/images/c.png", None),
            ("home/../../scene/images/b.png", None),
            ("/home/ann/scene/images", None),
        ] {
            assert_eq!(find(name), expected.map(|file| root.join(file)), "{name}");
        }
        #[cfg(unix)]
        {
            fs::write(root.join("b\\c.png"), "").expect("writes");
            assert_eq!(find("b\\c.png"), Some(root.join("b\\c.png")));
            std::os::unix::fs::symlink(&outside, root.join("link.png")).expect("a link");
            assert_eq!(find("../scene/link.png"), None);
        }
    }
}
