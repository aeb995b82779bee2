//! Folder listings, file names and paths that stay inside a dataset.

use std::cmp::Ordering;
use std::fs;
use std::path::{Component, Path, PathBuf};

use super::DatasetError;

/// Extensions of image files, in the order in which a name without extension is completed.
pub(super) const IMAGE_EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Compares names with runs of digits taken as numbers: `cam2` before `cam10`.
pub(super) fn natural_cmp(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a.as_bytes(), b.as_bytes());
    loop {
        match (left.first(), right.first()) {
            (None, None) => return a.cmp(b),
            (None, _) => return Ordering::Less,
            (_, None) => return Ordering::Greater,
            (Some(x), Some(y)) if x.is_ascii_digit() && y.is_ascii_digit() => {
                let (x, x_rest) = split_digits(left);
                let (y, y_rest) = split_digits(right);
                // Without leading zeros the longer number is the larger one, whatever its length.
                let ordering = x.len().cmp(&y.len()).then_with(|| x.cmp(y));
                if ordering != Ordering::Equal {
                    return ordering;
                }
                (left, right) = (x_rest, y_rest);
            }
            (Some(x), Some(y)) if x == y => (left, right) = (&left[1..], &right[1..]),
            (Some(x), Some(y)) => return x.cmp(y),
        }
    }
}

fn split_digits(text: &[u8]) -> (&[u8], &[u8]) {
    let end = text
        .iter()
        .position(|c| !c.is_ascii_digit())
        .unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    let zeros = digits.iter().take_while(|&&c| c == b'0').count();
    (&digits[zeros..], rest)
}

/// The last run of digits in a name without its leading zeros; empty for zero, `None` without one.
pub(crate) fn frame_number(stem: &str) -> Option<&str> {
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end]
        .rfind(|c: char| !c.is_ascii_digit())
        .map_or(0, |at| {
            at + stem[at..].chars().next().map_or(1, char::len_utf8)
        });
    Some(stem[start..end].trim_start_matches('0'))
}

/// The names in a folder, hidden ones left out, in natural order.
pub(super) fn list(folder: &Path) -> Result<Vec<String>, DatasetError> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(DatasetError::io(folder))? {
        let entry = entry.map_err(DatasetError::io(folder))?;
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
pub(super) fn list_images(folder: &Path) -> Result<Vec<PathBuf>, DatasetError> {
    let names = list(folder)?;
    let images = names
        .iter()
        .filter(|name| has_extension(name, &IMAGE_EXTENSIONS));
    Ok(images
        .map(|name| folder.join(name))
        .filter(|path| path.is_file())
        .collect())
}

/// Whether the name ends in one of the extensions, in either case.
pub(super) fn has_extension(name: &str, extensions: &[&str]) -> bool {
    Path::new(name)
        .extension()
        .and_then(|e| e.to_str())
        .is_some_and(|e| extensions.iter().any(|known| known.eq_ignore_ascii_case(e)))
}

/// The file's name without folder and extension.
pub(super) fn stem(path: &Path) -> String {
    path.file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// `name` in tidy form (no `.`, no `..`), or `None` when it is absolute, empty or would leave its folder.
pub(super) fn confine(name: &str) -> Option<PathBuf> {
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

/// [`confine`] with an error that names the file in which `name` was found.
pub(super) fn confined(root: &Path, name: &str, listed_in: &Path) -> Result<PathBuf, DatasetError> {
    let inside = confine(name).ok_or_else(|| {
        DatasetError::invalid(
            listed_in,
            "file names inside the dataset's folder",
            format!("{name:?}"),
            "copy the file into the folder and write its path relative to it",
        )
    })?;
    Ok(root.join(inside))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_order_by_value() {
        let mut names = vec![
            "cam10",
            "cam2",
            "cam01",
            "cam1",
            "b",
            "cam",
            "cam2b",
            "cam00000000000000000000003",
        ];
        names.sort_by(|a, b| natural_cmp(a, b));
        let expected = [
            "b",
            "cam",
            "cam01",
            "cam1",
            "cam2",
            "cam2b",
            "cam00000000000000000000003",
            "cam10",
        ];
        assert_eq!(names, expected);
    }

    #[test]
    fn frame_numbers() {
        for (stem, expected) in [
            ("0000", Some("")),
            ("cam01_0012", Some("12")),
            ("frame-7b", Some("7")),
            ("größe5", Some("5")),
            ("left", None),
        ] {
            assert_eq!(frame_number(stem), expected, "{stem}");
        }
    }

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
}
