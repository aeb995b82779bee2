//! What a file says of its video, as `ffprobe` lists it, in one go: it starts as slowly as it lists a short file.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::clock::Ratio;
use super::error::reading;
use super::ffmpeg::{ffprobe, file_argument, output};
use super::picture::{Picture, Stated};
use crate::Error;
use crate::files::refuse_pointer_file;

/// Frames of one file are refused beyond this: 46 hours at 60 frames a second.
const MAX_FRAMES: usize = 10_000_000;

/// The video of a file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Track {
    pub(super) path: PathBuf,
    /// Its number among the file's streams.
    pub(super) stream: usize,
    /// Seconds of a unit of its time stamps.
    pub(super) unit: Ratio,
    /// Frames a second as the file states, or `ffprobe` estimates.
    pub(super) rate: Option<Ratio>,
    /// Where the file's clock begins.
    pub(super) start: Option<f64>,
    pub(super) picture: Picture,
    /// Which of several tracks it is.
    choice: Option<String>,
}

/// A coded picture as the file has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Packet {
    /// When it is shown, in the track's units.
    pub(super) stamp: i64,
    pub(super) is_key: bool,
}

/// Coded pictures in the order of the file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Packets {
    pub(super) list: Vec<Packet>,
    /// Whether the file says of each when it is shown. If not, the stamps are when each is decoded.
    pub(super) are_timed: bool,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Listing {
    packets: Vec<Listed>,
    streams: Vec<Stream>,
    format: Format,
}

/// A coded picture of any stream.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Listed {
    stream_index: usize,
    /// When it is shown, when it is decoded.
    pts: Option<i64>,
    dts: Option<i64>,
    flags: String,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Format {
    start_time: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Stream {
    index: usize,
    codec_type: String,
    time_base: String,
    avg_frame_rate: String,
    disposition: Disposition,
    #[serde(flatten)]
    picture: Stated,
}

/// 0 or 1 each.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Disposition {
    default: u8,
    attached_pic: u8,
    still_image: u8,
    timed_thumbnails: u8,
}

impl Stream {
    /// Whether it is a video, not the picture of a cover or a thumbnail.
    fn is_video(&self) -> bool {
        let no_video = &self.disposition;
        let is_picture = no_video.attached_pic + no_video.still_image + no_video.timed_thumbnails;
        self.codec_type == "video" && is_picture == 0
    }
}

impl Track {
    /// Reads the head of a file.
    ///
    /// # Errors
    /// When `ffprobe` is missing, or the file has no video or one whose pictures can't be shown as meant.
    pub(super) fn read(path: &Path) -> Result<Self, Error> {
        Self::of(path, &list(path, &[])?)
    }

    /// Reads the head of a file and lists its coded pictures; nothing is decoded.
    ///
    /// # Errors
    /// Those of [`read`](Self::read), and when there are no pictures, too many, or ones without times.
    pub(super) fn read_all(path: &Path) -> Result<(Self, Packets), Error> {
        let pictures = ["-show_entries", "packet=stream_index,pts,dts,flags"];
        let listing = list(path, &pictures)?;
        let track = Self::of(path, &listing)?;
        let packets = packets(&listing.packets, track.stream);
        let packets = packets.map_err(|what| Error::video_decode(path, what))?;
        Ok((track, packets))
    }

    /// The track marked as the default one, or else the first. Pictures of covers and thumbnails don't count.
    fn of(path: &Path, listing: &Listing) -> Result<Self, Error> {
        let videos: Vec<&Stream> = listing.streams.iter().filter(|s| s.is_video()).collect();
        let default = videos.iter().find(|stream| stream.disposition.default == 1);
        let Some(stream) = default.or(videos.first()) else {
            return Err(Error::video_decode(path, "it has no video track"));
        };
        let unit = Ratio::parse(&stream.time_base, '/').ok_or_else(|| {
            Error::video_decode(path, format!("its time base is {:?}", stream.time_base))
        })?;
        let start = listing.format.start_time.as_ref();
        let start = start.and_then(|text| text.parse().ok());
        let choice = (videos.len() > 1).then(|| {
            let streams: Vec<String> = videos.iter().map(|s| s.index.to_string()).collect();
            let why = default.map_or("the first", |_| "marked as default, or the first so marked");
            let (own, all) = (stream.index, streams.join(", "));
            format!("it has several video tracks (streams {all}): stream {own} is read, {why}")
        });
        Ok(Self {
            path: path.to_path_buf(),
            stream: stream.index,
            unit,
            rate: Ratio::parse(&stream.avg_frame_rate, '/'),
            start: start.filter(|start: &f64| start.is_finite()),
            picture: Picture::new(path, &stream.picture)?,
            choice,
        })
    }

    /// Tells the user what is assumed.
    pub(super) fn tell(&self) {
        for remark in self.choice.iter().chain(&self.picture.remarks) {
            tracing::warn!("{}: {remark}", self.path.display());
        }
    }
}

