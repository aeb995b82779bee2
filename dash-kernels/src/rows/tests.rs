use burn::tensor::Tensor;

use super::{join_rows, reference, take_rows};
use crate::testing::{
    assert_close, central_differences, devices, normals, rng, tensor, to_f32, to_f64, values,
};

#[test]
fn by_hand() {
    let matrix = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
    for device in devices() {
        let device = device.autodiff();
        let tracked = tensor(&matrix, [4, 2], &device).require_grad();
        let taken = take_rows(tracked.clone(), &[0, 3]).expect("ascending");
        assert_eq!(values(taken.clone().inner()), [1.0, 2.0, 7.0, 8.0]);
        let weights = tensor(&[10.0, 20.0, 30.0, 40.0], [2, 2], &device);
        let grads = (taken * weights).sum().backward();
        let gradient = values(tracked.grad(&grads).expect("tracked"));
        assert_eq!(
            gradient,
            [10.0, 20.0, 0.0, 0.0, 0.0, 0.0, 30.0, 40.0],
            "{device:?}"
        );
    }
}

#[test]
fn what_is_not_finite_counts_as_zero() {
    let matrix = [1.0, f32::NAN, 3.0, 4.0, f32::NEG_INFINITY, f32::MAX];
    for device in devices() {
        let device = device.autodiff();
        let tracked = tensor(&matrix, [3, 2], &device).require_grad();
        let taken = take_rows(tracked.clone(), &[0, 2]).expect("ascending");
        assert_eq!(values(taken.clone().inner()), [1.0, 0.0, 0.0, f32::MAX]);
        let v_out = tensor(&[f32::INFINITY, -1.0, f32::NAN, f32::MIN], [2, 2], &device);
        let grads = (taken * v_out).sum().backward();
        let gradient = values(tracked.grad(&grads).expect("tracked"));
        assert_eq!(gradient, [0.0, -1.0, 0.0, 0.0, 0.0, f32::MIN]);
    }
}

#[test]
fn reference_vjp_matches_central_differences() {
    let (n, width, rows) = (5, 3, [0, 2, 4]);
    let at = normals(&mut rng(1), n * width);
    let v_out = normals(&mut rng(2), rows.len() * width);
    let expected = central_differences(&at, 1e-5, |at| {
        let out = reference::take_rows(at, width, &rows);
        out.iter().zip(&v_out).map(|(out, v)| out * v).sum()
    });
    let got = reference::take_rows_vjp(&v_out, n, width, &rows);
    assert_close("gradient", &got, &expected, 1e-9, 1e-9);
}

/// Values and gradients, bit for bit: nothing is rounded. Widths that tensors of padded rows have and have not.
#[test]
fn backends_match_the_reference() {
    for device in devices() {
        let device = device.autodiff();
        for (n, width, step) in [(1, 1, 1), (7, 3, 2), (300, 16, 1), (1000, 147, 3)] {
            let name = format!("{device:?}, {n} rows of {width}");
            let rows: Vec<u32> = (0..n as u32).step_by(step).collect();
            let matrix = to_f32(&normals(&mut rng(1), n * width));
            let v_out = to_f32(&normals(&mut rng(2), rows.len() * width));
            let tracked = tensor(&matrix, [n, width], &device).require_grad();
            let taken = take_rows(tracked.clone(), &rows).expect("ascending");
            let expected = reference::take_rows(&to_f64(&matrix), width, &rows);
            assert_eq!(to_f64(&values(taken.clone().inner())), expected, "{name}");
            let v_taken = tensor(&v_out, [rows.len(), width], &device);
            let grads = (taken * v_taken).sum().backward();
            let gradient = values(tracked.grad(&grads).expect("tracked"));
            let expected = reference::take_rows_vjp(&to_f64(&v_out), n, width, &rows);
            assert_eq!(to_f64(&gradient), expected, "{name}");
        }
    }
}

