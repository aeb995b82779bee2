//! Time stamps of videos: whether frames are evenly spaced, and whether two videos show the same times.
//!
//! Stamps that don't rise are ignored. Stamps count from the first frame, since their start depends on the
//! program that wrote the file.

use crate::numbers::median;

/// Stamps agree if they differ by at most this share of the median frame interval.
const TOLERANCE: f64 = 0.5;
/// Frames are missing where an interval is more than this many times the median.
pub(super) const MISSING: f64 = 1.5;

/// The times in [0, 1] of some frames by their stamps; `None` if the stamps agree with even steps.
pub(crate) fn uneven(stamps: &[f64], places: &[usize]) -> Option<Vec<f32>> {
    let tolerance = TOLERANCE * usual_gap(stamps)?;
    let (start, end) = (stamps[*places.first()?], stamps[*places.last()?]);
    let step = (end - start) / (places.len() - 1).max(1) as f64;
    let is_off = |(k, &place): (usize, &usize)| {
        let even = start + k as f64 * step;
        (stamps[place] - even).abs() > tolerance
    };
    let time = |&place: &usize| ((stamps[place] - start) / (end - start)) as f32;
    let is_uneven = places.iter().enumerate().any(is_off);
    is_uneven.then(|| places.iter().map(time).collect())
}

/// The first frame at which the stamps of two videos of equal length disagree.
pub(crate) fn first_apart(reference: &[f64], stamps: &[f64]) -> Option<usize> {
    let tolerance = TOLERANCE * usual_gap(reference)?;
    usual_gap(stamps)?;
    let (begin, start) = (reference.first()?, stamps.first()?);
    let mut pairs = reference.iter().zip(stamps);
    pairs.position(|(wanted, found)| ((found - start) - (wanted - begin)).abs() > tolerance)
}

/// The frame rates of two videos, if they drift apart over the clip by more than the tolerance.
pub(crate) fn rates_apart(reference: &[f64], stamps: &[f64]) -> Option<[f64; 2]> {
    let (wanted, found) = (rate(reference)?, rate(stamps)?);
    let frames_apart = (found / wanted - 1.0).abs() * stamps.len() as f64;
    (frames_apart > TOLERANCE).then_some([wanted, found])
}

/// Frames per second, without the intervals in which frames are missing.
fn rate(stamps: &[f64]) -> Option<f64> {
    let longest = MISSING * usual_gap(stamps)?;
    let whole: Vec<f64> = gaps(stamps).filter(|gap| *gap <= longest).collect();
    Some(whole.len() as f64 / whole.iter().sum::<f64>())
}

/// The median frame interval; `None` if stamps don't rise, or there is one frame.
fn usual_gap(stamps: &[f64]) -> Option<f64> {
    if stamps.len() < 2 || !stamps.is_sorted_by(|a, b| a < b) {
        return None;
    }
    median(gaps(stamps))
}

