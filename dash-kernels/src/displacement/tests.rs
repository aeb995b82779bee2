use burn::tensor::Tensor;
use rand::Rng;

use super::{cpu, displacement, reference};
use crate::testing::{
    assert_agrees, assert_close, assert_same_for_any_thread_count, central_differences, devices,
    normals, random, rng, tensor, to_f64, values,
};

fn basis(seed: u64, n: usize) -> Vec<f32> {
    let mut rng = rng(seed);
    (0..n).map(|_| rng.random_range(-1.0..=1.0)).collect()
}

#[test]
fn by_hand() {
    let row = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    for device in devices() {
        let moved = displacement(tensor(&row, [1, 6], &device), &[1.0, -0.5]).expect("six wide");
        assert_eq!(values(moved), [-1.0, -0.5, 0.0], "{device:?}");
    }
}

#[test]
fn reference_vjp_matches_central_differences() {
    let basis = to_f64(&basis(1, 4));
    let at = normals(&mut rng(2), 2 * 12);
    let v_out = normals(&mut rng(3), 2 * 3);
    let expected = central_differences(&at, 1e-5, |at| {
        let out = reference::displacement(at, &basis);
        out.iter().zip(&v_out).map(|(out, v)| out * v).sum()
    });
    let got = reference::displacement_vjp(&v_out, &basis);
    assert_close("gradient", &got, &expected, 1e-9, 1e-9);
}

/// To the precision of f32, which products on tensor cores miss by three digits.
#[test]
fn backends_match_the_reference() {
    for device in devices() {
        for (n_functions, n) in [(1, 1), (2, 7), (12, 300), (48, 300)] {
            let name = format!("{device:?}, {n_functions} functions, {n} rows");
            let basis = basis(4, n_functions);
            let (coefficients, v_out) = (random(5, n * 3 * n_functions), random(6, n * 3));
            let wide = to_f64(&basis);
            let device = device.clone().autodiff();
            let tracked = tensor(&coefficients, [n, 3 * n_functions], &device).require_grad();
            let out = displacement(tracked.clone(), &basis).expect("the right shape");
            let expected = reference::displacement(&to_f64(&coefficients), &wide);
            let found = to_f64(&values(out.clone().inner()));
            assert_close(&name, &found, &expected, 3e-6, 1e-6);
            let grads = (out * tensor(&v_out, [n, 3], &device)).sum().backward();
            let gradient = values(tracked.grad(&grads).expect("tracked"));
            let expected = reference::displacement_vjp(&to_f64(&v_out), &wide);
            assert_close(&name, &to_f64(&gradient), &expected, 0.0, 1e-6);
            assert_agrees(&name, &gradient, &expected);
        }
    }
}

#[test]
fn the_largest_numbers_stay_finite() {
    let rows = [f32::MAX, f32::MIN, 1.0, f32::MAX, f32::MIN, f32::INFINITY];
    for device in devices() {
        let device = device.autodiff();
        let tracked = tensor(&rows, [1, 6], &device).require_grad();
        let out = displacement(tracked.clone(), &[1.0, 3.0]).expect("six wide");
        assert_eq!(values(out.clone().inner()), [f32::MAX, f32::MIN, 1.0]);
        let v_out = tensor(&[f32::MAX, f32::NAN, -1.0], [1, 3], &device);
        let grads = (out * v_out).sum().backward();
        let gradient = values(tracked.grad(&grads).expect("tracked"));
        assert_eq!(gradient, [f32::MAX, 0.0, -1.0, f32::MAX, 0.0, -3.0]);
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let basis = basis(7, 12);
    let (coefficients, v_out) = (random(8, 5_000 * 36), random(9, 5_000 * 3));
    assert_same_for_any_thread_count("moved", || cpu::displacement(&coefficients, &basis));
    assert_same_for_any_thread_count("gradient", || cpu::displacement_vjp(&v_out, &basis));
}

#[test]
fn strided_and_empty_tensors_are_read_and_others_refused() {
    let rows = random(10, 5 * 9);
    for device in devices() {
        let plain = tensor(&rows, [5, 9], &device);
        let strided = tensor(&values(plain.clone().transpose()), [9, 5], &device).transpose();
        let moved = |coefficients| displacement(coefficients, &[0.2, 1.0, -0.7]);
        let [plain, strided] = [plain, strided].map(|t| values(moved(t).expect("nine wide")));
        assert_eq!(plain, strided);
        let empty = moved(Tensor::zeros([0, 9], &device)).expect("nine wide");
        assert_eq!(empty.dims(), [0, 3]);
        let still = displacement(Tensor::zeros([2, 0], &device), &[]).expect("no functions");
        assert_eq!(values(still), [0.0; 6]);
        assert!(moved(Tensor::zeros([5, 6], &device)).is_err());
        for bad in [f32::NAN, f32::NEG_INFINITY] {
            assert!(displacement(Tensor::zeros([1, 3], &device), &[bad]).is_err());
        }
    }
}
