//! Interpolation and extrapolation over time gaps.

use dash_model::{DynamicScene, Gaps, OffsetPlacement};

use crate::common::{deformed, devices, largest_difference, scene, with_large_offsets};

/// A position inside a gap, and the agreement on its turn. `known` are the positions before the gap, at both of its ends and
/// after it; the gap is `longer` times the time between two of them.
fn inside_a_gap(known: [[f64; 3]; 4], longer: f64, share: f64) -> ([f64; 3], f64) {
    let minus = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] { std::array::from_fn(|k| a[k] - b[k]) };
    let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
    let [before, from, to, after] = known;
    let way = minus(to, from);
    let arrives = minus(from, before).map(|v| v * longer);
    let leaves = minus(after, to).map(|v| v * longer);
    let change = minus(arrives, leaves);
    let old = (dot(minus(way, leaves), change) / dot(change, change)).clamp(0.0, 1.0);
    let both: [f64; 3] = std::array::from_fn(|k| old * arrives[k] + (1.0 - old) * leaves[k]);
    let miss = minus(way, both);
    let off = change.map(|v| old * (1.0 - old) * v);
    let agree = match dot(off, off) {
        0.0 => 0.0,
        square => (1.0 - dot(miss, miss) / square).clamp(0.0, 1.0),
    };
    let tent = agree * (share * (1.0 - old)).min(old * (1.0 - share));
    let place = std::array::from_fn(|k| from[k] + share * way[k] + tent * change[k]);
    (place, agree)
}

#[test]
fn means_are_extrapolated_beyond_the_first_and_last_time_seen() {
    for device in devices() {
        let seen = with_large_offsets(scene(
            6,
            Some(9),
            OffsetPlacement::BeforeActivation,
            &device,
        ));
        let mut ended = seen.clone();
        ended.settings.gaps = Gaps::between([0.25, 0.375, 0.5, 0.625, 0.75], 1.5);
        for time in [0.25, 0.3, 0.5, 0.75] {
            assert_eq!(deformed(&ended, time), deformed(&seen, time), "{time}");
        }
        for (time, edge, mirrored) in [(0.9, 0.75, 0.6), (1.0, 0.75, 0.5), (0.125, 0.25, 0.375)] {
            let [mut expected, before] = [edge, mirrored].map(|time| deformed(&seen, time));
            for (mean, before) in expected[0].iter_mut().zip(&before[0]) {
                *mean = 2.0 * *mean - before;
            }
            let found = deformed(&ended, time);
            assert_eq!(found[1..], expected[1..], "{time}");
            let error = largest_difference(&found[0], &expected[0]);
            assert!(error <= 1e-6, "{time}: {error}");
            let other = deformed(&seen, time);
            assert!(
                largest_difference(&other[0], &expected[0]) > 1e-3,
                "the field alone gives other means"
            );
        }
    }
}

#[test]
fn inside_a_gap_means_go_straight_or_turn_once() {
    for device in devices() {
        for offsets in [
            OffsetPlacement::BeforeActivation,
            OffsetPlacement::AfterActivation,
        ] {
            let seen = with_large_offsets(scene(6, Some(9), offsets, &device));
            let mut bridged = seen.clone();
            bridged.settings.gaps = Gaps::between([0.0, 0.125, 0.25, 0.75, 0.875, 1.0], 1.5);
            assert_eq!(bridged.settings.gaps.len(), 1);
            let values = |scene: &DynamicScene, time: f32| deformed(scene, time).concat();
            for time in [0.0, 0.2, 0.25, 0.75, 0.8, 1.0] {
                assert_eq!(values(&bridged, time), values(&seen, time), "{time}");
            }
            let [before, from, to, after] = [0.0, 0.25, 0.75, 1.0].map(|time| values(&seen, time));
            for (time, share) in [(0.375, 0.25), (0.5, 0.5), (0.625, 0.75)] {
                let mut expected: Vec<f32> = from
                    .iter()
                    .zip(&to)
                    .map(|(from, to)| {
                        (f64::from(*from) * (1.0 - share) + f64::from(*to) * share) as f32
                    })
                    .collect();
                let mut agreements = Vec::new();
                for row in 0..9 {
                    let place = |values: &[f32]| -> [f64; 3] {
                        std::array::from_fn(|axis| f64::from(values[3 * row + axis]))
                    };
                    let known = [&before, &from, &to, &after].map(|values| place(values));
                    let (place, agree) = inside_a_gap(known, 2.0, share);
                    for (axis, value) in place.into_iter().enumerate() {
                        expected[3 * row + axis] = value as f32;
                    }
                    agreements.push(agree);
                }
                assert!(
                    agreements.contains(&0.0) && agreements.iter().any(|agree| *agree > 0.1),
                    "both kinds occur: {agreements:?}"
                );
                let found = values(&bridged, time);
                let largest = expected.iter().fold(1.0f32, |m, v| m.max(v.abs()));
                let error = largest_difference(&found, &expected);
                assert!(error <= 1e-6 * largest, "{time}: {error} of {largest}");
                assert!(
                    largest_difference(&values(&seen, time), &expected) > 1e-3,
                    "the field alone gives other values"
                );
            }
        }
    }
}
