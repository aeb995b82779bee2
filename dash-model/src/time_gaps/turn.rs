//! A path with one turn through a time gap, from the velocities before and after it.

use burn::tensor::Tensor;

/// Keeps divisions by zero away.
const TINY: f32 = 1e-30;

/// The offset from the straight path through a gap of a body that keeps its velocity, turns once, and leaves with its
/// velocity after the gap.
///
/// The two velocities give the time of the turn. Measured velocities are noisy, so the two halves of the path miss each
/// other: where the turn lies `off` from the straight path and the halves miss each other by `miss`, the offset is scaled
/// by `max(0, 1 - miss^2 / off^2)`. For velocities that are only noise, `miss` is mostly larger and the path stays straight.
///
/// # Shapes
/// `way [N, 3]` through the gap, `arrives [N, 3]` and `leaves [N, 3]`: the distances covered during the gap at the velocity
/// before and after it; `share` in [0, 1] of the gap's duration `-> [N, 3]`
pub(crate) fn turn(way: Tensor<2>, arrives: Tensor<2>, leaves: Tensor<2>, share: f32) -> Tensor<2> {
    let scale = largest([&way, &arrives, &leaves]);
    let [way, arrives, leaves] = [way, arrives, leaves].map(|way| way / scale.clone());
    let change = arrives.clone() - leaves.clone();
    // The share of the gap at the old velocity that brings the body nearest to its place after the gap.
    let old = ((way.clone() - leaves.clone()) * change.clone()).sum_dim(1)
        / (squared(change.clone()) + TINY);
    let old = old.clamp(0.0, 1.0);
    let new = -old.clone() + 1.0;
    let miss = way - arrives * old.clone() - leaves * new.clone();
    let off = change.clone() * (old.clone() * new.clone());
    // At the turn both are `old * new`.
    let tent = (new * share).min_pair(old * (1.0 - share));
    let agree = (-squared(miss) / (squared(off) + TINY) + 1.0).clamp(0.0, 1.0);
    change * agree * tent * scale
}

/// `[N, 3] -> [N, 1]`
fn squared(way: Tensor<2>) -> Tensor<2> {
    way.powi_scalar(2).sum_dim(1)
}

/// The largest component of each row, `[N, 1]`. In units of it no square overflows or vanishes.
fn largest(ways: [&Tensor<2>; 3]) -> Tensor<2> {
    let [a, b, c] = ways.map(|way| way.clone().abs().max_dim(1));
    a.max_pair(b).max_pair(c) + TINY
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, TensorData};
    use dash_kernels::testing::devices;

    use super::*;

    /// [`turn`] of single bodies.
    fn turned(ways: [[f64; 3]; 3], share: f32, device: &Device) -> [f64; 3] {
        let [way, arrives, leaves] = ways.map(|way| {
            let way = way.map(|v| v as f32).to_vec();
            Tensor::<2>::from_data(TensorData::new(way, [1, 3]), device)
        });
        let off = turn(way, arrives, leaves, share).into_data();
        let off = off.try_into_vec::<f32>().expect("f32");
        std::array::from_fn(|axis| f64::from(off[axis]))
    }

    fn assert_near(found: [f64; 3], expected: [f64; 3], tolerance: f64) {
        for axis in 0..3 {
            let error = (found[axis] - expected[axis]).abs();
            assert!(error <= tolerance, "{found:?}, expected {expected:?}");
        }
    }

    /// At any time of the turn, in any unit.
    #[test]
    fn a_body_that_turns_once_passes_its_turn() {
        let (arrives, leaves) = ([0.5, -1.0, 2.0], [-1.5, 0.25, 1.0]);
        for device in devices() {
            for unit in [1e-15, 1.0, 1e15] {
                for turn in [0.1, 0.5, 0.8] {
                    let at = |share: f64| -> [f64; 3] {
                        let (old, new) = (share.min(turn), (share - turn).max(0.0));
                        std::array::from_fn(|k| unit * (old * arrives[k] + new * leaves[k]))
                    };
                    let way = at(1.0);
                    let ways = [way, arrives.map(|v| unit * v), leaves.map(|v| unit * v)];
                    for share in [0.0, 0.1, 0.3, 0.5, 0.9, 1.0] {
                        let off = turned(ways, share, &device);
                        let share = f64::from(share);
                        let found = std::array::from_fn(|k| share * way[k] + off[k]);
                        assert_near(found, at(share), 2e-6 * unit);
                    }
                }
            }
        }
    }

    #[test]
    fn the_path_stays_straight_where_velocities_tell_nothing() {
        let way = [1.0, 0.0, 0.0];
        let tell_nothing = [
            // The velocity of the straight path.
            [way, way],
            [[0.0; 3], [0.0; 3]],
            // Equal, in another direction.
            [[0.0, 3.0, 0.0], [0.0, 3.0, 0.0]],
            // Paths that do not meet.
            [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            [[-1.0, 1.0, 0.0], [-3.0, -2.0, 0.0]],
        ];
        for device in devices() {
            for [arrives, leaves] in tell_nothing {
                let off = turned([way, arrives, leaves], 0.5, &device);
                assert_eq!(off, [0.0; 3], "{arrives:?} {leaves:?}");
            }
            assert_eq!(turned([[0.0; 3]; 3], 0.5, &device), [0.0; 3]);
        }
    }

    /// By hand: half of the gap at each velocity misses by 0.5; the turn is `sqrt(0.5)` off, so the offset is halved; after
    /// a quarter of the gap it has reached half of that.
    #[test]
    fn a_turn_with_half_agreement_is_halved() {
        let ways = [[1.0, 1.0, 0.5], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
        for device in devices() {
            let off = turned(ways, 0.25, &device);
            assert_near(off, [0.125, -0.125, 0.0], 1e-6);
        }
    }
}
