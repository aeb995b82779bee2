//! Where the frames of a video are: presentation times and groups of pictures.

use std::ops::Range;
use std::path::Path;

use super::clock::{Clock, clock};
use super::decode::{Portion, VideoFrame, Which, decode, size_of};
use super::probe::{Packet, Packets, Track};
use crate::Error;

/// The frames of a video file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct VideoIndex {
    pub(super) track: Track,
    /// Width and height of its frames.
    size: (usize, usize),
    clock: Clock,
    /// Presentation time of each frame in order, in the track's units.
    pub(super) stamps: Vec<i64>,
    /// Whether the file states presentation times. If not, it is decoded from its beginning.
    pub(super) is_timed: bool,
    /// Frames at which a group of pictures starts; begins with 0.
    pub(super) entries: Vec<usize>,
    /// Presentation times in the order of the file.
    pub(super) packets: Vec<i64>,
    /// Of a damaged video, for each entry how many coded pictures from there on decode.
    pub(super) sound: Option<Vec<usize>>,
}

impl VideoIndex {
    /// Reads the file's index and decodes the first picture, which may be damaged with `skip_broken`.
    ///
    /// # Errors
    /// When `ffprobe` or `ffmpeg` is missing, or the file is no video or one whose pictures can't be shown as meant.
    pub(crate) fn read(path: &Path, skip_broken: bool) -> Result<Self, Error> {
        let (track, packets) = Track::read_all(path)?;
        let size = size_of(&track, skip_broken)?;
        track.tell();
        Ok(Self::new(track, size, &packets))
    }

    fn new(track: Track, size: (usize, usize), packets: &Packets) -> Self {
        let list = &packets.list;
        let mut stamps: Vec<i64> = list.iter().map(|packet| packet.stamp).collect();
        stamps.sort_unstable();
        let mut entries = vec![0];
        for (place, packet) in list.iter().enumerate().filter(|(_, p)| p.is_key) {
            // Pictures that follow a key frame in the file but are shown before it need the group before.
            let shown_before = |later: &Packet| later.stamp < packet.stamp;
            let after = list[place + 1..].iter().take_while(|p| !p.is_key);
            if packets.are_timed && place > 0 && !after.into_iter().any(shown_before) {
                entries.push(stamps.partition_point(|&stamp| stamp < packet.stamp));
            }
        }
        entries.sort_unstable();
        entries.dedup();
        Self {
            clock: clock(&stamps, track.unit, track.rate),
            track,
            size,
            stamps,
            is_timed: packets.are_timed,
            entries,
            packets: list.iter().map(|packet| packet.stamp).collect(),
            sound: None,
        }
    }

    pub(crate) fn path(&self) -> &Path {
        &self.track.path
    }

    /// Width and height of the frames.
    pub(crate) fn size(&self) -> (usize, usize) {
        self.size
    }

    pub(crate) fn n_frames(&self) -> usize {
        self.stamps.len()
    }

    /// Presentation time of each frame in order, seconds on the file's clock.
    pub(crate) fn times(&self) -> &[f64] {
        &self.clock.times
    }

    /// Frames a second; `None` for a single frame.
    pub(crate) fn rate(&self) -> Option<f64> {
        self.clock.rate
    }

    /// The frames that are decoded together with this one.
    pub(crate) fn group_of(&self, frame: usize) -> Range<usize> {
        let next = self.entries.partition_point(|&entry| entry <= frame);
        self.group(next.saturating_sub(1))
    }

    /// The frames of the group with this number.
    pub(super) fn group(&self, number: usize) -> Range<usize> {
        let end = self.entries.get(number + 1).copied();
        self.entries[number]..end.unwrap_or(self.stamps.len())
    }

    pub(crate) fn is_missing(&self, frame: usize) -> Error {
        Error::video_decode(self.path(), format!("frame {frame} could not be decoded"))
    }

    /// Calls `on_frame` with the frames of a range, in order.
    ///
    /// # Errors
    /// When `ffmpeg` is missing, cannot decode the file or gives fewer frames, or `on_frame` fails.
    pub(crate) fn decode(
        &self,
        range: Range<usize>,
        on_frame: impl FnMut(usize, VideoFrame) -> Result<(), Error>,
    ) -> Result<(), Error> {
        self.decode_scaled(range, None, on_frame)
    }

    /// [`decode`](Self::decode) with frames scaled to this width and height.
    ///
    /// # Errors
    /// Those of [`decode`](Self::decode).
    pub(super) fn decode_scaled(
        &self,
        range: Range<usize>,
        size: Option<[usize; 2]>,
        mut on_frame: impl FnMut(usize, VideoFrame) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let mut next = range.start;
        let part = Portion {
            size,
            ..self.part(range.clone())
        };
        let found = decode(&self.track, &part, |frame| {
            on_frame(next, frame)?;
            next += 1;
            Ok(())
        })?;
        if found == range.len() {
            return Ok(());
        }
        Err(Error::video_decode(
            self.path(),
            format!(
                "expected {} frames from number {} on, found {found}",
                range.len(),
                range.start
            ),
        ))
    }

