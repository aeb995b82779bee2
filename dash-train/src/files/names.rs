//! Names of files: natural order, frame numbers, extensions.

use std::cmp::Ordering;
use std::collections::HashSet;
use std::path::Path;

/// Extensions of image files, in the order in which a name without extension is completed.
pub(crate) const IMAGE_EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Extensions of image files that are common and not read.
pub(crate) const UNREAD_EXTENSIONS: [&str; 8] =
    ["webp", "bmp", "tif", "tiff", "gif", "exr", "heic", "avif"];

/// Extensions of videos.
pub(crate) const VIDEO_EXTENSIONS: [&str; 12] = [
    "mp4", "m4v", "mov", "mkv", "webm", "avi", "ts", "mts", "m2ts", "mxf", "mpg", "mpeg",
];

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
                // Without leading zeros the longer number is the larger one.
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

/// For each of a camera's names its frame number without leading zeros; `None` for a name without digits. It is
/// the last run of digits. If two neighbours share that (`0000_cam00`, `0001_cam00`), it is the run that differs
/// in most names.
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
}
