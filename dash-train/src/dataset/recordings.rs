//! The videos of a synchronised rig: which of a video's frames shows which time.

use std::collections::BTreeMap;
use std::sync::Arc;

use rayon::prelude::*;

use super::broken::keep_readable;
use super::plan::{Context, PlannedView};
use super::sources::{RigCamera, at_size, same_count};
use super::video::VideoIndex;
use super::view::Split;
use super::{DatasetError, frame_time, frames};

/// Frames of different videos are of one time if their presentation times differ by no more than this
/// share of the time between frames.
const SAME_TIME: f64 = 0.25;

/// The views of all cameras at all wanted frames, camera by camera, and the number of frames. With
/// `skip_broken`, without the cameras whose video can't be read, and without the frames that a damaged
/// video has lost.
///
/// # Errors
/// When a video can't be read, or they differ in their frames, or in their shape from the poses.
pub(super) fn plan(
    context: &Context,
    cameras: &[RigCamera],
    held_out: &[bool],
) -> Result<(Vec<PlannedView>, usize), DatasetError> {
    let skip_broken = context.options.skip_broken;
    let videos = read(context, cameras)?;
    let Some(reference) = reference(cameras, &videos, skip_broken) else {
        return Ok((Vec::new(), 0));
    };
    let numbers: Vec<u64> = (0..).take(reference.1.n_frames()).collect();
    let kept = context.options.wanted(&numbers)?;
    let matched = cameras.iter().zip(&videos).map(|(camera, video)| {
        let found = match video {
            None => Ok(None),
            Some(video) => frames_of_times(reference, (camera, video), skip_broken).map(Some),
        };
        (format!("camera {}", camera.source.name), found)
    });
    let matched = keep_readable(matched.collect(), skip_broken, context.broken.as_ref())?;
    let mut planned = Vec::with_capacity(kept.len() * cameras.len());
    for (camera_index, ((rig_camera, video), matched)) in
        cameras.iter().zip(&videos).zip(matched).enumerate()
    {
        let (Some(video), Some(frames)) = (video, matched.flatten()) else {
            continue;
        };
        let source = &rig_camera.source;
        let (camera, lens) = at_size(rig_camera, video.size(), &source.path)?;
        for (frame, &index) in kept.iter().enumerate() {
            let Some(own) = frames[index] else { continue };
            planned.push(PlannedView {
                source: frames::Source::Video {
                    video: video.clone(),
                    frame: own,
                },
                name: format!("{}/{index:04}", source.name),
                camera_name: source.name.clone(),
                camera_index,
                frame,
                time: frame_time(frame, kept.len()),
                split: Split::held_out(held_out[camera_index]),
                camera: camera.clone(),
                lens: lens.clone(),
                mask: None,
            });
        }
    }
    Ok((planned, kept.len()))
}

/// The indices of all videos; with `skip_broken`, `None` for those that can't be read.
fn read(
    context: &Context,
    cameras: &[RigCamera],
) -> Result<Vec<Option<Arc<VideoIndex>>>, DatasetError> {
    let skip_broken = context.options.skip_broken;
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
    keep_readable(read, skip_broken, context.broken.as_ref())
}

/// The video that says which frames there are: the first, or where some may be damaged the first of
/// those that have the commonest number of frames (of equally common ones, the greatest).
fn reference<'a>(
    cameras: &'a [RigCamera],
    videos: &'a [Option<Arc<VideoIndex>>],
    skip_broken: bool,
) -> Option<(&'a RigCamera, &'a VideoIndex)> {
    let mut readable = cameras
        .iter()
        .zip(videos)
        .filter_map(|(camera, video)| Some((camera, video.as_deref()?)));
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    for (_, video) in readable.clone() {
        *counts.entry(video.n_frames()).or_default() += 1;
    }
    let commonest = counts.iter().max_by_key(|&(n, count)| (count, n))?.0;
    readable.find(|(_, video)| !skip_broken || video.n_frames() == *commonest)
}

/// For each frame of the reference the frame of a video that is of its time. A video with other frames
/// is an error, unless it is to be skipped what is broken and it only lacks some.
fn frames_of_times(
    reference: (&RigCamera, &VideoIndex),
    (camera, video): (&RigCamera, &VideoIndex),
    skip_broken: bool,
) -> Result<Vec<Option<usize>>, DatasetError> {
    let n = reference.1.n_frames();
    let same = same_count(&reference.0.source, n, &camera.source, video.n_frames());
    match same {
        Ok(()) => Ok((0..n).map(Some).collect()),
        Err(error) if !skip_broken => Err(error),
        Err(error) => {
            let frames = by_times(reference.1.times(), video.times()).ok_or(error)?;
            tracing::warn!(
                "{}: {} of {n} frames are missing",
                camera.source.path.display(),
                n - video.n_frames(),
            );
            Ok(frames)
        }
    }
}

/// For each of the times the place of the same one in `found`; `None` if any of these has no counterpart.
fn by_times(times: &[f64], found: &[f64]) -> Option<Vec<Option<usize>>> {
    let gap = times
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .fold(f64::INFINITY, f64::min);
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
}
