use burn::tensor::{Int, Tensor, TensorData};

use super::take_rows;
use crate::testing::{devices, normals, rng, tensor, to_f32, values};

#[test]
fn by_hand() {
    let matrix = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, f32::INFINITY];
    for device in devices() {
        let device = device.autodiff();
        let tracked = tensor(&matrix, [4, 2], &device).require_grad();
        let taken = take_rows(tracked.clone(), &[0, 3]).expect("ascending");
        assert_eq!(
            values(taken.clone().inner()),
            [1.0, 2.0, 7.0, f32::INFINITY],
            "{device:?}"
        );
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

/// Values and gradients, bit for bit, of widths that tensors of padded rows have and have not.
#[test]
fn rows_are_those_that_select_gives() {
    for device in devices() {
        let device = device.autodiff();
        for (n, width, step) in [(1, 1, 1), (7, 3, 2), (300, 16, 1), (1000, 147, 3)] {
            let name = format!("{device:?}, {n} rows of {width}");
            let rows: Vec<u32> = (0..n as u32).step_by(step).collect();
            let indices: Vec<i32> = rows.iter().map(|&row| row as i32).collect();
            let indices =
                Tensor::<1, Int>::from_data(TensorData::new(indices, [rows.len()]), &device);
            let matrix = to_f32(&normals(&mut rng(1), n * width));
            let weights = to_f32(&normals(&mut rng(2), rows.len() * width));
            let weights = tensor(&weights, [rows.len(), width], &device);
            let both = |take: &dyn Fn(Tensor<2>) -> Tensor<2>| {
                let tracked = tensor(&matrix, [n, width], &device).require_grad();
                let taken = take(tracked.clone());
                let grads = (taken.clone() * weights.clone()).sum().backward();
                let gradient = tracked.grad(&grads).expect("tracked");
                (values(taken.inner()), values(gradient))
            };
            let expected = both(&|matrix| matrix.select(0, indices.clone()));
            let found = both(&|matrix| take_rows(matrix, &rows).expect("ascending"));
            assert_eq!(found, expected, "{name}");
        }
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
        assert!(refused(&[0, 3]).contains("row 3 of 3"));
        assert!(refused(&[1, 1]).contains("ascending"));
        assert!(refused(&[2, 0]).contains("row 0 after row 2"));
    }
}
