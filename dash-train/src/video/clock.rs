//! When the frames of a recording were taken.
//!
//! A file states times as whole multiples of a unit, which may be as coarse as a millisecond (Matroska, WebM) or a
//! frame (AVI). So at 30 frames a second, Matroska has 0, 33, 67, 100. A constant rate is therefore looked for that
//! gives every stamp of the file when it is rounded; then frame k is at k / rate exactly. All of it is done in whole
//! numbers. Where no rate fits, frames are at their stamps.

use super::stamps::{self, MISSING, gaps};
use crate::numbers::median;

/// Some files keep the roundings to milliseconds of the file that they were copied from.
const COPIED_ROUNDING_SECS: f64 = 1.1e-3;
/// Numerator of the largest rate that is looked for.
const MAX_RATE: i128 = 1_000_000;

/// A positive fraction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Ratio {
    pub(super) n: i128,
    pub(super) d: i128,
}

impl Ratio {
    /// Parses `30000/1001`; `None` unless both numbers are positive and of a sensible size.
    pub(super) fn parse(text: &str, divider: char) -> Option<Self> {
        let (n, d) = text.split_once(divider)?;
        let whole = |text: &str| text.trim().parse::<i32>().ok().filter(|v| *v > 0);
        Some(Self {
            n: whole(n)?.into(),
            d: whole(d)?.into(),
        })
    }

    pub(super) fn value(self) -> f64 {
        self.n as f64 / self.d as f64
    }

    fn equals(self, other: Self) -> bool {
        self.n * other.d == other.n * self.d
    }

    /// Whether somebody would choose it as a frame rate: a multiple of 1/100, or of 1000/1001.
    fn is_usual(self) -> bool {
        (self.n * 100) % self.d == 0 || (self.n * 1001) % (self.d * 1000) == 0
    }
}

/// The times of a recording's frames.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Clock {
    /// Of each frame in order, seconds on the file's clock.
    pub(super) times: Vec<f64>,
    /// Frames a second; `None` for a single frame.
    pub(super) rate: Option<f64>,
}

/// The clock of frames with these ascending stamps in units of `unit` seconds, in a file that states `stated` frames a
/// second.
pub(super) fn clock(stamps: &[i64], unit: Ratio, stated: Option<Ratio>) -> Clock {
    let secs = |stamp: i64| stamp as f64 * unit.n as f64 / unit.d as f64;
    let from_stamps: Vec<f64> = stamps.iter().map(|&stamp| secs(stamp)).collect();
    let Some(grid) = grid(stamps, unit, stated) else {
        return Clock {
            rate: uneven_rate(&from_stamps),
            times: from_stamps,
        };
    };
    let first = from_stamps.first().copied().unwrap_or(0.0);
    let time = |place: &i128| first + (place * grid.rate.d) as f64 / grid.rate.n as f64;
    Clock {
        times: grid.places.iter().map(time).collect(),
        rate: Some(grid.rate.value()),
    }
}

/// The rate of frames that keep to none: on average where they are nearly even, else of most of them.
fn uneven_rate(times: &[f64]) -> Option<f64> {
    let span = times.last()? - times.first()?;
    let all: Vec<usize> = (0..times.len()).collect();
    let period = match stamps::uneven(times, &all) {
        None => span / (times.len() - 1).max(1) as f64,
        Some(_) => median(gaps(times))?,
    };
    (period > 0.0).then(|| 1.0 / period)
}

/// Frames at a constant rate.
#[derive(Debug)]
struct Grid {
    rate: Ratio,
    /// Of each frame, how many periods it is after the first. Numbers are missing where frames are.
    places: Vec<i128>,
    /// How far apart the errors of the stamps are, in units of time.
    spread: f64,
}

/// The constant rate that the stamps are rounded times of, if there is one. Rates that the file states go first, then
/// usual ones, then what the stamps themselves give.
fn grid(stamps: &[i64], unit: Ratio, stated: Option<Ratio>) -> Option<Grid> {
    let common = common_step(stamps, unit);
    let likely = stated.filter(|rate| rate.is_usual() || common.is_some_and(|c| c.equals(*rate)));
    let usual = usual_rates(stamps, unit);
    let copied = COPIED_ROUNDING_SECS / unit.value();
    for (limit, is_own) in [(1.0, true), (copied.max(1.5), false)] {
        let fitting = |rate: Option<Ratio>| fit(stamps, unit, rate?, limit);
        let best = || {
            let fits = usual.iter().filter_map(|&rate| fitting(Some(rate)));
            fits.min_by(|a, b| a.spread.total_cmp(&b.spread))
        };
        let of_stamps = || fitting(common.filter(|_| is_own));
        let other = || fitting(stated.filter(|_| is_own));
        let found = fitting(likely).or_else(best).or_else(of_stamps);
        if let Some(grid) = found.or_else(other) {
            return Some(grid);
        }
    }
    None
}

