//! Gaps of a clip, by hand.

use super::*;

#[test]
fn gaps_are_longer_than_typical_steps() {
    let of = |times: &[f32], steps: f32| Gaps::between(times.iter().copied(), steps).0;
    let times = [0.5, 0.0, 0.1, 0.2, 0.2, 0.6, 0.7, 0.9, f32::NAN, 1.0];
    assert_eq!(of(&times, 1.5), [[0.2, 0.5], [0.7, 0.9]]);
    assert_eq!(of(&times, 2.5), [[0.2, 0.5]]);
    assert_eq!(of(&times, 4.0), [[0.0; 2]; 0]);
    for too_few in [&[] as &[f32], &[0.3], &[0.3, 0.3], &[0.0, 1.0]] {
        assert!(of(too_few, 1.5).is_empty(), "{too_few:?}");
    }
    assert_eq!(of(&[0.1, 0.2, 0.9], 8.0), [[-1.0, 0.1], [0.9, 2.0]]);
    assert_eq!(of(&[0.0, 0.1, 0.2, 0.9], 1.5), [[0.2, 0.9], [0.9, 2.0]]);
    assert!(Gaps::between([0.1, 0.2, 0.3, 0.9], 1.5).any_closed());
    assert!(!Gaps::between([0.1, 0.2, 0.3, 0.4], 1.5).any_closed());
}

#[test]
fn extrapolation_mirrors_a_time_at_the_edge_of_what_was_seen() {
    let gaps = Gaps(vec![
        [-1.0, 0.25],
        [0.375, 0.5],
        [0.6875, 0.75],
        [0.875, 2.0],
    ]);
    let of = |time| gaps.extrapolation(time).map(|e| [e.edge, e.mirrored]);
    for seen in [0.25, 0.4, 0.5, 0.7, 0.875, f32::NAN] {
        assert_eq!(of(seen), None, "{seen}");
    }
    assert_eq!(of(0.1875), Some([0.25, 0.3125]));
    // As far as the next gap, unless that is shorter than half of the distance.
    assert_eq!(of(0.0), Some([0.25, 0.375]));
    assert_eq!(of(0.9375), Some([0.875, 0.8125]));
    assert_eq!(of(1.0), Some([0.875, 0.75]));
    assert_eq!(of(1.03125), Some([0.875, 0.71875]));
    for within in [0.1, 0.25, 0.9] {
        assert_eq!(gaps.interpolation(within), None, "{within}");
    }
    assert!(gaps.interpolation(0.4).is_some());
    // Observation ends at the neighbouring gaps, not at the clip's ends.
    assert_eq!(gaps.interpolation(0.4).map(|gap| gap.observed), Some(0.125));
    let closed = Gaps(vec![[0.25, 1.0]]);
    assert_eq!(
        [0.0, 0.5, 1.5].map(|time| closed.extrapolation(time)),
        [None; 3]
    );
}

#[test]
fn interpolation_is_for_times_strictly_inside_a_gap() {
    let gaps = Gaps(vec![[0.25, 0.5], [0.5, 0.75]]);
    for outside in [-1.0, 0.0, 0.25, 0.5, 0.75, 1.0, f32::NAN] {
        assert_eq!(gaps.interpolation(outside), None, "{outside}");
    }
    let place = |time| {
        gaps.interpolation(time)
            .map(|gap| ([gap.from, gap.to], gap.weight))
    };
    assert_eq!(place(0.3125), Some(([0.25, 0.5], 0.25)));
    assert_eq!(place(0.625), Some(([0.5, 0.75], 0.5)));
    assert_eq!(Gaps::default().interpolation(0.5), None);
}

#[test]
fn observation_beside_a_gap_ends_at_gaps_half_as_long_or_longer() {
    // Lengths of 1 / 32, 1 / 4, 1 / 8 and 1 / 16.
    let gaps = Gaps(vec![
        [0.125, 0.15625],
        [0.25, 0.5],
        [0.625, 0.75],
        [0.875, 0.9375],
    ]);
    let observed = |time| gaps.interpolation(time).map(|gap| gap.observed);
    // The gap's own length; up to the next gap, half as long; up to the gap before and the clip's end.
    assert_eq!(observed(0.14), Some(0.03125));
    assert_eq!(observed(0.3), Some(0.125));
    assert_eq!(observed(0.7), Some(0.125));
    assert_eq!(observed(0.9), Some(0.0625));
    let next_to_another = Gaps(vec![[0.25, 0.5], [0.5, 0.75]]);
    assert_eq!(
        next_to_another.interpolation(0.3).map(|gap| gap.observed),
        Some(0.0)
    );
}

#[test]
fn gaps_of_files_are_checked() {
    let valid = |gaps: &[[f32; 2]]| Gaps(gaps.to_vec()).are_valid();
    assert!(valid(&[]) && valid(&[[0.0, 1.0]]) && valid(&[[0.1, 0.2], [0.2, 0.3]]));
    assert!(valid(&[[-1.0, 0.2], [0.2, 0.3], [0.3, 2.0]]) && valid(&[[-1.0, 2.0]]));
    for invalid in [
        [[0.1, 0.3], [0.2, 0.4]],
        [[0.5, 0.6], [0.1, 0.2]],
        [[0.1, 0.2], [0.4, 0.4]],
        [[-0.1, 0.2], [0.3, 0.4]],
        [[0.1, 0.2], [-1.0, 0.4]],
        [[0.1, 2.0], [0.3, 0.4]],
        [[0.1, 0.2], [1.5, 2.0]],
        [[0.1, 0.2], [0.3, 1.1]],
        [[0.1, f32::NAN], [0.3, 0.4]],
        [[f32::NEG_INFINITY, 0.2], [0.3, f32::INFINITY]],
    ] {
        assert!(!valid(&invalid), "{invalid:?}");
    }
}
