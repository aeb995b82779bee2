//! Whether names of frames say in which order they were taken. Numbers are compared as decimal ones without a sign; names
//! that mean something else are refused, and names that may be read in more than one way are told.

use std::path::Path;

use super::names::frame_numbers;
use crate::Error;

/// Names in a message, at either end of a list.
const SHOWN: usize = 2;
const MONTHS: [&str; 12] = [
    "jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec",
];
const YEARS: std::ops::RangeInclusive<u64> = 1900..=2100;

/// What the order of names rests on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Order {
    /// One decimal number that differs.
    Plain,
    /// More than that: the order that was taken, in words.
    Told(String),
    /// Something that the order of names is wrong for, in words.
    Unknown(String),
}

/// Refuses names whose order in time is not known. Otherwise the order that was taken, in words, where it may be another.
///
/// # Errors
/// [`Error::InvalidData`] at `path`, which has them.
pub(crate) fn check_order<S: AsRef<str>>(
    path: &Path,
    names: &[S],
) -> Result<Option<String>, Error> {
    match order(names) {
        Order::Plain => Ok(None),
        Order::Told(told) => Ok(Some(told)),
        Order::Unknown(found) => Err(Error::invalid(
            path,
            "names of frames with decimal numbers, without sign, in the order of time",
            found,
            "rename the frames 00000, 00001, .. in their order",
        )),
    }
}

/// What the order of these names, which are sorted, rests on.
pub(crate) fn order<S: AsRef<str>>(names: &[S]) -> Order {
    let names: Vec<&str> = names.iter().map(AsRef::as_ref).collect();
    let (prefix, parts) = differing(&names);
    if names.len() < 2 {
        return Order::Plain;
    }
    let wrong = [
        (signed as fn(&str, &[&str]) -> bool, "numbers with a sign"),
        (hexadecimal, "hexadecimal numbers"),
        (fractions, "numbers with a fraction"),
    ];
    if let Some((_, what)) = wrong.iter().find(|(is, _)| is(prefix, &parts)) {
        return Order::Unknown(format!("{what} ({})", shown(&names)));
    }
    if let Some(what) = dates(&names, &parts) {
        return Order::Unknown(format!("{what} ({})", shown(&names)));
    }
    if parts.iter().all(|part| is_number(part)) {
        return Order::Plain;
    }
    let numbers = frame_numbers(&names);
    let numbers: Vec<&str> = numbers.iter().flatten().map(String::as_str).collect();
    let numbered = match numbers.len() == names.len() {
        true => format!("as frames {}", shown(&numbers)),
        false => "without numbers".to_string(),
    };
    Order::Told(format!(
        "more than one number differs in names of frames: they are read in the order of their names ({}), {numbered}",
        shown(&names)
    ))
}

/// What all names start with, up to a number, and what is different then, up to a number's end.
fn differing<'a>(names: &[&'a str]) -> (&'a str, Vec<&'a str>) {
    let Some((&first, others)) = names.split_first() else {
        return ("", Vec::new());
    };
    let same = |start: usize, other: &str| {
        let pairs = first[..start].char_indices().zip(other.chars());
        let differs = |((_, a), b): &((usize, char), char)| a != b;
        let shorter = first[..start].len().min(other.len());
        pairs
            .into_iter()
            .find(differs)
            .map_or(shorter, |((at, _), _)| at)
    };
    let start = others
        .iter()
        .fold(first.len(), |start, other| same(start, other));
    let prefix = first[..start].trim_end_matches(|c: char| c.is_ascii_digit());
    let rest: Vec<&str> = names.iter().map(|name| &name[prefix.len()..]).collect();
    let last = rest[0];
    let same_end = |end: usize, other: &&str| {
        let pairs = last.chars().rev().zip(other.chars().rev());
        let common = pairs.take_while(|(a, b)| a == b).map(|(a, _)| a.len_utf8());
        common.sum::<usize>().min(end)
    };
    let end = rest[1..].iter().fold(last.len(), same_end);
    let suffix = last[last.len() - end..].trim_start_matches(|c: char| c.is_ascii_alphanumeric());
    let parts = rest.iter().map(|part| &part[..part.len() - suffix.len()]);
    (prefix, parts.collect())
}

