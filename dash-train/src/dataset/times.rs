//! From the times that files state to frames and times in [0, 1].

use super::options::LoadOptions;
use crate::Error;

/// Times closer than this are one frame.
const SAME_TIME: f64 = 1e-6;
/// Clocks of different cameras jitter: times within this share of one camera's frame interval are one frame,
const JITTER: f64 = 0.02;
/// if frames are as many times farther apart. Monocular captures have evenly spaced times instead.
const APART: f64 = 10.0;
/// Stated times that cover this share of [0, 1] stay as they are: some captures end before 1 (frame / n). Others
/// are stretched, since the deformation field and its losses take the clip to span [0, 1].
const WHOLE_CLIP: f64 = 0.9;

/// A time in [0, 1] for each of `n` evenly spaced frames; 0 for a single one.
pub(crate) fn frame_time(frame: usize, n: usize) -> f32 {
    if n > 1 {
        (frame as f64 / (n - 1) as f64) as f32
    } else {
        0.0
    }
}

/// The time in [0, 1] of each of the frames with these numbers, as far apart as the numbers; `None` where
/// these don't rise.
pub(crate) fn of_numbers(numbers: &[u64]) -> Option<Vec<f32>> {
    let (first, last) = (*numbers.first()?, *numbers.last()?);
    if !numbers.is_sorted_by(|a, b| a < b) {
        return None;
    }
    let span = (last - first).max(1) as f64;
    let time = |number: &u64| ((number - first) as f64 / span) as f32;
    Some(numbers.iter().map(time).collect())
}

/// The frame and time of each image.
#[derive(Debug)]
pub(crate) struct Placement {
    /// For each image its frame's index and its time in [0, 1]; `None` where the frame is not wanted.
    pub(crate) pictures: Vec<Option<(usize, f32)>>,
    /// How many distinct times are wanted.
    pub(crate) n_frames: usize,
    /// The first and the last wanted time as stated, where these were stretched over [0, 1].
    pub(crate) stated_span: Option<[f64; 2]>,
}

/// The tolerance within which `stated` times are one frame; `camera_of` has the index of each one's camera.
pub(crate) fn same_time(stated: &[f64], camera_of: &[usize]) -> f64 {
    let mut sorted: Vec<(usize, f64)> = camera_of
        .iter()
        .copied()
        .zip(stated.iter().copied())
        .collect();
    sorted.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let steps = sorted.windows(2).filter(|pair| pair[0].0 == pair[1].0);
    let step = steps
        .map(|pair| pair[1].1 - pair[0].1)
        .filter(|&step| step >= SAME_TIME);
    let jitter = JITTER * step.fold(f64::INFINITY, f64::min);
    if !jitter.is_finite() {
        return SAME_TIME;
    }
    let mut all: Vec<f64> = stated.to_vec();
    all.sort_by(f64::total_cmp);
    let frames = all.chunk_by(|a, b| b - a < jitter);
    let ends: Vec<[f64; 2]> = frames
        .map(|times| [times[0], times[times.len() - 1]])
        .collect();
    let longest = ends
        .iter()
        .map(|[first, last]| last - first)
        .fold(0.0, f64::max);
    let apart = ends
        .windows(2)
        .all(|pair| pair[1][0] - pair[0][1] >= APART * jitter);
    if apart && (SAME_TIME..jitter).contains(&longest) {
        jitter
    } else {
        SAME_TIME
    }
}

/// The frame and time of each image with a finite `stated` time. Times in [0, 1] that cover [`WHOLE_CLIP`] of it
/// are kept. Others, and those of a part of the frames, are stretched over [0, 1]; a single one is 0.
///
/// # Errors
/// When none of them is wanted.
pub(crate) fn frames(options: &LoadOptions, stated: &[f64]) -> Result<Placement, Error> {
    frames_within(options, stated, SAME_TIME)
}

