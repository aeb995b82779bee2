//! Values of arguments: sizes, colours, times, lists, amounts of memory, paths.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use dash_model::{SplatFormat, is_splat_ply};
use dash_train::SplatClip;

use crate::failure::Failure;

/// `WxH` in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    /// Width.
    pub width: usize,
    /// Height.
    pub height: usize,
}

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("expected WIDTHxHEIGHT in pixels, such as 160x120, found `{text}`");
        let (width, height) = text.split_once('x').ok_or_else(wrong)?;
        let side = |text: &str| text.parse().map_err(|_| wrong());
        Ok(Self {
            width: side(width)?,
            height: side(height)?,
        })
    }
}

/// Camera indices: `0,7`, or `none`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraList(pub Vec<usize>);

impl FromStr for CameraList {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "none" {
            return Ok(Self(Vec::new()));
        }
        let wrong = || format!("expected camera indices such as 0,7, or none, found `{text}`");
        let indices = text
            .split(',')
            .map(|index| index.trim().parse().map_err(|_| wrong()));
        indices.collect::<Result<_, _>>().map(Self)
    }
}

/// Red, green and blue, sRGB in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Color(pub [f32; 3]);

impl FromStr for Color {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("expected R,G,B, each from 0 to 1, such as 1,1,1, found `{text}`");
        let values: Vec<f32> = text
            .split(',')
            .map(|value| value.trim().parse().map_err(|_| wrong()))
            .collect::<Result<_, _>>()?;
        match <[f32; 3]>::try_from(values) {
            Ok(color) if color.iter().all(|v| (0.0..=1.0).contains(v)) => Ok(Self(color)),
            _ => Err(wrong()),
        }
    }
}

/// How many: at least 1.
pub fn count(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|number| *number > 0);
    number.ok_or_else(|| format!("expected a whole number of at least 1, found `{text}`"))
}

/// A path as a word of a shell's command.
pub fn word(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+:@%,".contains(c);
    match !text.is_empty() && text.chars().all(is_plain) {
        true => text,
        false => format!("'{}'", text.replace('\'', "'\\''")),
    }
}

/// A time in the clip.
pub fn time(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(time) if (0.0..=1.0).contains(&time) => Ok(time),
        _ => Err(format!(
            "expected a time from 0 (the clip's start) to 1 (its end), found `{text}`"
        )),
    }
}

/// A time span in seconds: a number with a unit, or of seconds alone.
pub fn seconds(text: &str) -> Result<f64, String> {
    const UNITS: [(&str, f64); 3] = [("min", 60.0), ("h", 3600.0), ("s", 1.0)];
    let with_unit = UNITS
        .iter()
        .find_map(|&(unit, secs)| Some((text.strip_suffix(unit)?, secs)));
    let (number, unit) = with_unit.unwrap_or((text, 1.0));
    match number.trim().parse::<f64>() {
        Ok(number) if (number * unit).is_finite() && number > 0.0 => Ok(number * unit),
        _ => Err(format!(
            "expected a time above 0, such as 90s, 20min or 1.5h, found `{text}`"
        )),
    }
}

/// The whole path of something that is there.
pub fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    path.canonicalize().map_err(|e| {
        Failure::new(format!(
            "{}: cannot be found: {e}; check the path",
            path.display()
        ))
    })
}

/// Whether a path is named as a file of Gaussians, and is no folder.
pub fn is_splat_file(path: &Path) -> bool {
    SplatFormat::of(path).is_some() && !path.is_dir()
}

/// Whether a path holds Gaussians to play: a file, a clip, or a folder of files that is no run.
pub fn is_clip(path: &Path) -> bool {
    match path.is_dir() {
        true => !path.join("config.toml").is_file() && holds_splats(path),
        false => SplatFormat::of(path).is_some() || SplatClip::is_motions(path),
    }
}

/// Whether a folder has files of Gaussians and neither folders nor clouds of points, as a dataset has.
fn holds_splats(folder: &Path) -> bool {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut found = false;
    for path in entries.map(|entry| entry.path()) {
        match SplatFormat::of(&path) {
            _ if path.is_dir() => return false,
            Some(SplatFormat::Ply) if !is_splat_ply(&path) => return false,
            Some(_) => found = true,
            None => {}
        }
    }
    found
}

/// Frames per second.
pub fn frame_rate(text: &str) -> Result<f64, String> {
    let rate = text.parse().ok();
    rate.filter(|rate| (0.01..=1000.0).contains(rate))
        .ok_or_else(|| format!("expected frames per second from 0.01 to 1000, found `{text}`"))
}

/// Whether a path ends in this extension, in either case.
pub fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension()
        .is_some_and(|found| found.eq_ignore_ascii_case(extension))
}

/// A factor by which images are made smaller.
pub fn downscale(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(factor) if factor >= 1.0 && factor.is_finite() => Ok(factor),
        _ => Err(format!("expected a factor of at least 1, found `{text}`")),
    }
}

