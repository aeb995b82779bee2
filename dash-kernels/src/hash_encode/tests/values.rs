//! Values and gradients of the encoding.

use burn::tensor::Tensor;

use crate::hash_encode::{
    HashGridConfig, HashGridLayout, Interpolation, LevelSizing, cpu, hash_encode, reference,
};
use crate::testing_hash::*;

fn layout(
    dims: usize,
    features: usize,
    change: impl FnOnce(&mut HashGridConfig),
) -> HashGridLayout {
    let mut config = HashGridConfig {
        n_levels: 6,
        n_features_per_level: features,
        log2_hashmap_size: 9,
        base_resolution: [3, 4, 5, 2][..dims].to_vec(),
        finest_resolution: [90, 64, 70, 11][..dims].to_vec(),
        interpolation: Interpolation::Linear,
        sizing: LevelSizing::Paper,
    };
    change(&mut config);
    HashGridLayout::new(&config).expect("a good configuration")
}

fn every_layout() -> Vec<HashGridLayout> {
    let mut layouts = Vec::new();
    for dims in 2..=4 {
        for features in [1, 2, 4, 8] {
            for interpolation in [Interpolation::Linear, Interpolation::Smoothstep] {
                for sizing in [LevelSizing::Paper, LevelSizing::Reference] {
                    layouts.push(layout(dims, features, |c| {
                        (c.interpolation, c.sizing) = (interpolation, sizing);
                    }));
                }
            }
        }
    }
    layouts
}

struct Case {
    layout: HashGridLayout,
    positions: Vec<f32>,
    table: Vec<f32>,
    v_out: Vec<f32>,
    n: usize,
}

impl Case {
    fn random(layout: HashGridLayout, n: usize, seed: u64) -> Self {
        let mut rng = rng(seed);
        let n_values = layout.n_entries() * layout.n_features_per_level();
        Self {
            positions: uniform(&mut rng, n * layout.dims(), 0.0, 1.0),
            table: uniform(&mut rng, n_values, -1.0, 1.0),
            v_out: uniform(&mut rng, n * layout.n_features(), -1.0, 1.0),
            layout,
            n,
        }
    }

    fn reference(&self) -> Vec<f64> {
        reference::hash_encode(&to_f64(&self.positions), &to_f64(&self.table), &self.layout)
    }

    fn reference_vjp(&self) -> (Vec<f64>, Vec<f64>) {
        reference::hash_encode_vjp(
            &to_f64(&self.positions),
            &to_f64(&self.table),
            &to_f64(&self.v_out),
            &self.layout,
        )
    }

    /// Value and both gradients of the fast kernels.
    fn cpu(&self) -> [Vec<f32>; 3] {
        [
            cpu::hash_encode(&self.positions, &self.table, &self.layout),
            cpu::positions_vjp(&self.positions, &self.table, &self.v_out, &self.layout),
            cpu::table_vjp(&self.positions, &self.v_out, &self.layout),
        ]
    }

    fn assert_cpu_agrees(&self) {
        let [out, v_positions, v_table] = self.cpu();
        let (expected_v_positions, expected_v_table) = self.reference_vjp();
        assert_agrees(&out, &self.reference());
        assert_agrees(&v_positions, &expected_v_positions);
        assert_agrees(&v_table, &expected_v_table);
    }
}

