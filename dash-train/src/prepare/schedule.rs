//! When frames are taken: the range that all cameras cover, sampled at one rate.

use crate::Error;
use crate::numbers::median;

/// Times are equal within this, in seconds.
const SAME_SECS: f64 = 1e-4;
/// Share of a frame's duration by which the range may fall short of the last frame.
const LAST_FRAME_SLACK: f64 = 1e-3;
/// The most frames that are written per camera.
const MAX_FRAMES: f64 = 1e6;

/// Share of a frame's duration within which a frame is that of a time: half would do, but clocks are not exact.
const NEAR: f64 = 0.75;

/// Two frames are equally near to a time within this, in seconds. Then the earlier one is taken.
const TIE_SECS: f64 = 1e-6;

/// The times at which a camera recorded.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Timeline {
    /// Seconds in the recording's own time, which begins with its first frame; ascending, at least one.
    pub(super) times: Vec<f64>,
    /// Frames a second; `None` for a single frame.
    pub(super) rate: Option<f64>,
    /// How much later the recording's own time is than the rig's, in seconds.
    pub(super) offset: f64,
}

impl Timeline {
    /// That of images at these times.
    pub(super) fn of_images(times: Vec<f64>, offset: f64) -> Self {
        let steps = times.windows(2).map(|pair| pair[1] - pair[0]);
        Self {
            rate: median(steps.filter(|step| *step > 0.0)).map(f64::recip),
            times,
            offset,
        }
    }

    /// The index of the frame nearest to a time of the rig.
    pub(super) fn nearest(&self, time: f64) -> usize {
        let own = time + self.offset;
        let after = self.times.partition_point(|&t| t < own);
        match after {
            0 => 0,
            n if n == self.times.len() => n - 1,
            n if own - self.times[n - 1] <= self.times[n] - own + TIE_SECS => n - 1,
            n => n,
        }
    }

    /// Whether a frame was recorded near a time of the rig.
    pub(super) fn has(&self, time: f64) -> bool {
        let off = (self.times[self.nearest(time)] - time - self.offset).abs();
        self.rate.is_none_or(|rate| off * rate <= NEAR)
    }

    fn range(&self) -> [f64; 2] {
        let first = self.times.first().copied().unwrap_or(0.0);
        let last = self.times.last().copied().unwrap_or(0.0);
        [first - self.offset, last - self.offset]
    }
}

/// Which part of the recordings is wanted.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Wanted {
    pub(super) fps: Option<f64>,
    pub(super) start: Option<f64>,
    pub(super) end: Option<f64>,
}

/// The times at which every camera's frames are taken.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Schedule {
    /// The first, in seconds of the rig's time.
    pub(super) start: f64,
    /// Frames a second.
    pub(super) fps: f64,
    /// Number of frames.
    pub(super) n_frames: usize,
    /// What was cut off, camera by camera, and other remarks; for the user.
    pub(super) remarks: Vec<String>,
}

impl Schedule {
    /// The time of a frame, in seconds of the rig's time.
    pub(super) fn time(&self, frame: usize) -> f64 {
        self.start + frame as f64 / self.fps
    }
}

