//! From the times that files state to frames and times in [0, 1].

use super::{DatasetError, LoadOptions};

/// Times closer than this are one frame's.
const SAME_TIME: f64 = 1e-6;

/// For each picture its frame's index and its time in [0, 1]; `None` where the frame is not wanted.
type Placed = Vec<Option<(usize, f32)>>;

/// The frame index and time in [0, 1] of each finite `stated` time, `None` where its frame is not
/// wanted; and the number of distinct times that are. Times are kept where they lie in [0, 1]
/// already, and stretched over [0, 1] otherwise and when only some of the frames are loaded.
///
/// # Errors
/// When none of them is wanted.
pub(super) fn frames(
    options: &LoadOptions,
    stated: &[f64],
) -> Result<(Placed, usize), DatasetError> {
    let mut all: Vec<f64> = stated.to_vec();
    all.sort_by(f64::total_cmp);
    all.dedup_by(|later, earlier| *later - *earlier < SAME_TIME);
    let index_of = |time: f64, all: &[f64]| all.partition_point(|&t| t <= time).saturating_sub(1);
    let numbers: Vec<u64> = (0..).take(all.len()).collect();
    let wanted = options.wanted(&numbers)?;
    let kept: Vec<f64> = wanted.iter().map(|&index| all[index]).collect();
    let n_frames = kept.len();
    let (Some(&start), Some(&end)) = (kept.first(), kept.last()) else {
        return Ok((vec![None; stated.len()], 0));
    };
    let in_unit = all.len() == n_frames && start >= 0.0 && end <= 1.0;
    let place = |&time: &f64| {
        if wanted.binary_search(&index_of(time, &all)).is_err() {
            return None;
        }
        let unit = match (n_frames, in_unit) {
            (1, _) => 0.0,
            (_, true) => time,
            (_, false) => (time - start) / (end - start),
        };
        Some((index_of(time, &kept), unit.clamp(0.0, 1.0) as f32))
    };
    Ok((stated.iter().map(place).collect(), n_frames))
}
