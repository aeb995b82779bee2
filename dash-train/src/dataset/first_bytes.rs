//! What files may begin with before or instead of what is expected: a byte order mark, a Git LFS pointer.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use serde::de::DeserializeOwned;

use super::DatasetError;

/// Some editors put it before UTF-8, where JSON has no place for it and text takes it for a part of a word.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";
/// The beginning of the text that Git LFS leaves in place of a file that was not fetched.
const LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";

/// Parses JSON, whether or not a byte order mark stands before it.
pub(crate) fn parse_json<T: DeserializeOwned>(bytes: &[u8]) -> serde_json::Result<T> {
    serde_json::from_slice(bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes))
}

/// The text of a file, without a byte order mark before it.
pub(super) fn without_mark(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

/// Refuses the bytes of a file when they are a Git LFS pointer in place of what is `expected`.
pub(crate) fn refuse_pointer(
    path: &Path,
    bytes: &[u8],
    expected: &str,
) -> Result<(), DatasetError> {
    if bytes.starts_with(LFS_POINTER) {
        return Err(DatasetError::invalid(
            path,
            expected,
            "a Git LFS pointer, not the file itself",
            "run `git lfs pull`",
        ));
    }
    Ok(())
}

/// [`refuse_pointer`] for a file that is not in memory; one that can't be read is left to its reader.
pub(super) fn refuse_pointer_file(path: &Path, expected: &str) -> Result<(), DatasetError> {
    let mut bytes = Vec::new();
    let read = File::open(path)
        .and_then(|file| file.take(LFS_POINTER.len() as u64).read_to_end(&mut bytes));
    match read {
        Ok(_) => refuse_pointer(path, &bytes, expected),
        Err(_) => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINTER: &str = "version https://git-lfs.github.com/spec/v1\noid sha256:0a\nsize 17\n";

    #[test]
    fn pointers_in_place_of_images_videos_arrays_and_points_are_told() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("pointer");
        std::fs::write(&path, POINTER).expect("writes");
        let bytes = POINTER.as_bytes();
        for error in [
            super::super::decode::dimensions(&path).expect_err("no image"),
            super::super::decode::decode(&path).expect_err("no image"),
            super::super::video::frame_size(&path, false).expect_err("no video"),
            super::super::video::VideoIndex::read(&path, true).expect_err("no video"),
            super::super::npy::parse_poses(&path, bytes).expect_err("no array"),
            crate::ply::read_points(&path).expect_err("no points"),
        ] {
            let message = error.to_string();
            let expected = "found a Git LFS pointer, not the file itself; run `git lfs pull`";
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn a_byte_order_mark_before_json_and_text_is_skipped() {
        let parsed: Vec<u8> = parse_json(b"\xef\xbb\xbf[1, 2]").expect("JSON");
        assert_eq!(parsed, [1, 2]);
        assert!(parse_json::<Vec<u8>>(b"[\xef\xbb\xbf1]").is_err());
        let marked = std::str::from_utf8(b"\xef\xbb\xbf# text").expect("UTF-8");
        assert_eq!((without_mark(marked), without_mark("")), ("# text", ""));
    }
}
