//! Names whose letters with marks are written in one piece (NFC) or in two (NFD, as macOS writes them): both mean one file.

use std::borrow::Cow;
use std::path::{Component, Path, PathBuf};

use unicode_normalization::UnicodeNormalization;

/// The name in one form, to compare it.
pub(crate) fn one_form(name: &str) -> Cow<'_, str> {
    match name.is_ascii() {
        true => Cow::Borrowed(name),
        false => Cow::Owned(name.nfc().collect()),
    }
}

/// The path below `root` in the form in which its folders and its file are there; as far as they are.
pub(crate) fn in_either_form(root: &Path, inside: &Path) -> PathBuf {
    let whole = root.join(inside);
    if inside.to_str().is_none_or(str::is_ascii) || whole.exists() {
        return whole;
    }
    let parts = inside.components();
    parts.fold(root.to_path_buf(), |folder, part| in_folder(&folder, part))
}

fn in_folder(folder: &Path, part: Component) -> PathBuf {
    let path = folder.join(part);
    let Some(name) = part.as_os_str().to_str().filter(|name| !name.is_ascii()) else {
        return path;
    };
    let forms = [name.nfc().collect::<String>(), name.nfd().collect()];
    let mut others = forms.into_iter().map(|form| folder.join(form));
    match path.exists() {
        true => path,
        false => others.find(|other| other.exists()).unwrap_or(path),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn files_are_found_in_the_form_that_they_have() {
        let (nfc, nfd) = ("caf\u{e9}", "cafe\u{301}");
        assert_eq!((one_form(nfd), one_form(nfc)), (nfc.into(), nfc.into()));
        for (folder, file) in [(nfc, nfc), (nfc, nfd), (nfd, nfc), (nfd, nfd)] {
            let root = tempfile::tempdir().expect("temporary folder");
            let there = root.path().join(folder).join(format!("{file}.png"));
            fs::create_dir(root.path().join(folder)).expect("folder");
            fs::write(&there, "").expect("writes");
            for listed in [nfc, nfd] {
                for name in [nfc, nfd] {
                    let inside = Path::new(listed).join(format!("{name}.png"));
                    assert_eq!(in_either_form(root.path(), &inside), there);
                    // What is missing keeps the name that was asked for, in the folder that is there.
                    let missing = Path::new(listed).join(format!("{name}.jpg"));
                    let expected = root.path().join(folder).join(format!("{name}.jpg"));
                    assert_eq!(in_either_form(root.path(), &missing), expected);
                }
            }
        }
    }
}
