//! The unit box's border and beyond, tiny tables, empty and odd inputs.

use burn::tensor::Tensor;

use super::{Case, every_layout, small_layout};
use crate::hash_encode::{LevelSizing, cpu, hash_encode};
use crate::testing::*;

#[test]
fn no_points() {
    for device in devices() {
        let device = device.autodiff();
        let layout = small_layout(4, 2, |_| ());
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
                assert_close(
                    "v_table",
                    &to_f64(&v_table),
                    &to_f64(&clean_v_table),
                    0.0,
                    0.0,
                );
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
            assert_close("got", &got, &expected, 2e-5, 0.0);
        }
        at.assert_cpu_agrees();
    }
}

#[test]
fn tables_of_one_entry_and_huge_resolutions() {
    for sizing in [LevelSizing::Paper, LevelSizing::Reference] {
        for (log2, finest) in [(0, 64), (1, 65_536), (14, 65_536)] {
            let layout = small_layout(4, 2, |c| {
                c.sizing = sizing;
                c.log2_hashmap_size = log2;
                c.base_resolution = vec![1; 4];
                c.finest_resolution = vec![finest; 4];
            });
            let case = Case::random(layout, 50, 4);
            let [out, v_positions, v_table] = case.cpu();
            assert_agrees("features", &out, &case.reference());
            assert_agrees("v_table", &v_table, &case.reference_vjp().1);
            // With one entry all corners are equal and the slope is rounding.
            if log2 > 0 {
                assert_agrees("v_positions", &v_positions, &case.reference_vjp().0);
            }
        }
    }
}

#[test]
fn non_contiguous_inputs_are_read_in_their_order() {
    for device in devices() {
        let case = Case::random(small_layout(3, 2, |_| ()), 40, 9);
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
fn tensors_that_do_not_fit_are_refused() {
    for device in devices() {
        let layout = small_layout(3, 2, |_| ());
        let zeros = |shape| Tensor::<2>::zeros(shape, &device);
        let entries = layout.n_entries();
        assert!(hash_encode(zeros([5, 3]), zeros([entries, 2]), &layout).is_ok());
        assert!(hash_encode(zeros([5, 2]), zeros([entries, 2]), &layout).is_err());
        assert!(hash_encode(zeros([5, 3]), zeros([entries - 1, 2]), &layout).is_err());
        assert!(hash_encode(zeros([5, 3]), zeros([entries, 1]), &layout).is_err());
    }
}
