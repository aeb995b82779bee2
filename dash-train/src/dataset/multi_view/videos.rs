//! The videos of a synchronised rig: which of a video's frames shows which time.

use std::collections::BTreeMap;
use std::sync::Arc;

use rayon::prelude::*;

use super::Plan;
use super::camera::{RigCamera, same_count};
use crate::Error;
use crate::dataset::loader::{Loader, PlannedView};
use crate::dataset::partition::Partition;
use crate::dataset::pixels::frames::Source;
use crate::dataset::pixels::sizes::Sizes;
use crate::dataset::times::frame_time;
use crate::video::{VideoIndex, stamps};

/// Frames of different videos show one time if their time stamps differ by at most this share of the frame
/// interval,
const SAME_TIME: f64 = 0.25;
/// and different times from this share on. Anything between fits neither.
const OTHER_TIME: f64 = 1.0 - SAME_TIME;
/// Videos with equal frame counts are matched by time stamp if this share of the frames has a counterpart. Twice
/// the rate would leave half.
const MOST: f64 = 0.75;

/// A camera and the index of its video.
type Recording<'a> = (&'a RigCamera, &'a VideoIndex);

/// The views of all cameras at all wanted frames. With `skip_broken`,
/// unreadable videos and the lost frames of damaged ones are left out. Frames are evenly spaced in time, unless
/// the time stamps of the reference video differ.
///
/// # Errors
/// When a video can't be read, videos differ in their frames or times, or frames differ in shape from the poses.
pub(super) fn plan(
    loader: &Loader,
    cameras: &[RigCamera],
    held_out: &[bool],
) -> Result<Plan, Error> {
    let skip_broken = loader.options.skip_broken;
    let videos = read(loader, cameras)?;
    let Some(reference) = reference(cameras, &videos, skip_broken) else {
        return Ok(Plan {
            views: Vec::new(),
            n_frames: 0,
            frame_rate: None,
        });
    };
    let numbers: Vec<u64> = (0..).take(reference.1.n_frames()).collect();
    let kept = loader.options.wanted(&numbers)?;
    let times = times(reference, &kept);
    let matched = cameras.iter().zip(&videos).map(|(camera, video)| {
        let found = match video {
            None => Ok(None),
            Some(video) => frames_of_times(loader, reference, (camera, video)).map(Some),
        };
        (format!("camera {}", camera.source.name), found)
    });
    let matched = loader.broken.keep_readable(matched.collect())?;
    let mut planned = Vec::with_capacity(kept.len() * cameras.len());
    let mut sizes = Sizes::default();
    for (camera_index, ((rig_camera, video), matched)) in
        cameras.iter().zip(&videos).zip(matched).enumerate()
    {
        let (Some(video), Some(frames)) = (video, matched.flatten()) else {
            continue;
        };
        let source = &rig_camera.source;
        let (camera, lens) = rig_camera.at_size(video.size(), &source.path, &mut sizes)?;
        for (frame, (&index, &time)) in kept.iter().zip(&times).enumerate() {
            let Some(own) = frames[index] else { continue };
            planned.push(PlannedView {
                source: Source::Video {
                    video: video.clone(),
                    frame: own,
                },
                name: format!("{}/{index:04}", source.name),
                camera_name: source.name.clone(),
                camera_index,
                frame,
                time,
                partition: Partition::held_out(held_out[camera_index]),
                camera: camera.clone(),
                lens: lens.clone(),
                mask: None,
            });
        }
    }
    sizes.warn_of_stretched();
    Ok(Plan {
        views: planned,
        n_frames: kept.len(),
        frame_rate: frame_rate(reference.1.times(), &kept),
    })
}

/// The indices of all videos; with `skip_broken`, `None` for those that can't be read.
fn read(loader: &Loader, cameras: &[RigCamera]) -> Result<Vec<Option<Arc<VideoIndex>>>, Error> {
    let skip_broken = loader.options.skip_broken;
    let read = cameras
        .par_iter()
        .map(|camera| {
            let video = VideoIndex::read(&camera.source.path, skip_broken);
            (
                format!("camera {}", camera.source.name),
                video.map(Arc::new),
            )
        })
        .collect();
    loader.broken.keep_readable(read)
}