/// What `ffprobe` lists of a file and its videos, with more options.
fn list(path: &Path, more: &[&str]) -> Result<Listing, Error> {
    refuse_pointer_file(path, "a video")?;
    let mut command = ffprobe();
    command
        .args(["-protocol_whitelist", "file", "-select_streams", "v"])
        .args(["-show_streams", "-show_format"])
        .args(more)
        .args(["-of", "json"])
        .arg(file_argument(path));
    let listing = output(&mut command).map_err(reading(path))?;
    serde_json::from_str(&listing)
        .map_err(|e| Error::video_decode(path, format!("ffprobe's listing: {e}")))
}

/// The coded pictures of a stream.
fn packets(listed: &[Listed], stream: usize) -> Result<Packets, String> {
    // `D`: pictures that only others need, from before the clip's beginning.
    let own = |p: &&Listed| p.stream_index == stream && !p.flags.contains('D');
    let own: Vec<&Listed> = listed.iter().filter(own).collect();
    if own.is_empty() {
        return Err("it has no frames".into());
    }
    if own.len() > MAX_FRAMES {
        return Err(format!("it has more than {MAX_FRAMES} frames"));
    }
    let all = |stamp: fn(&Listed) -> Option<i64>| {
        let packet = |listed: &&Listed| {
            let is_key = listed.flags.contains('K');
            stamp(listed).map(|stamp| Packet { stamp, is_key })
        };
        own.iter().map(packet).collect::<Option<Vec<_>>>()
    };
    let (list, are_timed) = all(|p| p.pts)
        .map(|list| (list, true))
        .or_else(|| all(|p| p.dts).map(|list| (list, false)))
        .ok_or("its pictures have no times; put it into an MP4 file")?;
    Ok(Packets { list, are_timed })
}

/// Coded pictures of stream 0 from rows of when each is shown, when it is decoded, flags.
#[cfg(test)]
pub(super) fn packets_of(rows: &[(Option<i64>, Option<i64>, &str)]) -> Result<Packets, String> {
    let listed = |&(pts, dts, flags): &(_, _, &str)| Listed {
        stream_index: 0,
        pts,
        dts,
        flags: flags.into(),
    };
    packets(&rows.iter().map(listed).collect::<Vec<_>>(), 0)
}

/// A track with stamps in milliseconds.
#[cfg(test)]
pub(super) fn track(path: &str) -> Track {
    Track {
        path: path.into(),
        stream: 0,
        unit: Ratio { n: 1, d: 1000 },
        rate: None,
        start: None,
        picture: Picture::default(),
        choice: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(listing: serde_json::Value) -> Result<Track, Error> {
        Track::of(
            Path::new("a.mp4"),
            &serde_json::from_value(listing).expect("a listing"),
        )
    }

    fn stream(index: usize, mark: &str) -> serde_json::Value {
        serde_json::json!({
            "index": index, "codec_type": "video", "width": 64, "height": 48, "time_base": "1/600",
            "avg_frame_rate": "30/1", "disposition": {mark: 1}
        })
    }

    #[test]
    fn the_default_video_is_chosen_or_else_the_first() {
        let sound = || serde_json::json!({"index": 7, "codec_type": "audio", "disposition": {"default": 1}});
        for (marks, expected, n_videos) in [
            (["dub", "dub", "dub"], 0, 3),
            (["dub", "default", "default"], 1, 3),
            (["attached_pic", "still_image", "dub"], 2, 1),
            (["attached_pic", "dub", "timed_thumbnails"], 1, 1),
            (["timed_thumbnails", "dub", "default"], 2, 2),
        ] {
            let videos = marks
                .iter()
                .enumerate()
                .map(|(index, mark)| stream(index, mark));
            let streams: Vec<_> = std::iter::once(sound()).chain(videos).collect();
            let track = chosen(serde_json::json!({"streams": streams})).expect("a video");
            assert_eq!(
                (track.stream, track.choice.is_some()),
                (expected, n_videos > 1),
                "{marks:?}"
            );
        }
        let covers = serde_json::json!({"streams": [sound(), stream(0, "attached_pic")]});
        let error = chosen(covers).expect_err("no video").to_string();
        assert!(
            error.contains("a.mp4") && error.contains("no video track"),
            "{error}"
        );
    }

    #[test]
    fn a_file_without_a_unit_of_time_is_refused() {
        for unit in ["", "0/1", "1/0", "x"] {
            let mut broken = stream(0, "default");
            broken["time_base"] = unit.into();
            assert!(
                chosen(serde_json::json!({"streams": [broken]})).is_err(),
                "{unit}"
            );
        }
        let start =
            serde_json::json!({"streams": [stream(0, "default")], "format": {"start_time": "nan"}});
        assert_eq!(chosen(start).expect("a video").start, None);
    }
}