fn is_number(part: &str) -> bool {
    !part.is_empty() && part.bytes().all(|c| c.is_ascii_digit())
}

/// Minus signs before some of the numbers, or before all of them where that can't be a hyphen; and plus signs beside
/// numbers without.
fn signed(prefix: &str, parts: &[&str]) -> bool {
    let has_sign = |part: &&&str| part.strip_prefix(['-', '+']).is_some_and(is_number);
    let n_signed = parts.iter().filter(has_sign).count();
    if n_signed > 0 && parts.iter().all(|part| has_sign(&part) || is_number(part)) {
        return true;
    }
    let before = prefix.strip_suffix('-');
    let stands_alone =
        before.is_some_and(|before| before.is_empty() || before.ends_with(['_', ' ', '.', '=']));
    stands_alone
        && parts
            .iter()
            .all(|part| part.starts_with(|c: char| c.is_ascii_digit()))
}

/// Hexadecimal numbers whose order is not that of the names.
fn hexadecimal(_: &str, parts: &[&str]) -> bool {
    let values: Option<Vec<u128>> = parts.iter().map(|part| hex_value(part)).collect();
    let Some(values) = values else { return false };
    let one_width = parts
        .iter()
        .all(|part| part.len() == parts[0].len() && part.len() > 1);
    let some_decimal = parts.iter().any(|part| is_number(part));
    let all_decimal = parts.iter().all(|part| is_number(part));
    !all_decimal && (one_width || some_decimal) && !values.is_sorted()
}

fn hex_value(part: &str) -> Option<u128> {
    let is_hex = !part.is_empty() && part.bytes().all(|c| c.is_ascii_hexdigit());
    is_hex
        .then(|| u128::from_str_radix(part, 16).ok())
        .flatten()
}

/// Numbers with a decimal point whose order is not that of the names. Where the part before the point is always the same,
/// numbers after it that follow one another are counters (`take1.9`, `take1.10`).
fn fractions(prefix: &str, parts: &[&str]) -> bool {
    let whole = prefix.strip_suffix(['.', ',']);
    if whole.is_some_and(|whole| whole.ends_with(|c: char| c.is_ascii_digit())) {
        let counts: Option<Vec<u64>> = parts.iter().map(|part| part.parse().ok()).collect();
        let follow = |counts: Vec<u64>| counts.windows(2).all(|pair| pair[0] + 1 == pair[1]);
        let is_sorted = parts.is_sorted_by_key(|part| part.trim_end_matches('0'));
        return !is_sorted
            && parts.iter().all(|part| is_number(part))
            && !counts.is_some_and(follow);
    }
    let is_fraction = |part: &&&str| {
        let halves = part.split_once(['.', ',']);
        halves.is_some_and(|(whole, fraction)| is_number(whole) && is_number(fraction))
    };
    let value = |part: &&str| part.replace(',', ".").parse::<f64>().ok();
    let values: Option<Vec<f64>> = parts.iter().map(value).collect();
    parts.iter().any(|part| is_fraction(&part)) && values.is_some_and(|values| !values.is_sorted())
}