/// One level of 2x2 cells: the middle of the lower left cell sees its four corners equally, a
/// quarter along x sees them 3 : 1.
#[test]
fn one_cell_by_hand() {
    for (interpolation, quarter) in [
        (Interpolation::Linear, 0.25),
        (Interpolation::Smoothstep, 3.0 / 16.0 - 2.0 / 64.0),
    ] {
        let layout = layout(2, 1, |c| {
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
            &to_f64(&cpu::hash_encode(&positions, &table, &layout)),
            &expected,
            1e-6,
            0.0,
        );
        let got = reference::hash_encode(&to_f64(&positions), &to_f64(&table), &layout);
        assert_close(&got, &expected, 1e-12, 0.0);
        // Corners get their weights; only rows 0, 1, 3 and 4 are touched.
        let v_table = to_f64(&cpu::table_vjp(&positions, &[1.0, 0.0], &layout));
        let q = 0.25;
        assert_close(&v_table, &[q, q, 0.0, q, q, 0.0, 0.0, 0.0, 0.0], 1e-6, 0.0);
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
        assert_close(&to_f64(&v_positions), &expected, 1e-6, 0.0);
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
            &v_positions,
            &by_positions,
            DIFFERENCES_RELATIVE,
            1e-6 * scale,
        );
        assert_close(&v_table, &by_table, DIFFERENCES_RELATIVE, 1e-9);
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
            let case = Case::random(layout(dims, 2, |_| ()), 333, dims as u64);
            let (n, layout) = (case.n, &case.layout);
            let positions = tensor(&case.positions, [n, dims], &device).require_grad();
            let table = tensor(&case.table, [layout.n_entries(), 2], &device).require_grad();
            let v_out = tensor(&case.v_out, [n, layout.n_features()], &device);
            let out = hash_encode(positions.clone(), table.clone(), layout).expect("fits");
            assert_agrees(&values(out.clone().inner()), &case.reference());
            let grads = (out * v_out).sum().backward();
            let (v_positions, v_table) = case.reference_vjp();
            assert_agrees(
                &values(positions.grad(&grads).expect("tracked")),
                &v_positions,
            );
            assert_agrees(&values(table.grad(&grads).expect("tracked")), &v_table);
        }
    }
}

#[test]
fn only_tracked_parents_get_gradients() {
    for device in devices() {
        let device = device.autodiff();
        let case = Case::random(layout(3, 2, |_| ()), 20, 1);
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
    let case = Case::random(layout(3, 2, |_| ()), 200, 3);
    let other = layout(3, 2, |c| c.interpolation = Interpolation::Smoothstep);
    let got = cpu::hash_encode(&case.positions, &case.table, &other);
    assert!(disagreement(&got, &case.reference()).is_some());
    let v_table = cpu::table_vjp(&case.positions, &case.v_out, &other);
    assert!(disagreement(&v_table, &case.reference_vjp().1).is_some());
}

#[test]
fn no_points() {
    for device in devices() {
        let device = device.autodiff();
        let layout = layout(4, 2, |_| ());
        let table = Tensor::<2>::ones([layout.n_entries(), 2], &device).require_grad();
        let positions = Tensor::<2>::zeros([0, 4], &device).require_grad();
        let out = hash_encode(positions.clone(), table.clone(), &layout).expect("fits");
        assert_eq!(out.dims(), [0, layout.n_features()]);
        let grads = out.sum().backward();
        assert_eq!(positions.grad(&grads).expect("tracked").dims(), [0, 4]);
        let v_table = values(table.grad(&grads).expect("tracked"));
        assert!(v_table.iter().all(|&v| v == 0.0));
    }
}

#[test]
fn outside_and_nan_have_no_features_and_no_gradient() {
    let below = -f32::from_bits(1);
    let above = f32::from_bits(1.0f32.to_bits() + 1);
    for layout in every_layout() {
        let dims = layout.dims();
        for bad in [
            below,
            above,
            -1.0,
            2.0,
            1e30,
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
        ] {
            for axis in 0..dims {
                let mut case = Case::random(layout.clone(), 19, 2);
                // A poisoned table must not reach the point either.
                case.table[0] = f32::NAN;
                case.positions[7 * dims + axis] = bad;
                let clean = {
                    let mut clean = Case::random(layout.clone(), 19, 2);
                    clean.table[0] = f32::NAN;
                    clean.v_out[7 * layout.n_features()..][..layout.n_features()].fill(0.0);
                    clean
                };
                let [out, v_positions, v_table] = case.cpu();
                let width = layout.n_features();
                assert!(out[7 * width..][..width].iter().all(|&v| v == 0.0), "{bad}");
                assert!(
                    v_positions[7 * dims..][..dims].iter().all(|&v| v == 0.0),
                    "{bad}"
                );
                let clean_v_table = clean.cpu()[2].clone();
                assert_close(&to_f64(&v_table), &to_f64(&clean_v_table), 0.0, 0.0);
            }
        }
    }
}

#[test]
fn zero_and_one_are_inside() {
    for layout in every_layout() {
        let dims = layout.dims();
        let mut case = Case::random(layout, 1 << dims, 6);
        for (i, x) in case.positions.iter_mut().enumerate() {
            *x = (((i / dims) >> (i % dims)) & 1) as f32;
        }
        case.assert_cpu_agrees();
        assert!(
            case.cpu()[0].iter().all(|&v| v != 0.0),
            "corners have features"
        );
    }
}

/// On a vertex and one ulp beside it the features differ by no more than rounding.
#[test]
fn features_are_continuous_across_vertices() {
    for layout in every_layout() {
        let dims = layout.dims();
        let mut at = Case::random(layout, 64, 8);
        let finest = *at.layout.levels().last().expect("six levels");
        for (i, x) in at.positions.iter_mut().enumerate() {
            let (point, axis) = (i / dims, i % dims);
            // Vertex 0 has nothing below it and stays a point of its own.
            *x = ((1 + point % 8) as f64 / finest.scale[axis]) as f32;
        }
        let expected = at.reference();
        for towards in [0.0, 1.0] {
            let beside: Vec<f32> = at
                .positions
                .iter()
                .map(|x| {
                    if towards > 0.5 {
                        x.next_up()
                    } else {
                        x.next_down()
                    }
                })
                .collect();
            let got = to_f64(&cpu::hash_encode(&beside, &at.table, &at.layout));
            // 90 cells times half an ulp of one half, over four axes.
            assert_close(&got, &expected, 0.0, 2e-5);
        }
        at.assert_cpu_agrees();
    }
}

#[test]
fn tables_of_one_entry_and_huge_resolutions() {
    for sizing in [LevelSizing::Paper, LevelSizing::Reference] {
        for (log2, finest) in [(0, 64), (1, 65_536), (14, 65_536)] {
            let layout = layout(4, 2, |c| {
                c.sizing = sizing;
                c.log2_hashmap_size = log2;
                c.base_resolution = vec![1; 4];
                c.finest_resolution = vec![finest; 4];
            });
            let case = Case::random(layout, 50, 4);
            let [out, v_positions, v_table] = case.cpu();
            assert_agrees(&out, &case.reference());
            assert_agrees(&v_table, &case.reference_vjp().1);
            // With one entry all corners are equal and the slope is rounding.
            if log2 > 0 {
                assert_agrees(&v_positions, &case.reference_vjp().0);
            }
        }
    }
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
        assert_close(&[got], &[expected], 1e-5, 1e-4);
    }
}

