//! The names of a page's parts.

use std::fmt;
use std::str::FromStr;

/// What a part belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Owner {
    /// What windows share.
    Room,
    /// A window of time, by its number.
    Window(usize),
}

/// A part of a page's scene. Its text is what the names of its two files begin with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PartName {
    /// What it belongs to.
    pub owner: Owner,
    /// Which of its parts it is, from 0.
    pub index: usize,
}

impl fmt::Display for PartName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.owner {
            Owner::Room => write!(f, "room_part{}", self.index),
            Owner::Window(0) => write!(f, "part{}", self.index),
            Owner::Window(window) => write!(f, "window{window}_part{}", self.index),
        }
    }
}

impl FromStr for PartName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let parsed = || {
            let (owner, index) = text.rsplit_once("part")?;
            let owner = match owner {
                "" => Owner::Window(0),
                "room_" => Owner::Room,
                window => Owner::Window(
                    window
                        .strip_prefix("window")?
                        .strip_suffix('_')?
                        .parse()
                        .ok()?,
                ),
            };
            let index = index.parse().ok()?;
            Some(Self { owner, index })
        };
        parsed().ok_or_else(|| format!("expected the name of a part, found {text}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for (owner, index, text) in [
            (Owner::Room, 1, "room_part1"),
            (Owner::Window(0), 2, "part2"),
            (Owner::Window(12), 0, "window12_part0"),
        ] {
            let name = PartName { owner, index };
            assert_eq!(name.to_string(), text);
            assert_eq!(text.parse(), Ok(name));
        }
        for text in [
            "",
            "part",
            "windowpart0",
            "window1part0",
            "roompart0",
            "part-1",
        ] {
            assert!(text.parse::<PartName>().is_err(), "{text}");
        }
    }
}
