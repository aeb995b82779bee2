//! Points of the unit cube in f64, straight from their definition.

use super::Bounds;

/// `positions [N, 3] -> [N, 4]`.
pub fn space_time(positions: &[f64], bounds: &Bounds, time: f64) -> Vec<f64> {
    let point = |position: &[f64]| {
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let unit = along(position, bounds, axis);
            match bounds.clamp {
                true => unit.clamp(0.0, 1.0),
                false => unit,
            }
        });
        [x, y, z, time]
    };
    positions.chunks_exact(3).flat_map(point).collect()
}

/// Points beside those of `rows`, by `steps [M, 4]`, of `points [N, 4] -> [M, 4]`.
pub fn beside(points: &[f64], steps: &[f64], rows: &[u32]) -> Vec<f64> {
    let steps = steps.chunks_exact(4).zip(rows);
    steps
        .flat_map(|(step, &row)| {
            let point = &points[4 * row as usize..][..4];
            let sums = point.iter().zip(step).map(|(a, b)| (a + b).clamp(0.0, 1.0));
            sums.collect::<Vec<_>>()
        })
        .collect()
}

/// `positions [N, 3]`, `v_out [N, 4] -> [N, 3]`.
pub fn space_time_vjp(positions: &[f64], v_out: &[f64], bounds: &Bounds) -> Vec<f64> {
    let rows = positions.chunks_exact(3).zip(v_out.chunks_exact(4));
    rows.flat_map(|(position, v)| {
        [0, 1, 2].map(|axis| {
            let inside = (0.0..=1.0).contains(&along(position, bounds, axis));
            match inside || !bounds.clamp {
                true => v[axis] * f64::from(bounds.scale[axis]),
                false => 0.0,
            }
        })
    })
    .collect()
}

fn along(position: &[f64], bounds: &Bounds, axis: usize) -> f64 {
    (position[axis] - f64::from(bounds.min[axis])) * f64::from(bounds.scale[axis])
}