pub(super) fn gaps(stamps: &[f64]) -> impl Iterator<Item = f64> {
    stamps.windows(2).map(|pair| pair[1] - pair[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    const NTSC: f64 = 30_000.0 / 1001.0;

    /// Stamps in units of a 600th of a second, rounded to as many digits as the program that lists them gives.
    fn stamps(ticks: impl IntoIterator<Item = u32>, digits: i32) -> Vec<f64> {
        let unit = 10f64.powi(digits);
        let rounded = |tick: u32| (f64::from(tick) / 600.0 * unit).round() / unit;
        ticks.into_iter().map(rounded).collect()
    }

    #[test]
    fn evenly_spaced_stamps_give_no_times_of_their_own() {
        let all: Vec<usize> = (0..300).collect();
        let sparse: Vec<usize> = (10..300).step_by(7).collect();
        let chosen: [&[usize]; 5] = [&all, &sparse, &[5], &[5, 9], &[]];
        for fps in [24.0, 25.0, NTSC, 30.0, 2.0 * NTSC, 120.0] {
            for (start, unit) in [(0.0, 1e6), (0.0, 1e3), (1.4, 1e6), (-0.08, 1e3)] {
                let stamp = |k: &usize| ((start + *k as f64 / fps) * unit).round() / unit;
                let stamps: Vec<f64> = all.iter().map(stamp).collect();
                for places in chosen {
                    assert_eq!(uneven(&stamps, places), None, "{fps} from {start}");
                }
            }
        }
        // Less than half a frame early or late.
        let jitter = stamps((0..100).map(|k| 100 + 20 * k + (k * 7) % 9), 6);
        let all: Vec<usize> = (0..100).collect();
        assert_eq!(uneven(&jitter, &all), None);
    }

    #[test]
    fn times_are_as_far_apart_as_uneven_stamps() {
        let stamps = stamps([60, 80, 240, 260, 360], 6);
        let times = uneven(&stamps, &[0, 1, 2, 3, 4]).expect("uneven");
        for (time, expected) in times.iter().zip([0.0, 1.0 / 15.0, 0.6, 2.0 / 3.0, 1.0]) {
            assert!((f64::from(*time) - expected).abs() < 1e-5, "{times:?}");
        }
        let times = uneven(&stamps, &[1, 2, 3]).expect("uneven");
        assert_eq!((times[0], times[2]), (0.0, 1.0));
        assert!((f64::from(times[1]) - 8.0 / 9.0).abs() < 1e-5, "{times:?}");
        assert_eq!(uneven(&stamps, &[1, 3]), None);
    }

    #[test]
    fn stamps_that_do_not_rise_tell_nothing() {
        let even = stamps((0..4).map(|k| 20 * k), 6);
        let unreliable: [&[f64]; 3] = [&[0.0, 0.5, 0.5, 0.6], &[0.0, 0.2, 0.1, 0.9], &[0.0]];
        for bad in unreliable {
            let places: Vec<usize> = (0..bad.len()).collect();
            assert_eq!(uneven(bad, &places), None);
            assert_eq!(first_apart(&even, bad), None);
            assert_eq!(first_apart(bad, &even), None);
            assert_eq!(rates_apart(&even, bad), None);
        }
    }

    #[test]
    fn a_lost_frame_tells_videos_apart_and_their_beginning_does_not() {
        let even = stamps((0..23).map(|k| 20 * k), 6);
        let later = stamps((0..23).map(|k| 840 + 20 * k), 3);
        assert_eq!(first_apart(&even, &later), None);
        let lost = stamps((0..24).filter(|k| *k != 5).map(|k| 20 * k), 6);
        assert_eq!(first_apart(&even, &lost), Some(5));
        assert_eq!(first_apart(&lost, &even), Some(5));
        assert_eq!(rates_apart(&even, &lost), None);
        let half = stamps((0..23).map(|k| 20 * k + (k % 2) * 9), 6);
        assert_eq!(first_apart(&even, &half), None);
        let more = stamps((0..23).map(|k| 20 * k + (k % 2) * 11), 6);
        assert_eq!(first_apart(&even, &more), Some(1));
    }

    #[test]
    fn rates_are_those_of_frames_that_follow_each_other() {
        let of_30 = stamps((0..24).filter(|k| *k != 5).map(|k| 20 * k), 3);
        let of_60 = stamps((0..23).map(|k| 10 * k), 6);
        let [wanted, found] = rates_apart(&of_30, &of_60).expect("twice as many");
        assert!((wanted - 30.0).abs() < 0.1 && (found - 60.0).abs() < 0.01);
        let ntsc: Vec<f64> = (0..900).map(|k| f64::from(k) / NTSC).collect();
        let of_30 = stamps((0..900).map(|k| 20 * k), 6);
        assert!(rates_apart(&of_30, &ntsc).is_some());
        assert_eq!(rates_apart(&of_30[..400], &ntsc[..400]), None);
    }
}