/// [`frames`] with a tolerance: times that differ by less than `same_time` are one frame. Where that is more than
/// rounding, all of its images get the earliest time.
///
/// # Errors
/// When none of them is wanted.
pub(crate) fn frames_within(
    options: &LoadOptions,
    stated: &[f64],
    same_time: f64,
) -> Result<Placement, Error> {
    let mut all: Vec<f64> = stated.to_vec();
    all.sort_by(f64::total_cmp);
    all.dedup_by(|later, earlier| *later - *earlier < same_time);
    let index_of = |time: f64, all: &[f64]| all.partition_point(|&t| t <= time).saturating_sub(1);
    let numbers: Vec<u64> = (0..).take(all.len()).collect();
    let wanted = options.wanted(&numbers)?;
    let kept: Vec<f64> = wanted.iter().map(|&index| all[index]).collect();
    let n_frames = kept.len();
    let (Some(&start), Some(&end)) = (kept.first(), kept.last()) else {
        return Ok(Placement {
            pictures: vec![None; stated.len()],
            n_frames: 0,
            stated_span: None,
        });
    };
    let in_unit = start >= 0.0 && end <= 1.0 && end - start >= WHOLE_CLIP;
    let as_stated = all.len() == n_frames && in_unit;
    let place = |&time: &f64| {
        if wanted.binary_search(&index_of(time, &all)).is_err() {
            return None;
        }
        let index = index_of(time, &kept);
        let time = if same_time > SAME_TIME {
            kept[index]
        } else {
            time
        };
        let unit = match (n_frames, as_stated) {
            (1, _) => 0.0,
            (_, true) => time,
            (_, false) => (time - start) / (end - start),
        };
        Some((index, unit.clamp(0.0, 1.0) as f32))
    };
    Ok(Placement {
        pictures: stated.iter().map(place).collect(),
        n_frames,
        stated_span: (n_frames > 1 && !as_stated).then_some([start, end]),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bit for bit: what trained on these times before must train to the same.
    #[test]
    fn numbers_that_are_evenly_spaced_give_the_times_of_their_places() {
        for n in [2, 3, 7, 50, 300, 1200] {
            for (first, stride) in [(0, 1), (0, 2), (1, 1), (151, 1), (10, 7), (1, 1000)] {
                let numbers: Vec<u64> = (0..n).map(|k| first + k * stride).collect();
                let even: Vec<u32> = (0..n as usize)
                    .map(|k| frame_time(k, n as usize).to_bits())
                    .collect();
                let times = of_numbers(&numbers).expect("rising");
                let times: Vec<u32> = times.into_iter().map(f32::to_bits).collect();
                assert_eq!(times, even, "{n} from {first} in steps of {stride}");
            }
        }
        assert_eq!(of_numbers(&[0, 4, 5]), Some(vec![0.0, 0.8, 1.0]));
        assert_eq!(of_numbers(&[7]), Some(vec![0.0]));
        assert_eq!(of_numbers(&[1, 2, 1]), None);
    }

    fn frame_of(stated: &[f64], camera_of: &[usize]) -> (Vec<usize>, Vec<f32>) {
        let same_time = same_time(stated, camera_of);
        let placed = frames_within(&LoadOptions::default(), stated, same_time).expect("all");
        placed.pictures.into_iter().flatten().unzip()
    }

    #[test]
    fn cameras_whose_clocks_jitter_see_the_same_frames() {
        let stated = [
            0.0001, 0.5, 0.9999, 0.0, 0.5002, 1.0, 0.0002, 0.5001, 1.0001,
        ];
        let camera_of = [0, 0, 0, 1, 1, 1, 2, 2, 2];
        let (frames, times) = frame_of(&stated, &camera_of);
        assert_eq!(frames, [0, 1, 2, 0, 1, 2, 0, 1, 2]);
        assert_eq!(times[..3], [0.0, 0.5, 0.9999]);
        assert_eq!(times[..3], times[3..6]);
    }

    #[test]
    fn cameras_that_take_turns_keep_their_times() {
        // A hundred cameras, each with a hundredth of a step more than the one before.
        let (stated, camera_of): (Vec<f64>, Vec<usize>) = (0..300)
            .map(|picture| (f64::from(picture) / 299.0, picture as usize % 100))
            .unzip();
        let (frames, times) = frame_of(&stated, &camera_of);
        assert!(frames.into_iter().eq(0..300));
        assert!(times.iter().zip(&stated).all(|(&t, &s)| t == s as f32));
        // Rounding leaves times as they are.
        let rounded = [0.0, 1.0, 4e-7, 1.0 - 4e-7];
        let (frames, times) = frame_of(&rounded, &[0, 0, 1, 1]);
        assert_eq!(
            (frames, times),
            (vec![0, 1, 0, 1], rounded.map(|t| t as f32).into())
        );
        // One camera that is carried along: every picture has a pose of its own.
        let carried: Vec<usize> = (0..4).collect();
        let stated = [0.0, 0.0005, 0.5, 1.0];
        assert_eq!(frame_of(&stated, &carried).0, [0, 1, 2, 3]);
    }

    #[test]
    fn times_of_a_part_of_the_unit_are_stretched_and_those_of_a_whole_clip_are_kept() {
        let placed = |stated: &[f64]| {
            let placed = frames(&LoadOptions::default(), stated).expect("all");
            let times: Vec<f32> = placed.pictures.into_iter().flatten().map(|p| p.1).collect();
            (times, placed.stated_span)
        };
        // Seconds of a short clip; the first frames of a longer one.
        let stretched = (vec![0.0, 0.5, 1.0], Some([0.0, 0.5]));
        assert_eq!(placed(&[0.0, 0.25, 0.5]), stretched);
        let stretched = (vec![0.0, 0.5, 1.0], Some([0.25, 0.75]));
        assert_eq!(placed(&[0.25, 0.5, 0.75]), stretched);
        let stretched = (vec![0.0, 1.0], Some([2.0, 7.0]));
        assert_eq!(placed(&[2.0, 7.0]), stretched);
        // Bit for bit as stated.
        for kept in [[0.0, 0.3, 0.983_240_223_463_687_1], [0.05, 0.5, 0.96]] {
            assert_eq!(placed(&kept), (kept.map(|t| t as f32).into(), None));
        }
        assert_eq!(placed(&[0.4, 0.4]), (vec![0.0, 0.0], None));
        assert_eq!(placed(&[]), (vec![], None));
        let first = LoadOptions {
            max_frames: Some(2),
            ..LoadOptions::default()
        };
        let some = frames(&first, &[0.0, 0.5, 1.0]).expect("two");
        assert_eq!((some.n_frames, some.stated_span), (2, Some([0.0, 0.5])));
    }
}
