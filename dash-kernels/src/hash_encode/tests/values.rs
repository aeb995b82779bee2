//! Values and gradients of the encoding.

use super::{Case, every_layout, small_layout};
use crate::hash_encode::{Interpolation, cpu, hash_encode, reference};
use crate::testing::*;

/// Largest norm of what features are off, as a share of theirs.
const FEATURES_L2: f64 = 1e-6;

/// One level of 2x2 cells: the middle of the lower left cell sees its four corners equally, a
/// quarter along x sees them 3 : 1.
#[test]
fn one_cell_by_hand() {
    for (interpolation, quarter) in [
        (Interpolation::Linear, 0.25),
        (Interpolation::Smoothstep, 3.0 / 16.0 - 2.0 / 64.0),
    ] {
        let layout = small_layout(2, 1, |c| {
            c.n_levels = 1;
            c.base_resolution = vec![2, 2];
            c.finest_resolution = vec![2, 2];
            c.interpolation = interpolation;
        });
        // Rows of vertices 0..3 x 0..3, x fastest.
        let table: Vec<f32> = (0..9).map(|i| (i * i) as f32).collect();
        let positions = [0.25, 0.25, 0.125, 0.25];
        let lower = (0.0 + 1.0 + 9.0 + 16.0) / 4.0;
        let left = 0.5 * ((1.0 - quarter) * 0.0 + quarter * 1.0)
            + 0.5 * ((1.0 - quarter) * 9.0 + quarter * 16.0);
        let expected = [lower, left];
        assert_close(
            "features",
            &to_f64(&cpu::hash_encode(&positions, &table, &layout)),
            &expected,
            0.0,
            1e-6,
        );
        let got = reference::hash_encode(&to_f64(&positions), &to_f64(&table), &layout);
        assert_close("reference", &got, &expected, 0.0, 1e-12);
        // Corners get their weights; only rows 0, 1, 3 and 4 are touched.
        let v_table = to_f64(&cpu::table_vjp(&positions, &[1.0, 0.0], &layout));
        let q = 0.25;
        assert_close(
            "v_table",
            &v_table,
            &[q, q, 0.0, q, q, 0.0, 0.0, 0.0, 0.0],
            0.0,
            1e-6,
        );
        // d/dx in the middle: mean rise of the two edges, times scale, times the weight's slope.
        let v_positions = cpu::positions_vjp(&positions, &table, &[1.0, 0.0], &layout);
        let slope = if interpolation == Interpolation::Linear {
            1.0
        } else {
            1.5
        };
        let expected = [
            2.0 * slope * (1.0 + 7.0) / 2.0,
            2.0 * slope * (9.0 + 15.0) / 2.0,
            0.0,
            0.0,
        ];
        assert_close("v_positions", &to_f64(&v_positions), &expected, 0.0, 1e-6);
    }
}

#[test]
fn reference_vjp_matches_central_differences() {
    for (seed, layout) in every_layout().into_iter().enumerate() {
        if layout.n_features_per_level() != 2 {
            continue;
        }
        let mut case = Case::random(layout, 5, seed as u64);
        // Differences must not straddle a cell's border, where a D-linear function has a kink:
        // move every coordinate well into its cell on every level, or drop the point.
        let dims = case.layout.dims();
        let in_cell = |x: f32, axis: usize| {
            case.layout.levels().iter().all(|level| {
                let w = (f64::from(x) * level.scale[axis]).fract();
                (0.001..0.999).contains(&w)
            })
        };
        let mut rng = rng(seed as u64 + 1000);
        for i in 0..case.positions.len() {
            let mut x = case.positions[i];
            while !in_cell(x, i % dims) {
                x = uniform(&mut rng, 1, 0.0, 1.0)[0];
            }
            case.positions[i] = x;
        }
        let (positions, table) = (to_f64(&case.positions), to_f64(&case.table));
        let (v_out, layout) = (to_f64(&case.v_out), &case.layout);
        let (v_positions, v_table) = case.reference_vjp();
        let by_positions = central_differences(&positions, 1e-6, |p| {
            dot(&reference::hash_encode(p, &table, layout), &v_out)
        });
        // The value is linear in the table, so the step may be long.
        let by_table = central_differences(&table, 0.5, |t| {
            dot(&reference::hash_encode(&positions, t, layout), &v_out)
        });
        let scale = v_positions.iter().fold(0.0f64, |max, v| max.max(v.abs()));
        assert_close(
            "v_positions",
            &v_positions,
            &by_positions,
            1e-6 * scale,
            DIFFERENCES_RELATIVE,
        );
        assert_close("v_table", &v_table, &by_table, 1e-9, DIFFERENCES_RELATIVE);
    }
}

