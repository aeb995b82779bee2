//! Which frames of a capture to load.

use std::fmt;
use std::num::NonZeroU64;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// A choice of frames, by the numbers in their files' names; where frames have no files or names no
/// numbers, counted from 0. As text `all` or `FIRST-LAST`, such as `151-200`; by their places `#FIRST-LAST`; every tenth `all/10`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum FrameRange {
    /// All of them, also where results are published for some.
    All,
    /// From one to another, both included.
    Between {
        /// The first.
        first: u64,
        /// The last; not before the first.
        last: u64,
    },
    /// By their places among all frames, counted from 0, whatever their numbers; both included.
    Places {
        /// The first.
        first: u64,
        /// The last; not before the first.
        last: u64,
    },
    /// Every so many, from the first on.
    Every(NonZeroU64),
}

impl FrameRange {
    /// Whether the frame of this number at this place among all is chosen.
    pub fn contains(self, number: u64, place: usize) -> bool {
        match self {
            Self::All => true,
            Self::Between { first, last } => (first..=last).contains(&number),
            Self::Places { first, last } => (first..=last).contains(&(place as u64)),
            Self::Every(step) => (place as u64).is_multiple_of(step.get()),
        }
    }
}

impl fmt::Display for FrameRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => f.write_str("all"),
            Self::Between { first, last } => write!(f, "{first}-{last}"),
            Self::Places { first, last } => write!(f, "#{first}-{last}"),
            Self::Every(step) => write!(f, "all/{step}"),
        }
    }
}

impl FromStr for FrameRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "all" {
            return Ok(Self::All);
        }
        let wrong = || {
            format!(
                "expected frame numbers FIRST-LAST, such as 151-200, or all, or all/10, found `{text}`"
            )
        };
        if let Some(step) = text.strip_prefix("all/") {
            let is_number = step.bytes().all(|b| b.is_ascii_digit());
            let step = step.parse().ok().filter(|_| is_number);
            return step.map(Self::Every).ok_or_else(wrong);
        }
        let (by_place, range) = match text.strip_prefix('#') {
            Some(range) => (true, range),
            None => (false, text),
        };
        let (first, last) = range.split_once('-').ok_or_else(wrong)?;
        let number = |text: &str| match text.bytes().all(|b| b.is_ascii_digit()) {
            true => text.parse().map_err(|_| wrong()),
            false => Err(wrong()),
        };
        let (first, last) = (number(first)?, number(last)?);
        if first > last {
            return Err(wrong());
        }
        Ok(match by_place {
            true => Self::Places { first, last },
            false => Self::Between { first, last },
        })
    }
}

impl TryFrom<String> for FrameRange {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<FrameRange> for String {
    fn from(range: FrameRange) -> Self {
        range.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_read_as_they_are_written() {
        for text in ["all", "0-0", "151-200", "#0-59", "all/1", "all/10"] {
            let range: FrameRange = text.parse().expect("a range");
            assert_eq!(range.to_string(), text);
        }
        for bad in [
            "", "7", "-", "#", "#5", "##1-2", "5-", "-5", "9-3", "+1-2", "1-2-3", "All", "1- 2",
            "all/0", "all/", "all/+2",
        ] {
            assert!(bad.parse::<FrameRange>().is_err(), "{bad}");
        }
        let too_large = "0-99999999999999999999";
        assert!(too_large.parse::<FrameRange>().is_err());
    }
}