/// An amount of memory: bytes, or with a unit of 1000 (kB, MB, GB, TB) or 1024 (KiB, MiB, GiB, TiB).
pub fn bytes(text: &str) -> Result<u64, String> {
    const UNITS: [(&str, u64); 9] = [
        ("KiB", 1 << 10),
        ("MiB", 1 << 20),
        ("GiB", 1 << 30),
        ("TiB", 1 << 40),
        ("kB", 1_000),
        ("MB", 1_000_000),
        ("GB", 1_000_000_000),
        ("TB", 1_000_000_000_000),
        ("B", 1),
    ];
    let wrong = || format!("expected bytes, such as 2GiB, 500MB or 1000000, found `{text}`");
    let (number, unit) = UNITS
        .iter()
        .find_map(|(name, unit)| text.strip_suffix(name).map(|number| (number, *unit)))
        .unwrap_or((text, 1));
    let number: f64 = number.trim().parse().map_err(|_| wrong())?;
    if !(number.is_finite() && number > 0.0) {
        return Err(wrong());
    }
    // Saturates beyond what any machine has.
    Ok((number * unit as f64) as u64)
}

/// How a clip is divided into windows of time: frames of each, if there are any.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WindowChoice(pub Option<usize>);

/// A number of frames, or `none`.
pub fn window(text: &str) -> Result<WindowChoice, String> {
    match text {
        "none" => Ok(WindowChoice(None)),
        _ => match text.parse() {
            Ok(frames) => Ok(WindowChoice(Some(frames))),
            Err(_) => Err(format!(
                "expected a number of frames or none, found `{text}`"
            )),
        },
    }
}

/// `yes` or `no`.
pub fn yes_or_no(text: &str) -> Result<bool, String> {
    match text {
        "yes" => Ok(true),
        "no" => Ok(false),
        _ => Err(format!("expected yes or no, found `{text}`")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_words_of_a_shell() {
        for (path, expected) in [
            ("runs/room-1", "runs/room-1"),
            ("out/my room", "'out/my room'"),
            ("it's", "'it'\\''s'"),
            ("r\u{e4}ume/1", "r\u{e4}ume/1"),
            ("$HOME", "'$HOME'"),
        ] {
            assert_eq!(word(Path::new(path)), expected);
        }
    }

    #[test]
    fn folders_of_datasets_are_no_clips() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let write = |name: &str, text: &str| {
            std::fs::write(folder.path().join(name), text).expect("writable");
        };
        assert!(!is_clip(folder.path()));
        write("00000.spz", "");
        write("notes.txt", "");
        assert!(is_clip(folder.path()));
        // Points, not Gaussians.
        let head = "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n";
        write("points3d.ply", head);
        assert!(!is_clip(folder.path()));
        std::fs::remove_file(folder.path().join("points3d.ply")).expect("removed");
        std::fs::create_dir(folder.path().join("cam00")).expect("writable");
        assert!(!is_clip(folder.path()));
        assert!(is_clip(&folder.path().join("room.4DGS")));
    }

    #[test]
    fn amounts_of_memory() {
        assert_eq!(bytes("1000"), Ok(1000));
        assert_eq!(bytes("2GiB"), Ok(2 << 30));
        assert_eq!(bytes("0.5 MB"), Ok(500_000));
        assert_eq!(bytes("12B"), Ok(12));
        for bad in ["", "GiB", "-1", "0", "2 gigs", "inf", "NaNMB"] {
            assert!(bytes(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn time_spans() {
        for (text, secs) in [
            ("90", 90.0),
            ("90s", 90.0),
            ("20min", 1_200.0),
            ("1.5 h", 5_400.0),
        ] {
            assert_eq!(seconds(text), Ok(secs), "{text}");
        }
        for bad in [
            "", "min", "0", "-1s", "soon", "NaN", "inf", "1e400h", "2 days",
        ] {
            assert!(seconds(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn extensions_count_in_either_case() {
        for (path, expected) in [
            ("a.ply", true),
            ("b/a.PLY", true),
            ("ply", false),
            ("a.ply.gz", false),
        ] {
            assert_eq!(has_extension(Path::new(path), "ply"), expected, "{path}");
        }
    }

    #[test]
    fn sizes_colours_times_and_lists() {
        assert_eq!(
            "32x24".parse(),
            Ok(Size {
                width: 32,
                height: 24
            })
        );
        assert_eq!("1, 0,0.5".parse(), Ok(Color([1.0, 0.0, 0.5])));
        assert_eq!("0,7".parse(), Ok(CameraList(vec![0, 7])));
        assert_eq!("none".parse(), Ok(CameraList(vec![])));
        assert_eq!(time("0.25"), Ok(0.25));
        assert_eq!(downscale("2"), Ok(2.0));
        for bad in ["32", "32x", "x24", "axb", "-1x2"] {
            assert!(bad.parse::<Size>().is_err(), "{bad}");
        }
        for bad in ["1,1", "1,1,1,1", "2,0,0", "NaN,0,0", "red"] {
            assert!(bad.parse::<Color>().is_err(), "{bad}");
        }
        for bad in ["", "a", "1,,2", "-1"] {
            assert!(bad.parse::<CameraList>().is_err(), "{bad}");
        }
        for bad in ["-0.1", "1.1", "NaN", ""] {
            assert!(time(bad).is_err() && downscale("0.5").is_err(), "{bad}");
        }
    }
}