#[test]
fn kernels_match_the_reference_for_every_layout_and_remainder() {
    for (seed, layout) in every_layout().into_iter().enumerate() {
        for n in [1, 15, 16, 17, 100] {
            Case::random(layout.clone(), n, seed as u64).assert_cpu_agrees();
        }
    }
}

#[test]
fn backends_match_the_reference() {
    for device in devices() {
        let device = device.autodiff();
        for dims in 2..=4 {
            let case = Case::random(small_layout(dims, 2, |_| ()), 333, dims as u64);
            let (n, layout) = (case.n, &case.layout);
            let positions = tensor(&case.positions, [n, dims], &device).require_grad();
            let table = tensor(&case.table, [layout.n_entries(), 2], &device).require_grad();
            let v_out = tensor(&case.v_out, [n, layout.n_features()], &device);
            let out = hash_encode(positions.clone(), table.clone(), layout).expect("fits");
            let (features, expected) = (values(out.clone().inner()), case.reference());
            assert_agrees("features", &features, &expected);
            let off = relative_l2(&to_f64(&features), &expected);
            assert!(off <= FEATURES_L2, "{dims}D: relative L2 error {off:e}");
            let grads = (out * v_out).sum().backward();
            let (v_positions, v_table) = case.reference_vjp();
            assert_agrees(
                "v_positions",
                &values(positions.grad(&grads).expect("tracked")),
                &v_positions,
            );
            assert_agrees(
                "v_table",
                &values(table.grad(&grads).expect("tracked")),
                &v_table,
            );
        }
    }
}

#[test]
fn only_tracked_parents_get_gradients() {
    for device in devices() {
        let device = device.autodiff();
        let case = Case::random(small_layout(3, 2, |_| ()), 20, 1);
        for tracked in 0..2 {
            let positions = tensor(&case.positions, [20, 3], &device);
            let table = tensor(&case.table, [case.layout.n_entries(), 2], &device);
            let (positions, table) = if tracked == 0 {
                (positions.require_grad(), table)
            } else {
                (positions, table.require_grad())
            };
            let out = hash_encode(positions.clone(), table.clone(), &case.layout).expect("fits");
            let grads = out.sum().backward();
            assert_eq!(positions.grad(&grads).is_some(), tracked == 0);
            assert_eq!(table.grad(&grads).is_some(), tracked == 1);
        }
    }
}

/// Differences that the tolerances must not swallow.
#[test]
fn a_foreign_layout_is_noticed() {
    let case = Case::random(small_layout(3, 2, |_| ()), 200, 3);
    let other = small_layout(3, 2, |c| c.interpolation = Interpolation::Smoothstep);
    let got = cpu::hash_encode(&case.positions, &case.table, &other);
    assert!(disagreement(&got, &case.reference()).is_some());
    let v_table = cpu::table_vjp(&case.positions, &case.v_out, &other);
    assert!(disagreement(&v_table, &case.reference_vjp().1).is_some());
}

#[test]
fn a_constant_table_gives_constant_features() {
    for layout in every_layout() {
        let mut case = Case::random(layout, 100, 5);
        case.table.fill(0.75);
        for value in cpu::hash_encode(&case.positions, &case.table, &case.layout) {
            assert!((value - 0.75).abs() < 1e-6, "{value}");
        }
        // The table's gradient then sums to the cotangents' sum.
        let v_table = cpu::table_vjp(&case.positions, &case.v_out, &case.layout);
        let (got, expected) = (
            to_f64(&v_table).iter().sum(),
            to_f64(&case.v_out).iter().sum(),
        );
        assert_close("slope", &[got], &[expected], 1e-4, 1e-5);
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    // One level, fewer levels than threads, more levels than threads.
    for n_levels in [1, 3, 12] {
        let case = Case::random(small_layout(4, 2, |c| c.n_levels = n_levels), 1003, 7);
        let run = || case.cpu().map(|values| bits(&values));
        let one = with_threads(1, run);
        assert!(one == with_threads(2, run), "2 threads, {n_levels} levels");
        assert!(one == with_threads(8, run), "8 threads, {n_levels} levels");
    }
}
