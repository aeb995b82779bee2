//! Where the frames of a video are: presentation times and groups of pictures, as `ffprobe` lists them.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::decode::{Part, VideoFrame, decode, frame_size};
use super::error::reading;
use super::ffmpeg::{ffprobe, file_argument, output};
use crate::Error;
use crate::files::refuse_pointer_file;

/// Frames of one file are refused beyond this: 46 hours at 60 frames a second.
const MAX_FRAMES: usize = 10_000_000;

/// The frames of a video file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct VideoIndex {
    path: PathBuf,
    /// Width and height of its frames.
    size: (usize, usize),
    /// Presentation time of each frame in order, seconds on the file's clock.
    times: Vec<f64>,
    /// The file's clock where it begins.
    start: f64,
    /// Frames at which a group of pictures starts; begins with 0.
    pub(super) entries: Vec<usize>,
    /// Presentation times in the order of the file.
    pub(super) packets: Vec<f64>,
    /// Of a damaged video, for each entry how many coded pictures from there on decode.
    pub(super) sound: Option<Vec<usize>>,
}

/// A coded picture as the file has it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Packet {
    time: f64,
    is_key: bool,
}

impl VideoIndex {
    /// Reads the file's index and decodes the first picture, which may be damaged with `skip_broken`.
    ///
    /// # Errors
    /// When `ffprobe` or `ffmpeg` is missing, or the file is no video.
    pub(crate) fn read(path: &Path, skip_broken: bool) -> Result<Self, Error> {
        refuse_pointer_file(path, "a video")?;
        let listing = probe(path)?;
        let (packets, start) = parse(&listing).map_err(|what| Error::video_decode(path, what))?;
        let size = frame_size(path, skip_broken)?;
        Ok(Self::new(path, size, &packets, start))
    }