/// The rate at which each frame is one greatest common divisor of all steps after the last.
fn common_step(stamps: &[i64], unit: Ratio) -> Option<Ratio> {
    let step = stamps.windows(2).fold(0, |divisor, pair| {
        gcd(divisor, i128::from(pair[1]) - i128::from(pair[0]))
    });
    let d = unit.n.checked_mul(step)?;
    (step > 0).then_some(Ratio { n: unit.d, d })
}

fn gcd(a: i128, b: i128) -> i128 {
    let (mut a, mut b) = (a.abs(), b.abs());
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// The usual rates next to the average of frames that follow each other.
fn usual_rates(stamps: &[i64], unit: Ratio) -> Vec<Ratio> {
    let ticks: Vec<f64> = stamps.iter().map(|&stamp| stamp as f64).collect();
    let Some(usual) = median(gaps(&ticks)) else {
        return Vec::new();
    };
    let followed: Vec<f64> = gaps(&ticks).filter(|gap| *gap <= MISSING * usual).collect();
    let rate = followed.len() as f64 / followed.iter().sum::<f64>() / unit.value();
    let near = |n: f64, d: f64| Ratio {
        n: ((rate * d / n).round() * n) as i128,
        d: d as i128,
    };
    let rates = [near(1.0, 1.0), near(1000.0, 1001.0), near(1.0, 2.0)];
    let is_sensible = |rate: &Ratio| (1..=MAX_RATE).contains(&rate.n);
    rates.into_iter().filter(is_sensible).collect()
}

/// The frames at this rate, if most follow each other and their stamps are off by at most `limit` units of time, and
/// by less than a frame.
fn fit(stamps: &[i64], unit: Ratio, rate: Ratio, limit: f64) -> Option<Grid> {
    // Units of time per frame, as a fraction.
    let (n, d) = (unit.d.checked_mul(rate.d)?, unit.n.checked_mul(rate.n)?);
    let first = i128::from(*stamps.first()?);
    let mut places: Vec<i128> = Vec::with_capacity(stamps.len());
    let (mut least, mut most) = (0, 0);
    for &stamp in stamps {
        let after = (i128::from(stamp) - first).checked_mul(d)?;
        let place = after
            .checked_mul(2)?
            .checked_add(n)?
            .div_euclid(n.checked_mul(2)?);
        if places.last().is_some_and(|last| *last >= place) {
            return None;
        }
        let error = after - place * n;
        (least, most) = (error.min(least), error.max(most));
        places.push(place);
    }
    let n_steps = places.len() - 1;
    let followed = places.windows(2).filter(|pair| pair[1] - pair[0] == 1);
    let spread = (most - least) as f64 / d as f64;
    let is_within = spread <= limit && most - least < n;
    (n_steps > 0 && 2 * followed.count() >= n_steps && is_within).then_some(Grid {
        rate,
        places,
        spread,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ratio(n: i128, d: i128) -> Ratio {
        Ratio { n, d }
    }

    /// Stamps of frames at `rate` from `start` seconds on, rounded to the nearest unit.
    fn rounded(
        frames: impl Iterator<Item = u32>,
        rate: Ratio,
        unit: Ratio,
        start: f64,
    ) -> Vec<i64> {
        let secs = |frame: u32| start + f64::from(frame) / rate.value();
        frames
            .map(|frame| (secs(frame) / unit.value()).round() as i64)
            .collect()
    }

    #[track_caller]
    fn assert_rate(clock: &Clock, rate: Ratio, context: &str) {
        let found = clock.rate.unwrap_or(0.0);
        assert!(found == rate.value(), "{found} for {rate:?}: {context}");
    }

    const USUAL: [(i128, i128); 14] = [
        (1, 1),
        (25, 2),
        (15, 1),
        (24000, 1001),
        (24, 1),
        (25, 1),
        (30000, 1001),
        (30, 1),
        (50, 1),
        (60000, 1001),
        (60, 1),
        (100, 1),
        (120, 1),
        (240, 1),
    ];

    #[test]
    fn the_rate_is_found_behind_the_rounding_of_any_unit() {
        for unit in [(1, 1000), (1, 90_000), (1, 600), (1, 48_000), (1, 15_360)] {
            let unit = ratio(unit.0, unit.1);
            for rate in USUAL.map(|(n, d)| ratio(n, d)) {
                for (n, start) in [(12, 0.0), (301, 0.0), (301, 1.4), (90, -0.08)] {
                    let stamps = rounded(0..n, rate, unit, start);
                    let context = format!("{n} frames from {start} in {unit:?}");
                    let clock = clock(&stamps, unit, Some(rate));
                    assert_rate(&clock, rate, &context);
                    let first = stamps[0] as f64 * unit.value();
                    for (frame, time) in clock.times.iter().enumerate() {
                        let exact = first + frame as f64 / rate.value();
                        assert!((time - exact).abs() < 1e-9, "{frame} {rate:?}: {context}");
                    }
                }
            }
        }
    }

    #[test]
    fn long_recordings_need_no_stated_rate() {
        for rate in USUAL.map(|(n, d)| ratio(n, d)) {
            for stated in [None, Some(ratio(19_001, 317)), Some(ratio(90_000, 1))] {
                let stamps = rounded(0..3000, rate, ratio(1, 1000), 0.0);
                let clock = clock(&stamps, ratio(1, 1000), stated);
                assert_rate(&clock, rate, &format!("{stated:?}"));
            }
        }
    }

    #[test]
    fn missing_frames_leave_the_others_in_their_places() {
        for rate in [
            ratio(24, 1),
            ratio(30_000, 1001),
            ratio(60, 1),
            ratio(120, 1),
        ] {
            let kept = || (0..200).filter(|k| ![7, 8, 90].contains(k));
            let stamps = rounded(kept(), rate, ratio(1, 1000), 0.0);
            // What ffprobe states counts the frames that are there.
            let clock = clock(&stamps, ratio(1, 1000), Some(ratio(4925, 100)));
            assert_rate(&clock, rate, "some are missing");
            for (time, frame) in clock.times.iter().zip(kept()) {
                assert!((time - f64::from(frame) / rate.value()).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn odd_rates_are_those_of_the_stamps() {
        // Written with the rate's own period as the unit, and stated so.
        for (n, d) in [(17_310, 1001), (1_000_000, 33_367), (7, 3)] {
            let stamps: Vec<i64> = (0..500).collect();
            let clock = clock(&stamps, ratio(d, n), Some(ratio(n, d)));
            assert_rate(&clock, ratio(n, d), "its own unit");
        }
    }

    #[test]
    fn roundings_of_a_file_that_was_copied_are_seen_through() {
        let unit = ratio(1, 16_000);
        for rate in [ratio(24, 1), ratio(30, 1), ratio(60, 1)] {
            let in_millis = rounded(0..12, rate, ratio(1, 1000), 0.0);
            let stamps: Vec<i64> = in_millis.iter().map(|stamp| 16 * stamp).collect();
            let clock = clock(&stamps, unit, Some(ratio(38_400, 1279)));
            assert_rate(&clock, rate, "copied");
        }
    }

    #[test]
    fn frames_at_no_constant_rate_are_at_their_stamps() {
        let stamps = [0, 20, 41, 59, 80, 140, 163, 179, 230, 240];
        let unit = ratio(1, 600);
        let clock = clock(&stamps, unit, Some(ratio(30, 1)));
        let secs: Vec<f64> = stamps.iter().map(|&stamp| stamp as f64 / 600.0).collect();
        assert_eq!(clock.times, secs);
        // Most follow the last after 20 or 21 units.
        assert!(clock.rate.is_some_and(|rate| (25.0..35.0).contains(&rate)));
    }

    #[test]
    fn few_or_hostile_stamps() {
        let unit = ratio(1, 1000);
        assert_eq!(clock(&[5], unit, None).rate, None);
        assert_eq!(clock(&[5], unit, Some(ratio(30, 1))).times, [0.005]);
        for stamps in [[0, 0, 0], [i64::MIN, 0, i64::MAX], [7, 7, 9]] {
            let clock = clock(&stamps, unit, Some(ratio(i32::MAX.into(), 1)));
            assert!(
                clock.times.len() == 3 && clock.times.is_sorted(),
                "{stamps:?}"
            );
            assert!(clock.rate.is_none_or(|rate| rate > 0.0 && rate.is_finite()));
        }
        for text in ["", "1", "0/1", "1/0", "-1/2", "1/99999999999", "a/b"] {
            assert_eq!(Ratio::parse(text, '/'), None, "{text}");
        }
        assert_eq!(Ratio::parse("30000/1001", '/'), Some(ratio(30_000, 1001)));
    }
}
