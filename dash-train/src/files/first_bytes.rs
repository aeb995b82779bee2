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

/// Numbers that Python writes and JSON does not have.
const NOT_IN_JSON: [&str; 3] = ["NaN", "Infinity", "-Infinity"];

/// Parses JSON, whether or not a byte order mark stands before it.
pub(crate) fn parse_json<T: DeserializeOwned>(bytes: &[u8]) -> serde_json::Result<T> {
    let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes);
    serde_json::from_slice(bytes).map_err(|error| told_of_nan(bytes, error))
}

/// The error, or a clearer one where a number is `NaN` or infinite.
fn told_of_nan(bytes: &[u8], error: serde_json::Error) -> serde_json::Error {
    let line = bytes
        .split(|&byte| byte == b'\n')
        .nth(error.line().wrapping_sub(1));
    let line = line
        .and_then(|line| std::str::from_utf8(line).ok())
        .unwrap_or_default();
    // The parser stops at the first letter or at the second.
    let mut starts =
        (error.column().saturating_sub(3)..=error.column()).filter_map(|at| line.get(at..));
    let word = starts.find_map(|rest| {
        NOT_IN_JSON
            .into_iter()
            .rev()
            .find(|word| rest.starts_with(word))
    });
    match word {
        Some(word) if error.is_syntax() => serde::de::Error::custom(format!(
            "`{word}` in line {}, column {}: a number is needed there",
            error.line(),
            error.column()
        )),
        _ => error,
    }
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

    #[test]
    fn numbers_that_json_does_not_have_are_named() {
        #[derive(Debug, serde::Deserialize)]
        struct File {
            #[serde(rename = "k1")]
            _k1: f64,
            #[serde(flatten)]
            _other: std::collections::BTreeMap<String, serde_json::Value>,
        }
        for (text, word) in [
            ("{\"k1\": NaN}", "`NaN` in line 1"),
            ("{\"k1\": 0,\n \"b\": [1, NaN, 2]}", "`NaN` in line 2"),
            ("{\"k1\": -Infinity}", "`-Infinity` in line 1"),
            ("{\"k1\": 1,\n\n\"b\": Infinity\n}", "`Infinity` in line 3"),
        ] {
            let told = parse_json::<File>(text.as_bytes())
                .expect_err(text)
                .to_string();
            assert!(told.starts_with(word), "{text}: {told}");
        }
        for text in ["{\"k1\": nil}", "{\"k1\": \"NaN\"}", "", "{\n"] {
            let told = parse_json::<File>(text.as_bytes())
                .expect_err(text)
                .to_string();
            assert!(!told.contains("is needed"), "{text}: {told}");
        }
    }
}