    fn new(path: &Path, size: (usize, usize), packets: &[Packet], start: Option<f64>) -> Self {
        let mut times: Vec<f64> = packets.iter().map(|packet| packet.time).collect();
        times.sort_by(f64::total_cmp);
        let mut entries = vec![0];
        for (place, packet) in packets.iter().enumerate().filter(|(_, p)| p.is_key) {
            // Pictures that follow a key frame in the file but are shown before it need the group before.
            let shown_before = |later: &Packet| later.time < packet.time;
            let after = packets[place + 1..].iter().take_while(|p| !p.is_key);
            if place > 0 && !after.into_iter().any(shown_before) {
                entries.push(times.partition_point(|&time| time < packet.time));
            }
        }
        entries.sort_unstable();
        entries.dedup();
        Self {
            path: path.to_path_buf(),
            size,
            start: start.unwrap_or_else(|| times.first().copied().unwrap_or(0.0)),
            times,
            entries,
            packets: packets.iter().map(|packet| packet.time).collect(),
            sound: None,
        }
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Width and height of the frames.
    pub(crate) fn size(&self) -> (usize, usize) {
        self.size
    }

    pub(crate) fn n_frames(&self) -> usize {
        self.times.len()
    }

    /// Presentation time of each frame in order, seconds on the file's clock.
    pub(crate) fn times(&self) -> &[f64] {
        &self.times
    }

    /// The frames that are decoded together with this one.
    pub(crate) fn group_of(&self, frame: usize) -> Range<usize> {
        let next = self.entries.partition_point(|&entry| entry <= frame);
        self.group(next.saturating_sub(1))
    }

    /// The frames of the group with this number.
    pub(super) fn group(&self, number: usize) -> Range<usize> {
        let end = self.entries.get(number + 1).copied();
        self.entries[number]..end.unwrap_or(self.times.len())
    }

    pub(crate) fn is_missing(&self, frame: usize) -> Error {
        Error::video_decode(&self.path, format!("frame {frame} could not be decoded"))
    }

    /// Calls `on_frame` with the frames of a range, in order.
    ///
    /// # Errors
    /// When `ffmpeg` is missing, cannot decode the file or gives fewer frames, or `on_frame` fails.
    pub(crate) fn decode(
        &self,
        range: Range<usize>,
        mut on_frame: impl FnMut(usize, VideoFrame) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let mut next = range.start;
        let found = decode(&self.path, &self.part(range.clone()), |frame| {
            on_frame(next, frame)?;
            next += 1;
            Ok(())
        })?;
        if found == range.len() {
            return Ok(());
        }
        Err(Error::video_decode(
            &self.path,
            format!(
                "expected {} frames from number {} on, found {found}",
                range.len(),
                range.start
            ),
        ))
    }

    /// What `ffmpeg` is to be told so that it gives these frames.
    pub(super) fn part(&self, range: Range<usize>) -> Part {
        let (Some(&first), Some(&last)) = (
            self.times.get(range.start),
            range.end.checked_sub(1).and_then(|end| self.times.get(end)),
        ) else {
            return Part::default();
        };
        // Half-way to the neighbours: times are rounded on their way.
        let margin = |frame: usize, neighbour: Option<usize>| {
            let gap = neighbour.and_then(|n| Some((self.times.get(n)? - self.times[frame]).abs()));
            gap.map_or(1.0, |gap| gap / 2.0)
        };
        let before = margin(range.start, range.start.checked_sub(1));
        let after = margin(range.end - 1, Some(range.end));
        let number = self.entries.partition_point(|&entry| entry <= range.start);
        let number = number.saturating_sub(1);
        let entry = self.entries[number];
        let seek = (entry > 0).then(|| {
            let key = self.times[entry] - self.start;
            key + margin(entry, Some(entry + 1)).min(0.01)
        });
        Part {
            seek,
            times: Some([first - before, last + after]),
            max_frames: Some(range.len()),
            // What is damaged is not even read.
            max_packets: self.sound.as_ref().map(|sound| sound[number]),
            lenient: false,
        }
    }
}

fn probe(path: &Path) -> Result<String, Error> {
    let mut command = ffprobe();
    command
        .args(["-protocol_whitelist", "file", "-select_streams", "v:0"])
        .args(["-show_entries", "packet=pts_time,flags:format=start_time"])
        .args(["-of", "csv"])
        .arg(file_argument(path));
    output(&mut command).map_err(reading(path))
}

/// Lines such as `packet,0.033333,K__` in the order of the file, and `format,0.000000`.
fn parse(listing: &str) -> Result<(Vec<Packet>, Option<f64>), String> {
    let mut packets = Vec::new();
    let mut start = None;
    for line in listing.lines() {
        let mut fields = line.trim().split(',');
        match (fields.next(), fields.next(), fields.next()) {
            (Some("packet"), Some(time), Some(flags)) => {
                // Pictures that only others need, from before the clip's beginning.
                if flags.contains('D') {
                    continue;
                }
                let time: f64 = time
                    .parse()
                    .ok()
                    .filter(|time: &f64| time.is_finite())
                    .ok_or("its pictures have no times; put it into an MP4 file")?;
                packets.push(Packet {
                    time,
                    is_key: flags.contains('K'),
                });
            }
            (Some("format"), Some(time), _) => start = time.parse().ok(),
            _ => {}
        }
        if packets.len() > MAX_FRAMES {
            return Err(format!("it has more than {MAX_FRAMES} frames"));
        }
    }
    if packets.is_empty() {
        return Err("it has no frames".into());
    }
    Ok((packets, start.filter(|start: &f64| start.is_finite())))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn index(listing: &str) -> VideoIndex {
        let (packets, start) = parse(listing).expect("a listing");
        VideoIndex::new(Path::new("a.mp4"), (4, 2), &packets, start)
    }

    #[test]
    fn groups_begin_at_key_frames() {
        // Shown order 0.0 0.1 0.2 | 0.3 0.4: the second picture of the file is shown third.
        let index = index(
            "packet,0.0,K__\npacket,0.2,___\npacket,0.1,___\npacket,0.3,K__\npacket,0.4,___\nformat,0.0\n",
        );
        assert_eq!(index.n_frames(), 5);
        for (frame, group) in [(0, 0..3), (2, 0..3), (3, 3..5), (4, 3..5)] {
            assert_eq!(index.group_of(frame), group);
        }
        let part = index.part(3..5);
        assert!(part.seek.is_some_and(|at| at > 0.3 && at < 0.35));
        let [from, to] = part.times.expect("stated");
        assert!(from > 0.2 && from < 0.3 && to > 0.4);
        assert_eq!(index.part(0..3).seek, None);
    }

    #[test]
    fn a_key_frame_behind_what_is_shown_before_it_begins_no_group() {
        // An open group: the picture at 0.2 comes after the key frame of 0.3.
        let index = index("packet,0.0,K__\npacket,0.1,___\npacket,0.3,K__\npacket,0.2,___\n");
        assert_eq!(index.group_of(3), 0..4);
    }

    #[test]
    fn pictures_that_are_not_shown_do_not_count() {
        let index = index("packet,-0.1,KD_\npacket,0.0,___\npacket,0.1,K__\n");
        assert_eq!(index.n_frames(), 2);
        assert_eq!(index.group_of(0), 0..1);
    }

    #[test]
    fn listings_without_frames_or_times_are_refused() {
        for listing in ["", "format,0.0\n", "packet,N/A,K__\n", "packet,nan,K__\n"] {
            assert!(parse(listing).is_err(), "{listing:?}");
        }
    }
}
