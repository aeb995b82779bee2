//! Names of cameras beside them, where there is room.

use super::{LABEL, SIDE};
use crate::draw::text_width;

/// Left, top, right, bottom.
type Bounds = [f64; 4];

/// Between a name and what it stands beside, pixels.
const GAP: f64 = 3.0;

/// Where names stand in a panel.
#[derive(Default)]
pub(super) struct Labels {
    taken: Vec<Bounds>,
}

impl Labels {
    /// No name is written over any of these.
    pub(super) fn around(shapes: &[Bounds]) -> Self {
        Self {
            taken: shapes.to_vec(),
        }
    }

    /// The left end of a base line below, above, right or left of a shape; `None` where there is no room.
    pub(super) fn room(
        &mut self,
        [left, top, right, bottom]: Bounds,
        name: &str,
    ) -> Option<[f64; 2]> {
        let (width, height) = (text_width(name, LABEL), 1.2 * LABEL);
        let (x, y) = ((left + right - width) / 2.0, (top + bottom - height) / 2.0);
        let corners = [
            [x, bottom + GAP],
            [x, top - GAP - height],
            [right + GAP, y],
            [left - GAP - width, y],
        ];
        let boxes = corners.map(|[x, y]| [x, y, x + width, y + height]);
        let apart =
            |a: &Bounds, b: &Bounds| a[2] < b[0] || b[2] < a[0] || a[3] < b[1] || b[3] < a[1];
        let found = boxes.into_iter().find(|place| {
            let is_inside = place.iter().all(|v| (0.0..=SIDE).contains(v));
            is_inside && self.taken.iter().all(|other| apart(place, other))
        })?;
        self.taken.push(found);
        Some([found[0], found[1] + LABEL])
    }
}

/// What encloses points.
pub(super) fn bounds(points: &[[f64; 2]]) -> Bounds {
    let nothing = [
        f64::INFINITY,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NEG_INFINITY,
    ];
    points
        .iter()
        .fold(nothing, |[left, top, right, bottom], &[x, y]| {
            [left.min(x), top.min(y), right.max(x), bottom.max(y)]
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_written_over_nothing() {
        let shape = bounds(&[[400.0, 380.0], [420.0, 400.0], [390.0, 395.0]]);
        assert_eq!(shape, [390.0, 380.0, 420.0, 400.0]);
        let beside = [430.0, 380.0, 460.0, 400.0];
        let mut labels = Labels::around(&[shape, beside]);
        let places: Vec<_> = (0..6).map(|_| labels.room(shape, "cam00")).collect();
        // On the right is another shape.
        assert_eq!(places.iter().flatten().count(), 3);
        assert!(labels.room([600.0, 400.0, 610.0, 410.0], "cam01").is_some());
        assert!(labels.room([f64::NAN; 4], "cam02").is_none());
        assert!(labels.room([-500.0, 0.0, -490.0, 9.0], "cam03").is_none());
    }
}
