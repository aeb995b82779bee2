//! Images that a file of poses lists, with or without their extension, or with another one.

use std::path::{Path, PathBuf};

use super::in_either_form;
use super::names::{IMAGE_EXTENSIONS, UNREAD_EXTENSIONS, has_extension};
use crate::Error;

/// The image of this name: as it stands, else with an extension added, else with another extension.
///
/// # Errors
/// Says what was tried, and whether the image is there in a format that is not read.
pub(crate) fn find_image(file: PathBuf, listed_in: &Path) -> Result<PathBuf, Error> {
    let is_file = |path: &PathBuf| path.is_file();
    if is_file(&file) {
        return Ok(file);
    }
    let found = |extensions| {
        let candidates = with_extensions(&file, extensions).into_iter();
        candidates.map(in_either_name).find(is_file)
    };
    if let Some(found) = found(&IMAGE_EXTENSIONS) {
        return Ok(found);
    }
    let how = match has_image_extension(&file) {
        true => "added or in place of its own",
        false => "added",
    };
    let expected = format!(
        "the image {} (or with .png, .jpg or .jpeg {how}, in either case)",
        file.display()
    );
    Err(match found(&UNREAD_EXTENSIONS) {
        Some(unread) => Error::invalid(
            listed_in,
            expected,
            format!("{}: only PNG and JPEG are read", unread.display()),
            "convert the images, or leave it out with --skip-broken",
        ),
        None => Error::invalid(
            listed_in,
            expected,
            "no such file",
            "put the image there, remove its entry, or leave it out with --skip-broken",
        ),
    })
}

/// The file in the form of its name that is there.
fn in_either_name(file: PathBuf) -> PathBuf {
    match (file.parent(), file.file_name()) {
        (Some(folder), Some(name)) => in_either_form(folder, Path::new(name)),
        _ => file,
    }
}

fn has_image_extension(file: &Path) -> bool {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    has_extension(&name, &IMAGE_EXTENSIONS) || has_extension(&name, &UNREAD_EXTENSIONS)
}

/// The file with each of the extensions in either case: added first, then in place of its own image extension.
fn with_extensions(file: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let either_case = extensions
        .iter()
        .map(|extension| extension.to_string())
        .chain(extensions.iter().map(|e| e.to_uppercase()));
    let either_case: Vec<String> = either_case.collect();
    let mut paths: Vec<PathBuf> = either_case
        .iter()
        .map(|extension| {
            let mut name = file.as_os_str().to_os_string();
            name.push(format!(".{extension}"));
            PathBuf::from(name)
        })
        .collect();
    if has_image_extension(file) {
        paths.extend(either_case.iter().map(|e| file.with_extension(e)));
    }
    paths
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_extension_is_found_and_what_was_tried_is_said() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = |name: &str| folder.path().join(name);
        let find = |name: &str| find_image(path(name), Path::new("transforms.json"));
        for name in [
            "a.jpg",
            "b.PNG",
            "c.v2.jpeg",
            "d.webp",
            "e.png.png",
            "f.jpg",
            "f.png",
        ] {
            std::fs::write(path(name), "").expect("writes");
        }
        for (listed, found) in [
            ("a", "a.jpg"),
            ("a.png", "a.jpg"),
            ("a.JPG", "a.jpg"),
            ("b", "b.PNG"),
            ("b.png", "b.PNG"),
            ("b.jpeg", "b.PNG"),
            ("c.v2", "c.v2.jpeg"),
            ("c.v2.png", "c.v2.jpeg"),
            // What is named comes first, then what is added to it.
            ("f.jpg", "f.jpg"),
            ("e.png", "e.png.png"),
            ("f", "f.png"),
        ] {
            assert_eq!(find(listed).expect(listed), path(found), "{listed}");
        }
        for (listed, words) in [
            ("g", ".jpeg added, in either case), found no such file"),
            (
                "g.png",
                ".jpeg added or in place of its own, in either case), found no such file",
            ),
            // `.v3` is no extension of pictures: nothing stands in its place.
            ("c.v3", ".jpeg added, in either case), found no such file"),
            ("d.png", "d.webp: only PNG and JPEG are read"),
            ("d", "d.webp: only PNG and JPEG are read"),
        ] {
            let message = find(listed).expect_err(listed).to_string();
            assert!(message.contains(words), "{message}");
            assert!(
                message.ends_with("or leave it out with --skip-broken"),
                "{message}"
            );
        }
    }
}
