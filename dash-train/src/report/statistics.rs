//! Medians over seeds, times to a quality, and names in their order.

use super::plot::Point;
use crate::numbers::median_and_range;

/// Each name once, in the order in which they come.
pub(super) fn names<'a>(of: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut names: Vec<&str> = Vec::new();
    for name in of {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names
}

/// Medians over the runs of a group at the steps that all measured runs share, with the range of the values
/// where there are several runs. `at` places a step by its lines.
pub(super) fn median_points<L>(
    runs: impl Iterator<Item = impl AsRef<[L]>>,
    step: fn(&L) -> usize,
    at: impl Fn(&[&L]) -> Option<f64>,
    of: fn(&L) -> Option<f64>,
) -> Vec<Point> {
    let runs: Vec<_> = runs.filter(|run| !run.as_ref().is_empty()).collect();
    let Some((first, others)) = runs.split_first() else {
        return Vec::new();
    };
    let shared = first.as_ref().iter().filter_map(|line| {
        let mut lines = vec![line];
        for run in others {
            let same = |other: &&L| step(other) == step(line);
            lines.push(run.as_ref().iter().find(same)?);
        }
        let [y, low, high] = median_and_range(lines.iter().filter_map(|line| of(line)))?;
        Some(Point {
            y_range: (lines.len() > 1).then_some([low, high]),
            ..Point::new(at(&lines)?, y)
        })
    });
    shared.collect()
}

/// The seconds after which a quality was first measured to be within `margin` of its best.
pub(super) fn seconds_to_best(
    curve: impl Iterator<Item = (f64, Option<f64>)>,
    margin: f64,
) -> Option<f64> {
    let curve: Vec<(f64, f64)> = curve
        .filter_map(|(seconds, value)| Some((seconds, value.filter(|v| v.is_finite())?)))
        .collect();
    let best = curve.iter().map(|(_, value)| *value).reduce(f64::max)?;
    let reached = curve.iter().find(|(_, value)| *value >= best - margin)?;
    Some(reached.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_to_best_is_that_of_the_first_measurement_near_it() {
        let curve = [
            (1.0, Some(20.0)),
            (2.0, Some(29.6)),
            (3.0, Some(29.95)),
            (4.0, None),
            (5.0, Some(30.0)),
            (6.0, Some(29.0)),
        ];
        let to = |margin| seconds_to_best(curve.into_iter(), margin);
        assert_eq!(to(0.5), Some(2.0));
        assert_eq!(to(0.1), Some(3.0));
        assert_eq!(to(0.0), Some(5.0));
        assert_eq!(to(100.0), Some(1.0));
        assert_eq!(seconds_to_best([(1.0, None)].into_iter(), 0.5), None);
    }
}
