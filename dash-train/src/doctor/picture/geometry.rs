//! Lines on a panel: clipped, of cameras, of boxes.

use dash_kernels::Camera;
use dash_model::SpaceBox;
use glam::DVec3;

use super::SIDE;

/// The part of a line inside a panel.
pub(super) fn clipped(from: [f64; 2], to: [f64; 2]) -> Option<[[f64; 2]; 2]> {
    let (mut start, mut end) = (0.0_f64, 1.0_f64);
    for axis in 0..2 {
        let (a, d) = (from[axis], to[axis] - from[axis]);
        if !(a.is_finite() && d.is_finite()) {
            return None;
        }
        let bounds = [-a, SIDE - a];
        if d == 0.0 {
            if bounds[0] > 0.0 || bounds[1] < 0.0 {
                return None;
            }
        } else {
            let (low, high) = (bounds[0] / d, bounds[1] / d);
            start = start.max(low.min(high));
            end = end.min(low.max(high));
        }
    }
    let at = |share: f64| [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]));
    (start <= end).then(|| [at(start), at(end)])
}

/// The camera's centre, and the corners of its picture so far in front of it.
pub(super) fn pyramid(camera: &Camera, depth: f64) -> [DVec3; 5] {
    let apex = DVec3::from(camera.position());
    let corner = |u: f64, v: f64| {
        let ray = DVec3::from(camera.unproject([u, v], 1.0)) - apex;
        apex + ray * (depth / ray.length())
    };
    let (w, h) = (camera.width as f64, camera.height as f64);
    [
        apex,
        corner(0.0, 0.0),
        corner(w, 0.0),
        corner(w, h),
        corner(0.0, h),
    ]
}

/// The twelve edges of a box.
pub(super) fn edges(space: &SpaceBox) -> Vec<(DVec3, DVec3)> {
    let corner = |k: usize| {
        let at = |axis: usize| {
            f64::from(if k >> axis & 1 == 1 {
                space.max[axis]
            } else {
                space.min[axis]
            })
        };
        DVec3::new(at(0), at(1), at(2))
    };
    (0..8)
        .flat_map(|k| {
            (0..3)
                .filter(move |axis| k >> axis & 1 == 0)
                .map(move |axis| (k, k | 1 << axis))
        })
        .map(|(a, b)| (corner(a), corner(b)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_stay_on_their_panel() {
        let inside = clipped([-1e12, 3.5], [1e12, 3.5]).expect("crosses it");
        assert!(
            inside
                .iter()
                .all(|[x, _]| (-1e-3..=SIDE + 1e-3).contains(x))
        );
        for (from, to) in [
            ([-5.0, -1.0], [900.0, -1.0]),
            ([f64::NAN, 0.0], [1.0, 1.0]),
            ([f64::INFINITY, 0.0], [1.0, 1.0]),
            ([810.0, 0.0], [830.0, 4.0]),
        ] {
            assert!(clipped(from, to).is_none(), "{from:?} {to:?}");
        }
    }
}