/// What is wrong with the dates in names; `None` where there are none, or years come first.
fn dates(names: &[&str], parts: &[&str]) -> Option<&'static str> {
    let half = |name: &&str| words(name).find(|word| matches!(word.as_str(), "am" | "pm"));
    let halves: Option<Vec<String>> = names.iter().map(half).collect();
    if halves.is_some_and(|halves| differ(&halves) || !parts.iter().all(|part| is_number(part))) {
        return Some("times of half a day");
    }
    let is_in_order = |name: &&str| starts_with_year(name) && year_last(name).is_none();
    if names.iter().all(is_in_order) {
        return None;
    }
    let month = |name: &&str| {
        words(name).find_map(|word| MONTHS.iter().position(|m| word == *m || is_long(&word, m)))
    };
    let months: Option<Vec<usize>> = names.iter().map(month).collect();
    if months.is_some_and(|months| differ(&months)) {
        return Some("names of months");
    }
    let ends: Option<Vec<(u64, u64)>> = names.iter().map(|name| year_last(name)).collect();
    ends.filter(|ends| differ(ends))
        .map(|_| "dates that do not start with the year")
}

fn differ<T: PartialEq>(values: &[T]) -> bool {
    values.iter().any(|value| *value != values[0])
}

/// The full name of a month.
fn is_long(word: &str, month: &str) -> bool {
    const LONG: [&str; 11] = [
        "january",
        "february",
        "march",
        "april",
        "june",
        "july",
        "august",
        "september",
        "sept",
        "october",
        "november",
    ];
    word.starts_with(month) && (LONG.contains(&word) || word == "december")
}

/// The runs of letters in a name, in lower case.
fn words(name: &str) -> impl Iterator<Item = String> {
    let words = name.split(|c: char| !c.is_ascii_alphabetic());
    words
        .filter(|word| !word.is_empty())
        .map(str::to_ascii_lowercase)
}

/// The runs of digits.
fn runs(name: &str) -> Vec<&str> {
    let runs = name.split(|c: char| !c.is_ascii_digit());
    runs.filter(|run| !run.is_empty()).collect()
}

/// Whether a year and a month stand before any other number that may be part of a date.
fn starts_with_year(name: &str) -> bool {
    let runs = runs(name);
    let is_year =
        |run: &str| run.len() == 4 && run.parse().is_ok_and(|year: u64| YEARS.contains(&year));
    runs.iter()
        .any(|run| matches!(run.len(), 8 | 12 | 14) && is_year(&run[..4]) && is_month(&run[4..6]))
        || runs
            .windows(2)
            .any(|pair| is_year(pair[0]) && is_month(pair[1]))
}

fn is_month(run: &str) -> bool {
    is_day_or_month(run) && run.parse().is_ok_and(|n: u64| n <= 12)
}

fn is_day_or_month(run: &str) -> bool {
    (1..=2).contains(&run.len()) && run.parse().is_ok_and(|n: u64| (1..=31).contains(&n))
}

/// What follows the first number of a date with the year at its end.
fn year_last(name: &str) -> Option<(u64, u64)> {
    let year = |run: &str| -> Option<u64> {
        let year = run.parse().ok().filter(|year| YEARS.contains(year))?;
        (run.len() == 4).then_some(year)
    };
    let runs = runs(name);
    let spaced = runs.windows(3).find_map(|run| {
        let is_date = is_day_or_month(run[0]) && is_day_or_month(run[1]);
        is_date
            .then(|| Some((run[1].parse().ok()?, year(run[2])?)))
            .flatten()
    });
    spaced.or_else(|| {
        let eight = runs.iter().filter(|run| run.len() == 8);
        let mut dates =
            eight.filter(|run| is_day_or_month(&run[..2]) && is_day_or_month(&run[2..4]));
        dates.find_map(|run| Some((run[2..4].parse().ok()?, year(&run[4..])?)))
    })
}

/// The names, or the first and last ones.
fn shown(names: &[&str]) -> String {
    if names.len() <= 2 * SHOWN {
        return names.join(", ");
    }
    let (first, last) = (&names[..SHOWN], &names[names.len() - SHOWN..]);
    format!("{}, .., {}", first.join(", "), last.join(", "))
}

#[cfg(test)]
mod tests {
    use super::super::natural_cmp;
    use super::*;