#[test]
fn strided_tensors_are_read() {
    let rows = to_f32(&normals(&mut rng(3), 5 * 4));
    for device in devices() {
        let plain = tensor(&rows, [5, 4], &device);
        let strided = tensor(&values(plain.clone().transpose()), [4, 5], &device).transpose();
        let [plain, strided] =
            [plain, strided].map(|t| values(take_rows(t, &[1, 4]).expect("ascending")));
        assert_eq!(plain, strided, "{device:?}");
    }
}

#[test]
fn nothing_is_taken_of_nothing_and_of_no_columns() {
    for device in devices() {
        let empty = take_rows(tensor(&[], [0, 3], &device), &[]).expect("no rows");
        assert_eq!(empty.dims(), [0, 3]);
        let narrow = take_rows(tensor(&[], [4, 0], &device), &[1, 2]).expect("no columns");
        assert_eq!(narrow.dims(), [2, 0]);
    }
}

#[test]
fn rows_that_are_not_there_and_rows_twice_are_refused() {
    for device in devices() {
        let refused = |rows: &[u32]| {
            let matrix = tensor(&[0.0; 6], [3, 2], &device);
            take_rows(matrix, rows).expect_err("refused").to_string()
        };
        assert!(refused(&[0, 3]).contains("row 3, expected rows below 3"));
        assert!(refused(&[1, 1]).contains("ascending"));
        assert!(refused(&[2, 0]).contains("row 0 after row 2"));
    }
}

#[test]
fn joined_rows_and_their_gradients_are_the_references() {
    for device in devices() {
        let device = device.autodiff();
        for (n, m, width) in [(1, 1, 1), (2, 3, 5), (700, 90, 12)] {
            let name = format!("{device:?}, {n} and {m} rows of {width}");
            let random = |seed, rows| to_f32(&normals(&mut rng(seed), rows * width));
            let (first, second, v_out) = (random(4, n), random(5, m), random(6, n + m));
            for tracked in [[true, true], [true, false], [false, true]] {
                let [a, b] = [(&first, n, tracked[0]), (&second, m, tracked[1])].map(
                    |(rows, n, tracked)| {
                        tensor(rows, [n, width], &device).set_require_grad(tracked)
                    },
                );
                let joined = join_rows(a.clone(), b.clone()).expect("of one width");
                let expected = reference::join_rows(&to_f64(&first), &to_f64(&second));
                assert_eq!(to_f64(&values(joined.clone().inner())), expected, "{name}");
                let weights = tensor(&v_out, [n + m, width], &device);
                let grads = (joined * weights).sum().backward();
                let expected = reference::join_rows_vjp(&to_f64(&v_out), n * width);
                for ((part, expected), tracked) in [a, b].into_iter().zip(expected).zip(tracked) {
                    let found = part.grad(&grads).map(|gradient| to_f64(&values(gradient)));
                    assert_eq!(found, tracked.then_some(expected), "{name}");
                }
            }
        }
    }
}

#[test]
fn reference_vjp_of_joined_rows_matches_central_differences() {
    let at = normals(&mut rng(7), 5 * 2);
    let v_out = normals(&mut rng(8), 5 * 2);
    let expected = central_differences(&at, 1e-5, |at| {
        let out = reference::join_rows(&at[..6], &at[6..]);
        out.iter().zip(&v_out).map(|(out, v)| out * v).sum()
    });
    let got = reference::join_rows_vjp(&v_out, 6).concat();
    assert_close("gradient", &got, &expected, 1e-9, 1e-9);
}

#[test]
fn nothing_joined_is_the_other_and_widths_must_agree() {
    for device in devices() {
        let none = || Tensor::<2>::zeros([0, 2], &device);
        let some = || tensor(&[1.0, 2.0], [1, 2], &device);
        for (first, second) in [(none(), some()), (some(), none())] {
            let joined = join_rows(first, second).expect("of one width");
            assert_eq!(values(joined), [1.0, 2.0]);
        }
        assert_eq!(
            join_rows(none(), none()).expect("of one width").dims(),
            [0, 2]
        );
        assert!(join_rows(some(), tensor(&[1.0], [1, 1], &device)).is_err());
    }
}