    /// What `ffmpeg` is to be told so that it gives these frames.
    pub(super) fn part(&self, range: Range<usize>) -> Portion {
        if range.is_empty() || range.end > self.stamps.len() {
            return Portion::default();
        }
        let number = self.entries.partition_point(|&entry| entry <= range.start);
        let number = number.saturating_sub(1);
        Portion {
            seek: self.seek(self.entries[number]),
            max_frames: Some(range.len()),
            // What is damaged is not even read.
            max_packets: self.sound.as_ref().map(|sound| sound[number]),
            frames: match self.is_timed {
                true => Which::Times(self.span(&range)),
                false => Which::Numbers(range),
            },
            ..Portion::default()
        }
    }

    /// The time from half-way before the first to half-way behind the last frame: times are rounded on their way.
    fn span(&self, range: &Range<usize>) -> [f64; 2] {
        let last = range.end - 1;
        let before = range.start.checked_sub(1);
        [
            self.secs(range.start) - self.margin(range.start, before),
            self.secs(last) + self.margin(last, Some(range.end)),
        ]
    }

    /// Seconds into the file, a moment after the key frame that is this entry.
    fn seek(&self, entry: usize) -> Option<f64> {
        let start = self.track.start.unwrap_or_else(|| self.secs(0));
        let after = self.margin(entry, Some(entry + 1)).min(0.01);
        (entry > 0).then(|| self.secs(entry) - start + after)
    }

    /// Half the time to a neighbour.
    fn margin(&self, frame: usize, neighbour: Option<usize>) -> f64 {
        let neighbour = neighbour.filter(|&n| n < self.stamps.len());
        neighbour.map_or(1.0, |n| (self.secs(n) - self.secs(frame)).abs() / 2.0)
    }

    /// A frame's stamp in seconds.
    fn secs(&self, frame: usize) -> f64 {
        self.stamps[frame] as f64 * self.track.unit.value()
    }
}

#[cfg(test)]
mod tests {
    use super::super::probe::{packets_of, track};
    use super::*;

    /// A row of a listing: when it is shown, when it is decoded, flags.
    type Row = (Option<i64>, Option<i64>, &'static str);

    fn shown(pts: i64, dts: i64, flags: &'static str) -> Row {
        (Some(pts), Some(dts), flags)
    }

    fn index(rows: &[Row]) -> VideoIndex {
        let packets = packets_of(rows).expect("a listing");
        VideoIndex::new(track("a.mp4"), (4, 2), &packets)
    }

    #[test]
    fn groups_begin_at_key_frames() {
        // Shown order 0 100 200 | 300 400 ms: the second picture of the file is shown third.
        let index = index(&[
            shown(0, -9, "K__"),
            shown(200, 0, "___"),
            shown(100, 1, "___"),
            shown(300, 2, "K__"),
            shown(400, 3, "___"),
        ]);
        assert_eq!((index.n_frames(), index.rate()), (5, Some(10.0)));
        for (frame, group) in [(0, 0..3), (2, 0..3), (3, 3..5), (4, 3..5)] {
            assert_eq!(index.group_of(frame), group);
        }
        let part = index.part(3..5);
        assert!(part.seek.is_some_and(|at| at > 0.3 && at < 0.35));
        let Which::Times([from, to]) = part.frames else {
            panic!("{part:?}");
        };
        assert!(from > 0.2 && from < 0.3 && to > 0.4);
        assert_eq!(index.part(0..3).seek, None);
    }

    #[test]
    fn a_key_frame_behind_what_is_shown_before_it_begins_no_group() {
        // An open group: the picture at 200 ms comes after the key frame of 300 ms.
        let index = index(&[
            shown(0, 0, "K__"),
            shown(100, 1, "___"),
            shown(300, 2, "K__"),
            shown(200, 3, "___"),
        ]);
        assert_eq!(index.group_of(3), 0..4);
    }

    #[test]
    fn pictures_that_are_not_shown_do_not_count() {
        let index = index(&[
            shown(-100, 0, "KD_"),
            shown(0, 1, "___"),
            shown(100, 2, "K__"),
        ]);
        assert_eq!(index.n_frames(), 2);
        assert_eq!(index.group_of(0), 0..1);
    }

    #[test]
    fn without_presentation_times_frames_are_counted_from_the_beginning() {
        let index = index(&[
            (None, Some(0), "K_"),
            shown(40, 40, "__"),
            (None, Some(80), "K_"),
            (None, Some(120), "__"),
        ]);
        assert_eq!(index.times(), [0.0, 0.04, 0.08, 0.12]);
        assert_eq!(index.group_of(3), 0..4);
        let part = index.part(2..4);
        assert_eq!((part.seek, part.frames), (None, Which::Numbers(2..4)));
    }

    #[test]
    fn listings_without_frames_or_times_are_refused() {
        let untimed = (None, None, "K__");
        for rows in [&[][..], &[untimed], &[shown(0, 0, "K__"), untimed]] {
            assert!(packets_of(rows).is_err(), "{rows:?}");
        }
    }
}
