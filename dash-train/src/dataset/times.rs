//! From the times that files state to frames and times in [0, 1].

use super::LoadOptions;

/// Times closer than this are one frame's.
const SAME_TIME: f64 = 1e-6;

/// The frame index and time in [0, 1] of each finite `stated` time, `None` where its frame is not
/// wanted; and the number of distinct times that are. Times are kept where they lie in [0, 1]
/// already, and stretched over [0, 1] otherwise and when only some of the frames are loaded.
pub(super) fn frames(options: &LoadOptions, stated: &[f64]) -> (Vec<Option<(usize, f32)>>, usize) {
    let mut all: Vec<f64> = stated.to_vec();
    all.sort_by(f64::total_cmp);
    all.dedup_by(|later, earlier| *later - *earlier < SAME_TIME);
    let index_of = |time: f64, all: &[f64]| all.partition_point(|&t| t <= time).saturating_sub(1);
    let kept: Vec<f64> = (0..all.len())
        .filter(|&index| options.keeps_frame(index))
        .map(|index| all[index])
        .collect();
    let n_frames = kept.len();
    let (Some(&start), Some(&end)) = (kept.first(), kept.last()) else {
        return (vec![None; stated.len()], 0);
    };
    let in_unit = all.len() == n_frames && start >= 0.0 && end <= 1.0;
    let place = |&time: &f64| {
        if !options.keeps_frame(index_of(time, &all)) {
            return None;
        }
        let unit = match (n_frames, in_unit) {
            (1, _) => 0.0,
            (_, true) => time,
            (_, false) => (time - start) / (end - start),
        };
        Some((index_of(time, &kept), unit.clamp(0.0, 1.0) as f32))
    };
    (stated.iter().map(place).collect(), n_frames)
}