#[test]
fn non_contiguous_inputs_are_read_in_their_order() {
    for device in devices() {
        let case = Case::random(layout(3, 2, |_| ()), 40, 9);
        let entries = case.layout.n_entries();
        let positions = tensor(&case.positions, [40, 3], &device);
        let table = tensor(&case.table, [entries, 2], &device);
        let strided = |t: Tensor<2>| {
            let [rows, columns] = t.dims();
            tensor(&values(t.transpose()), [columns, rows], &device).transpose()
        };
        let expected =
            values(hash_encode(positions.clone(), table.clone(), &case.layout).expect("fits"));
        let got = hash_encode(strided(positions), strided(table), &case.layout).expect("fits");
        assert_eq!(bits(&values(got)), bits(&expected));
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    // One level, fewer levels than threads, more levels than threads.
    for n_levels in [1, 3, 12] {
        let case = Case::random(layout(4, 2, |c| c.n_levels = n_levels), 1003, 7);
        let run = || case.cpu().map(|values| bits(&values));
        let one = with_threads(1, run);
        assert!(one == with_threads(2, run), "2 threads, {n_levels} levels");
        assert!(one == with_threads(8, run), "8 threads, {n_levels} levels");
    }
}

#[test]
fn tensors_that_do_not_fit_are_refused() {
    for device in devices() {
        let layout = layout(3, 2, |_| ());
        let zeros = |shape| Tensor::<2>::zeros(shape, &device);
        let entries = layout.n_entries();
        assert!(hash_encode(zeros([5, 3]), zeros([entries, 2]), &layout).is_ok());
        assert!(hash_encode(zeros([5, 2]), zeros([entries, 2]), &layout).is_err());
        assert!(hash_encode(zeros([5, 3]), zeros([entries - 1, 2]), &layout).is_err());
        assert!(hash_encode(zeros([5, 3]), zeros([entries, 1]), &layout).is_err());
    }
}