/// The reference video, which defines the frames: the first whose time stamps agree with at least half of the
/// videos. With `skip_broken`, only videos of the commonest frame count qualify (of equally common ones the
/// greatest).
fn reference<'a>(
    cameras: &'a [RigCamera],
    videos: &'a [Option<Arc<VideoIndex>>],
    skip_broken: bool,
) -> Option<Recording<'a>> {
    let readable = cameras
        .iter()
        .zip(videos)
        .filter_map(|(camera, video)| Some((camera, video.as_deref()?)));
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    for (_, video) in readable.clone() {
        *counts.entry(video.n_frames()).or_default() += 1;
    }
    let commonest = *counts.iter().max_by_key(|&(n, count)| (count, n))?.0;
    let complete: Vec<Recording> = readable
        .filter(|(_, video)| !skip_broken || video.n_frames() == commonest)
        .collect();
    let n_agreeing = |(_, video): &Recording| {
        let agrees =
            |(_, other): &&Recording| stamps::first_apart(video.times(), other.times()).is_none();
        complete.iter().filter(agrees).count()
    };
    let of_half = complete
        .iter()
        .find(|recording| 2 * n_agreeing(recording) >= complete.len());
    // Reversed, since `max_by_key` takes the last of equals.
    let of_most = || {
        complete
            .iter()
            .rev()
            .max_by_key(|recording| n_agreeing(recording))
    };
    of_half.or_else(of_most).copied()
}

/// Frames per second of those that are kept, by their time stamps in seconds; `None` of a single one.
fn frame_rate(stamps: &[f64], kept: &[usize]) -> Option<f64> {
    let secs = stamps[*kept.last()?] - stamps[*kept.first()?];
    (secs > 0.0).then(|| (kept.len() - 1) as f64 / secs)
}

/// The times in [0, 1] of the frames of the reference that are kept.
fn times((camera, video): Recording, kept: &[usize]) -> Vec<f32> {
    let Some(times) = stamps::uneven(video.times(), kept) else {
        return (0..kept.len())
            .map(|frame| frame_time(frame, kept.len()))
            .collect();
    };
    tracing::info!(
        "{}: its frames are not evenly spaced; their times are those of its time stamps",
        camera.source.path.display(),
    );
    times
}

/// For each frame of the reference the frame of a video at the same time. Other frames or times are an error;
/// with `skip_broken`, a video may lack some frames.
fn frames_of_times(
    loader: &Loader,
    reference: Recording,
    (camera, video): Recording,
) -> Result<Vec<Option<usize>>, Error> {
    let n = reference.1.n_frames();
    let (times, found) = (reference.1.times(), video.times());
    let (error, frames) = match same_count(&reference.0.source, n, &camera.source, found.len()) {
        Err(error) => (error, by_times(times, found)),
        Ok(()) => match stamps::first_apart(times, found) {
            None => return Ok((0..n).map(Some).collect()),
            Some(frame) => {
                let frames = by_stamps(times, found);
                let lacks_some = frames.is_some();
                (apart(reference, (camera, video), frame, lacks_some), frames)
            }
        },
    };
    let (true, Some(frames)) = (loader.options.skip_broken, frames) else {
        return Err(error);
    };
    let n_missing = frames.iter().filter(|frame| frame.is_none()).count();
    tracing::warn!(
        "{}: {n_missing} of {n} frames are missing",
        camera.source.path.display(),
    );
    loader.broken.note(error);
    Ok(frames)
}

/// The error for a video whose time stamps differ from the reference's from this frame on.
fn apart(
    (first, reference): Recording,
    (camera, video): Recording,
    frame: usize,
    lacks_some: bool,
) -> Error {
    let (path, first) = (&camera.source.path, &first.source.name);
    let (times, found) = (reference.times(), video.times());
    let hundredths = |rate: f64| (rate * 100.0).round() / 100.0;
    let rates = stamps::rates_apart(times, found).filter(|_| !lacks_some);
    if let Some([wanted, own]) = rates
        && hundredths(wanted) != hundredths(own)
    {
        let slower = (own / wanted * 1e5).round() / 1e5;
        return Error::invalid(
            path,
            format!("{} frames per second, as {first} has", hundredths(wanted)),
            format!("{}, and as many frames", hundredths(own)),
            format!(
                "let `dash prepare` take frames of the same times, or, where it is this file's time \
                 stamps that are wrong, write them anew (`ffmpeg -itsscale {slower} -i OLD -c copy NEW`)"
            ),
        );
    }
    let mend = if lacks_some {
        "leave out what one lacks (--skip-broken), or let `dash prepare` take frames of the same times"
    } else {
        "let `dash prepare` take frames of the same times, or leave this camera out"
    };
    Error::invalid(
        path,
        format!(
            "frame {frame} at {:.3} s from the first, as {first} has",
            times[frame] - times[0]
        ),
        format!("{:.3} s by its time stamps", found[frame] - found[0]),
        mend,
    )
}