    fn of(names: &[&str]) -> Order {
        let mut names = names.to_vec();
        names.sort_by(|a, b| natural_cmp(a, b));
        order(&names)
    }

    #[test]
    fn decimal_numbers_between_what_is_the_same_are_plain() {
        for names in [
            &["0000", "0001", "0010"][..],
            &["frame_00001", "frame_00002"],
            &["0001_cam00", "0002_cam00"],
            &["cam-01_1", "cam-01_2", "cam-01_11"],
            &["take-1", "take-2", "take-10"],
            &["a1b2c3", "a1b2c4"],
            &["am_1", "am_2"],
            &["take1.9", "take1.10", "take1.11"],
            &["take1.0001", "take1.0005", "take1.0010"],
            &["0.25", "0.50", "0.75"],
            &["only"],
            &["é1", "é2"],
            &["1700000000", "1700000040"],
            &["2024-01-31_0001", "2024-01-31_0002"],
        ] {
            assert_eq!(of(names), Order::Plain, "{names:?}");
        }
    }

    #[test]
    fn names_whose_order_is_another_one_are_found() {
        for (names, what) in [
            (
                &["frame_0009", "frame_000a", "frame_0010"][..],
                "hexadecimal",
            ),
            (&["9", "A", "10"], "hexadecimal"),
            (&["0x09", "0x0a", "0x10"], "hexadecimal"),
            (&["0099_rgb", "0100_rgb", "00a9_rgb"], "hexadecimal"),
            (&["0a1f", "0a09", "0b00"], "hexadecimal"),
            (&["frame_-1", "frame_0", "frame_1"], "sign"),
            (&["f-2", "f+2"], "sign"),
            (&["-1", "-2", "-3"], "sign"),
            (&["t=-1", "t=-2"], "sign"),
            (&["-10_rgb", "3_rgb"], "sign"),
            (&["+1", "2"], "sign"),
            (&["1.5", "1.25", "2.0"], "fraction"),
            (&["t0,5", "t0,25"], "fraction"),
            (&["0.25", "0.5", "0.75", "0.125"], "fraction"),
            (&["31-01-2024", "01-02-2024"], "year"),
            (&["12.31.2023_1", "1.1.2024_2"], "year"),
            (&["cam_31122023", "cam_01012024"], "year"),
            (&["1.2.2024 10-5", "2.1.2024 10-6"], "year"),
            (&["31012024_120000", "01022024_120000"], "year"),
            (&["30-Jan-2024", "02-Feb-2024"], "months"),
            (&["march_3", "april_2"], "months"),
            (&["11.59.59 AM", "1.00.00 PM"], "half a day"),
            (
                &["2024-01-01 at 12.59 am", "2024-01-01 at 1.00 am"],
                "half a day",
            ),
        ] {
            match of(names) {
                Order::Unknown(found) => assert!(found.contains(what), "{names:?}: {found}"),
                other => panic!("{names:?}: {other:?}"),
            }
        }
    }

    #[test]
    fn names_in_which_more_differs_are_told_with_their_order() {
        for (names, order) in [
            (
                &["2024-01-31_23-59-59", "2024-02-01_00-00-01"][..],
                "2024-01-31_23-59-59, 2024-02-01_00-00-01), as frames 59, 1",
            ),
            (
                &["20240131_235959", "20240201_000001"],
                "as frames 235959, 1",
            ),
            (&["1_1", "1_2", "2_1"], "1_1, 1_2, 2_1), as frames 1, 2, 1"),
            (&["a", "b", "c"], "(a, b, c), without numbers"),
            (&["a7", "b", "c9"], "(a7, b, c9), without numbers"),
            (&["1.5", "2.25", "3.5"], "as frames 5, 25, 5"),
        ] {
            match of(names) {
                Order::Told(told) => assert!(told.contains(order), "{names:?}: {told}"),
                other => panic!("{names:?}: {other:?}"),
            }
        }
    }
}
