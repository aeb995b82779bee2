//! Unexpected first bytes of files: a byte order mark, a Git LFS pointer.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use serde::de::DeserializeOwned;

use crate::Error;

/// Some editors write it before UTF-8; parsers of JSON and text trip over it.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";
/// The first bytes of the pointer that Git LFS leaves in place of a file.
const LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";

/// Parses JSON, whether or not a byte order mark stands before it.
pub(crate) fn parse_json<T: DeserializeOwned>(bytes: &[u8]) -> serde_json::Result<T> {
    serde_json::from_slice(bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes))
}

/// The text of a file, without a byte order mark before it.
pub(crate) fn without_mark(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

/// Refuses the bytes of a file when they are a Git LFS pointer in place of what is `expected`.
pub(crate) fn refuse_pointer(path: &Path, bytes: &[u8], expected: &str) -> Result<(), Error> {
    if bytes.starts_with(LFS_POINTER) {
        return Err(Error::invalid(
            path,
            expected,
            "a Git LFS pointer, not the file itself",
            "run `git lfs pull`",
        ));
    }
    Ok(())
}

/// [`refuse_pointer`] for a file that is not in memory; one that can't be read is left to its reader.
pub(crate) fn refuse_pointer_file(path: &Path, expected: &str) -> Result<(), Error> {
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

    #[test]
    fn a_byte_order_mark_before_json_and_text_is_skipped() {
        let parsed: Vec<u8> = parse_json(b"\xef\xbb\xbf[1, 2]").expect("JSON");
        assert_eq!(parsed, [1, 2]);
        assert!(parse_json::<Vec<u8>>(b"[\xef\xbb\xbf1]").is_err());
        let marked = std::str::from_utf8(b"\xef\xbb\xbf# text").expect("UTF-8");
        assert_eq!((without_mark(marked), without_mark("")), ("# text", ""));
    }
}
