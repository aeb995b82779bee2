//! The hash encoding as plainly as it can be written: what the fast kernels are judged against.

use num_traits::Float;

use super::layout::{HashGridLayout, HashGridLevel, Interpolation, MAX_DIMS};
use super::{LARGEST_COTANGENT, finite_or_zero};

/// `positions [N, D]`, `table [T, F]` -> `[N, L * F]`. See [`hash_encode`](super::hash_encode).
pub fn hash_encode<T: Float>(positions: &[T], table: &[T], layout: &HashGridLayout) -> Vec<T> {
    let features = layout.n_features_per_level();
    let mut out = vec![T::zero(); positions.len() / layout.dims() * layout.n_features()];
    for_each_corner(positions, layout, |corner| {
        for f in 0..features {
            let value = corner.weight * table[corner.row * features + f];
            out[corner.feature + f] = out[corner.feature + f] + value;
        }
    });
    out.into_iter().map(finite_or_zero).collect()
}

/// Gradients `(v_positions [N, D], v_table [T, F])` from `v_out [N, L * F]`.
pub fn hash_encode_vjp<T: Float>(
    positions: &[T],
    table: &[T],
    v_out: &[T],
    layout: &HashGridLayout,
) -> (Vec<T>, Vec<T>) {
    let features = layout.n_features_per_level();
    let largest = T::from(LARGEST_COTANGENT).expect("a float type holds any f32, rounded");
    let mut v_positions = vec![T::zero(); positions.len()];
    let mut v_table = vec![T::zero(); table.len()];
    for_each_corner(positions, layout, |corner| {
        let mut v_weight = T::zero();
        for f in 0..features {
            let v = finite_or_zero(v_out[corner.feature + f])
                .max(-largest)
                .min(largest);
            let row = corner.row * features + f;
            v_table[row] = v_table[row] + corner.weight * v;
            v_weight = v_weight + table[row] * v;
        }
        for axis in 0..layout.dims() {
            let at = corner.point * layout.dims() + axis;
            v_positions[at] = v_positions[at] + v_weight * corner.slopes[axis];
        }
    });
    let v_positions = v_positions.into_iter().map(finite_or_zero).collect();
    (v_positions, v_table)
}

struct Corner<T> {
    point: usize,
    /// Where the level's features of this point start in the output.
    feature: usize,
    /// Row in the whole table.
    row: usize,
    weight: T,
    /// Derivative of the weight along each axis of the position.
    slopes: [T; MAX_DIMS],
}

fn for_each_corner<T: Float>(
    positions: &[T],
    layout: &HashGridLayout,
    mut visit: impl FnMut(Corner<T>),
) {
    for (point, position) in positions.chunks_exact(layout.dims()).enumerate() {
        let inside = |&x: &T| x >= T::zero() && x <= T::one();
        if !position.iter().all(inside) {
            continue;
        }
        for (l, level) in layout.levels().iter().enumerate() {
            let feature = point * layout.n_features() + l * layout.n_features_per_level();
            visit_level(
                position,
                level,
                layout.interpolation(),
                |row, weight, slopes| {
                    visit(Corner {
                        point,
                        feature,
                        row,
                        weight,
                        slopes,
                    });
                },
            );
        }
    }
}

fn visit_level<T: Float>(
    position: &[T],
    level: &HashGridLevel,
    interpolation: Interpolation,
    mut visit: impl FnMut(usize, T, [T; MAX_DIMS]),
) {
    let constant = |x: f64| T::from(x).expect("a float type holds any f64, rounded");
    let dims = position.len();
    let mut cell = [0u64; MAX_DIMS];
    let mut upper = [T::zero(); MAX_DIMS];
    let mut slope = [T::zero(); MAX_DIMS];
    for axis in 0..dims {
        let scale = constant(level.scale[axis]);
        let in_cells = position[axis] * scale;
        let floor = in_cells.floor().to_u64().expect("inside the grid");
        // The far border belongs to the last cell.
        cell[axis] = floor.min(level.resolution[axis] - 2);
        let w = in_cells - constant(cell[axis] as f64);
        (upper[axis], slope[axis]) = match interpolation {
            Interpolation::Linear => (w, scale),
            Interpolation::Smoothstep => (
                w * w * (constant(3.0) - constant(2.0) * w),
                constant(6.0) * w * (T::one() - w) * scale,
            ),
        };
    }
    for corner in 0..1usize << dims {
        let is_upper = |axis: usize| corner >> axis & 1 == 1;
        let factor = |axis: usize| {
            if is_upper(axis) {
                upper[axis]
            } else {
                T::one() - upper[axis]
            }
        };
        let mut vertex = cell;
        let mut slopes = [T::zero(); MAX_DIMS];
        for axis in 0..dims {
            vertex[axis] += u64::from(is_upper(axis));
            let sign = if is_upper(axis) { T::one() } else { -T::one() };
            slopes[axis] = (0..dims)
                .filter(|&other| other != axis)
                .fold(sign * slope[axis], |product, other| product * factor(other));
        }
        let weight = (0..dims).fold(T::one(), |product, axis| product * factor(axis));
        let row = (level.offset + level.row(&vertex[..dims])) as usize;
        visit(row, weight, slopes);
    }
}
