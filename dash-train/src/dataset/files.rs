//! Folder listings, file names and paths that stay inside a dataset.

use std::cmp::Ordering;
use std::collections::HashSet;
use std::fs;
use std::path::{Component, Path, PathBuf};

use super::DatasetError;

/// Extensions of image files, in the order in which a name without extension is completed.
pub(super) const IMAGE_EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Extensions of image files that are common and not read.
pub(super) const UNREAD_EXTENSIONS: [&str; 8] =
    ["webp", "bmp", "tif", "tiff", "gif", "exr", "heic", "avif"];

/// Compares names with runs of digits taken as numbers: `cam2` before `cam10`.
pub(crate) fn natural_cmp(a: &str, b: &str) -> Ordering {
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

/// For each of a camera's names the digits that number its frame, without leading zeros; `None` for a name
/// without any. They are the last run of digits, or where that is the same in two neighbours (`0000_cam00`,
/// `0001_cam00`) the run that differs in most names, of equal ones the first.
pub(crate) fn frame_numbers<S: AsRef<str>>(names: &[S]) -> Vec<Option<String>> {
    let runs: Vec<Vec<&str>> = names.iter().map(|name| digit_runs(name.as_ref())).collect();
    let last = |runs: &Vec<&str>| runs.last().map(|&run| run.to_string());
    let numbers: Vec<Option<String>> = runs.iter().map(last).collect();
    if !numbers
        .windows(2)
        .any(|pair| pair[0].is_some() && pair[0] == pair[1])
    {
        return numbers;
    }
    let n_different = |place: usize| {
        let different: HashSet<&str> = runs.iter().map(|runs| runs[place]).collect();
        different.len()
    };
    let fewest = runs.iter().map(Vec::len).min().unwrap_or(0);
    match (0..fewest).rev().max_by_key(|&place| n_different(place)) {
        Some(place) if n_different(place) > 1 => runs
            .iter()
            .map(|runs| Some(runs[place].to_string()))
            .collect(),
        _ => numbers,
    }
}

/// The runs of digits in a name in order, without leading zeros; `0` for zero.
fn digit_runs(name: &str) -> Vec<&str> {
    let runs = name.split(|c: char| !c.is_ascii_digit());
    runs.filter(|run| !run.is_empty())
        .map(|run| match run.trim_start_matches('0') {
            "" => "0",
            digits => digits,
        })
        .collect()
}

/// Refuses a file where a folder is expected; what is not there at all is left to its reader.
pub(super) fn require_folder(path: &Path) -> Result<(), DatasetError> {
    if !path.is_file() {
        return Ok(());
    }
    Err(DatasetError::invalid(
        path,
        "a folder",
        "a file",
        "name the folder that is meant (archives are not unpacked)",
    ))
}

/// The names in a folder, hidden ones left out, in natural order.
pub(crate) fn list(folder: &Path) -> Result<Vec<String>, DatasetError> {
    require_folder(folder)?;
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
pub(crate) fn list_images(folder: &Path) -> Result<Vec<PathBuf>, DatasetError> {
    let names = list(folder)?;
    let images = names
        .iter()
        .filter(|name| has_extension(name, &IMAGE_EXTENSIONS));
    Ok(images
        .map(|name| folder.join(name))
        .filter(|path| path.is_file())
        .collect())
}

/// What to add to an error about missing images: those of other formats that the folder or its `images/` has, if
/// there are any.
pub(super) fn unread_images(folder: &Path) -> String {
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

/// Whether the name ends in one of the extensions, in either case.
pub(crate) fn has_extension(name: &str, extensions: &[&str]) -> bool {
    Path::new(name)
        .extension()
        .and_then(|e| e.to_str())
        .is_some_and(|e| extensions.iter().any(|known| known.eq_ignore_ascii_case(e)))
}

/// The file's name without folder and extension.
pub(crate) fn stem(path: &Path) -> String {
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

/// Where a file that is listed by this name lies below `root`: [`confine`], but backslashes may separate
/// folders, and a path that is absolute or leaves the folder may lead back into it.
///
/// # Errors
/// Names the file that lists it, when it lies outside.
pub(super) fn confined(root: &Path, name: &str, listed_in: &Path) -> Result<PathBuf, DatasetError> {
    // Elsewhere than on Windows a file may really be called so.
    let written = match name.contains('\\') && !root.join(name).exists() {
        true => name.replace('\\', "/"),
        false => name.to_string(),
    };
    let inside = confine(&written).or_else(|| lead_back(root, &written));
    let inside = inside.ok_or_else(|| {
        DatasetError::invalid(
            listed_in,
            "file names inside the dataset's folder",
            format!("{name:?}"),
            "copy the file into the folder and write its path relative to it",
        )
    })?;
    Ok(root.join(inside))
}

/// Where below `root` a path lies that is absolute or leaves the folder; `None` where that is outside,
/// also by a link.
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
    fn frames_are_numbered_by_the_digits_that_differ() {
        let numbers = |names: &[&str]| -> Vec<String> {
            let numbers = frame_numbers(names).into_iter();
            numbers.map(|number| number.unwrap_or_default()).collect()
        };
        for (name, expected) in [
            ("0000", "0"),
            ("cam01_0012", "12"),
            ("frame-7b", "7"),
            ("größe5", "5"),
            ("left", ""),
        ] {
            assert_eq!(numbers(&[name]), [expected], "{name}");
        }
        for (names, expected) in [
            (["0000_cam00", "0001_cam00", "0007_cam00"], ["0", "1", "7"]),
            (["0_rgb_v2", "1_rgb_v2", "2_rgb_v2"], ["0", "1", "2"]),
            (["cam1_3_v2", "cam1_4_v2", "cam1_4_v2b"], ["3", "4", "4"]),
            // The last ones where they tell neighbours apart.
            (["1_1", "1_2", "2_1"], ["1", "2", "1"]),
            (["a", "b", "c2"], ["", "", "2"]),
            (["a2", "b2", "c"], ["2", "2", ""]),
        ] {
            assert_eq!(numbers(&names), expected, "{names:?}");
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
        #[cfg(unix)]
        {
            fs::write(root.join("b\\c.png"), "").expect("writes");
            assert_eq!(find("b\\c.png"), Some(root.join("b\\c.png")));
            std::os::unix::fs::symlink(&outside, root.join("link.png")).expect("a link");
            assert_eq!(find("../scene/link.png"), None);
        }
    }
}