/// The schedule over the range that all cameras cover. `names` and `timelines` go together.
pub(super) fn schedule(
    names: &[String],
    timelines: &[Timeline],
    wanted: Wanted,
) -> Result<Schedule, Error> {
    let mut remarks = Vec::new();
    let rates = || timelines.iter().filter_map(|timeline| timeline.rate);
    let slowest = rates().fold(f64::INFINITY, f64::min);
    let fastest = rates().fold(0.0, f64::max);
    let fps = match wanted.fps {
        Some(fps) => {
            if fps > slowest * (1.0 + LAST_FRAME_SLACK) {
                remarks.push(format!(
                    "--fps {fps} is more than the {slowest:.2} frames a second that were recorded: some frames are \
                     repeated"
                ));
            }
            fps
        }
        None if slowest.is_finite() => slowest,
        None => 1.0,
    };
    if wanted.fps.is_none() && fastest > slowest * (1.0 + LAST_FRAME_SLACK) {
        remarks.push(format!(
            "the cameras record {slowest:.2} to {fastest:.2} frames a second: the lowest rate is taken"
        ));
    }
    let ranges: Vec<[f64; 2]> = timelines.iter().map(Timeline::range).collect();
    let latest = |a: &(usize, f64), b: &(usize, f64)| a.1.total_cmp(&b.1);
    let starts = ranges.iter().map(|range| range[0]).enumerate();
    let ends = ranges.iter().map(|range| range[1]).enumerate();
    let (last_to_start, common_start) = starts.max_by(latest).unwrap_or((0, 0.0));
    let (first_to_end, common_end) = ends.min_by(latest).unwrap_or((0, 0.0));
    let start = wanted
        .start
        .map_or(common_start, |start| start.max(common_start));
    let end = wanted.end.map_or(common_end, |end| end.min(common_end));
    if end < start - SAME_SECS {
        return Err(Error::setting(
            "--start, --end, --offsets",
            "a range of time that every camera has recorded",
            format!(
                "nothing between {start:.3} s and {end:.3} s: {} begins at {common_start:.3} s and {} ends \
                 at {common_end:.3} s",
                name(names, last_to_start),
                name(names, first_to_end)
            ),
        ));
    }
    let count = ((end - start).max(0.0) * fps + LAST_FRAME_SLACK).floor() + 1.0;
    if count > MAX_FRAMES {
        return Err(Error::setting(
            "--fps",
            format!("at most {MAX_FRAMES} frames"),
            format!("{count} between {start:.3} s and {end:.3} s"),
        ));
    }
    remarks.extend(cuts(names, &ranges, [start, end], fps));
    let mut schedule = Schedule {
        start,
        fps,
        n_frames: count as usize,
        remarks,
    };
    let gaps = gaps(names, timelines, &schedule);
    schedule.remarks.extend(gaps);
    Ok(schedule)
}

/// One line on times at which cameras recorded nothing.
fn gaps(names: &[String], timelines: &[Timeline], schedule: &Schedule) -> Option<String> {
    let missing = |timeline: &Timeline| {
        let frames = 0..schedule.n_frames;
        frames
            .filter(|&frame| !timeline.has(schedule.time(frame)))
            .count()
    };
    let with_gaps: Vec<String> = timelines
        .iter()
        .enumerate()
        .map(|(index, timeline)| (name(names, index), missing(timeline)))
        .filter(|(_, n)| *n > 0)
        .map(|(name, n)| format!("{name} has none at {n} of {} times", schedule.n_frames))
        .collect();
    (!with_gaps.is_empty()).then(|| {
        format!(
            "frames that were not recorded are left out: {}",
            with_gaps.join(", ")
        )
    })
}

/// One line on what is cut off where the cameras' recordings differ.
fn cuts(names: &[String], ranges: &[[f64; 2]], [start, end]: [f64; 2], fps: f64) -> Option<String> {
    let frames = |secs: f64| (secs * fps + LAST_FRAME_SLACK).floor();
    let cut: Vec<String> = ranges
        .iter()
        .enumerate()
        .filter_map(|(index, range)| {
            let (before, after) = (frames(start - range[0]), frames(range[1] - end));
            (before > 0.0 || after > 0.0).then(|| {
                format!(
                    "{} {before} at the start and {after} at the end",
                    name(names, index)
                )
            })
        })
        .collect();
    const SHOWN: usize = 6;
    let more = match cut.len().saturating_sub(SHOWN) {
        0 => String::new(),
        n => format!(", and {n} more cameras"),
    };
    (!cut.is_empty()).then(|| {
        format!(
            "cut to {start:.3} .. {end:.3} s, which all cameras have; frames cut off: {}{more}",
            cut[..cut.len().min(SHOWN)].join(", ")
        )
    })
}

fn name(names: &[String], index: usize) -> &str {
    names.get(index).map_or("", String::as_str)
}