/// [`by_times`] with times counted from the first frame of each. Frames of `found` at other times are left out;
/// `None` if they are many.
fn by_stamps(times: &[f64], found: &[f64]) -> Option<Vec<Option<usize>>> {
    let shift = times.first()? - found.first()?;
    let gap = least_gap(times);
    let is_near = |time: f64| {
        let next = times.partition_point(|&t| t < time);
        let around = &times[next.saturating_sub(1)..times.len().min(next + 1)];
        around.iter().any(|t| (t - time).abs() < OTHER_TIME * gap)
    };
    let (places, near): (Vec<usize>, Vec<f64>) = found
        .iter()
        .map(|time| time + shift)
        .enumerate()
        .filter(|&(_, time)| is_near(time))
        .unzip();
    let frames = by_times(times, &near)?;
    let is_most = near.len() as f64 >= MOST * times.len() as f64;
    is_most.then(|| {
        let own = |place: Option<usize>| place.map(|place| places[place]);
        frames.into_iter().map(own).collect()
    })
}

/// For each of the times its index in `found`; `None` if any time of `found` has no counterpart.
fn by_times(times: &[f64], found: &[f64]) -> Option<Vec<Option<usize>>> {
    let gap = least_gap(times);
    let mut frames = vec![None; times.len()];
    for (place, time) in found.iter().enumerate() {
        let next = times.partition_point(|t| t < time);
        let is_same = |&index: &usize| (times[index] - time).abs() <= SAME_TIME * gap;
        let mut near = (next.saturating_sub(1)..times.len().min(next + 1)).filter(is_same);
        let slot = &mut frames[near.next()?];
        if slot.replace(place).is_some() {
            return None;
        }
    }
    Some(frames)
}

fn least_gap(times: &[f64]) -> f64 {
    let gaps = times.windows(2).map(|pair| pair[1] - pair[0]);
    gaps.fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_that_are_missing_leave_the_others_at_their_times() {
        let times: Vec<f64> = (0..6).map(|i| 0.04 * f64::from(i)).collect();
        let start = vec![Some(0), Some(1), Some(2), None, None, None];
        assert_eq!(by_times(&times, &[0.0, 0.04, 0.081]), Some(start));
        let gaps = vec![None, None, Some(0), None, Some(1), Some(2)];
        assert_eq!(by_times(&times, &[0.08, 0.16, 0.2]), Some(gaps));
        assert_eq!(by_times(&times, &[]), Some(vec![None; 6]));
        // Between two times, behind the last, two of one time.
        for found in [[0.0, 0.02], [0.2, 0.24], [0.04, 0.041]] {
            assert_eq!(by_times(&times, &found), None, "{found:?}");
        }
        assert_eq!(by_times(&[0.0], &[]), Some(vec![None]));
    }

    #[test]
    fn stamps_match_frames_beside_those_that_either_video_lacks() {
        let at = |frames: &[u32]| -> Vec<f64> {
            let time = |frame: &u32| 0.04 * f64::from(*frame);
            frames.iter().map(time).collect()
        };
        let times = at(&[0, 1, 2, 3, 4, 5, 6, 7]);
        // Later on its own clock, without frame 2, with one more at the end.
        let found = at(&[5, 6, 8, 9, 10, 11, 12, 13]);
        let expected: Vec<Option<usize>> = [0, 1, 9, 2, 3, 4, 5, 6]
            .map(|place| (place != 9).then_some(place))
            .into();
        assert_eq!(by_stamps(&times, &found), Some(expected));
        // The other way round: the frame that the reference lacks is left out, and its last one is missing.
        let expected: Vec<Option<usize>> = [0, 1, 3, 4, 5, 6, 7, 9]
            .map(|place| (place != 9).then_some(place))
            .into();
        assert_eq!(by_stamps(&found, &times), Some(expected));
        // Half, twice and four fifths of the rate; half a frame off.
        let scaled = |factor: f64| -> Vec<f64> { times.iter().map(|t| factor * t).collect() };
        for found in [scaled(2.0), scaled(0.5), scaled(1.25)] {
            assert_eq!(by_stamps(&times, &found), None, "{found:?}");
        }
        let mut off = at(&[0, 1, 2, 3, 4, 5, 6, 7]);
        off[3] += 0.02;
        assert_eq!(by_stamps(&times, &off), None);
    }
}
