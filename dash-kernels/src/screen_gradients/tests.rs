use burn::tensor::Tensor;

use super::{SUMS, add_screen_gradients, cpu, reference};
use crate::splats::{MEAN_X, MEAN_Y, N_COLUMNS, RADIUS_X};
use crate::testing::{
    assert_close, assert_same_for_any_thread_count, devices, normals, poison, rng, tensor, to_f32,
    to_f64, uniform, values,
};

const HALF_SIZE: [f32; 2] = [160.0, 90.0];

/// Gradients, and splats of which about half are drawn.
fn rows(seed: u64, n: usize) -> [Vec<f32>; 2] {
    let mut rng = rng(seed);
    let mut random = || to_f32(&normals(&mut rng, n * N_COLUMNS));
    [random(), random()]
}

#[test]
fn backends_match_the_reference() {
    for device in devices() {
        for (seed, n) in [(1, 1), (2, 77), (3, 5_000)] {
            let [v_splats, splats] = rows(seed, n);
            let before = uniform(&mut rng(seed + 10), n * SUMS, 0.0, 9.0);
            let found = add_screen_gradients(
                tensor(&before, [n, SUMS], &device),
                // Behind the rows of another set.
                tensor(
                    &[vec![9.0; 3 * N_COLUMNS], v_splats.clone()].concat(),
                    [3 + n, N_COLUMNS],
                    &device,
                ),
                3,
                tensor(&splats, [n, N_COLUMNS], &device),
                HALF_SIZE,
            );
            let expected = reference::add_screen_gradients(
                &to_f64(&before),
                &to_f64(&v_splats),
                &to_f64(&splats),
                HALF_SIZE.map(f64::from),
            );
            let found = to_f64(&values(found.expect("fits")));
            assert_close(&format!("{device:?}"), &found, &expected, 1e-6, 1e-6);
        }
    }
}

/// The sums outlive their sharing: what somebody else holds does not change.
#[test]
fn sums_that_are_shared_are_not_changed() {
    for device in devices() {
        let [v_splats, splats] = rows(4, 9);
        let [v_splats, splats] = [v_splats, splats].map(|v| tensor(&v, [9, N_COLUMNS], &device));
        let before = Tensor::<2>::zeros([9, SUMS], &device);
        let after = add_screen_gradients(before.clone(), v_splats, 0, splats, HALF_SIZE);
        assert!(values(before).iter().all(|&v| v == 0.0), "{device:?}");
        assert!(values(after.expect("fits")).iter().any(|&v| v > 0.0));
    }
}

#[test]
fn a_gradient_that_is_not_finite_is_not_counted() {
    for device in devices() {
        for poison in poison() {
            let mut v_splats = vec![0.0; 2 * N_COLUMNS];
            v_splats[MEAN_X] = poison;
            v_splats[N_COLUMNS + MEAN_Y] = 1.0;
            let mut splats = vec![0.0; 2 * N_COLUMNS];
            (splats[RADIUS_X], splats[N_COLUMNS + RADIUS_X]) = (1.0, 1.0);
            let sums = add_screen_gradients(
                Tensor::zeros([2, SUMS], &device),
                tensor(&v_splats, [2, N_COLUMNS], &device),
                0,
                tensor(&splats, [2, N_COLUMNS], &device),
                [1.0, 1.0],
            );
            let sums = values(sums.expect("fits"));
            let name = format!("{device:?}, {poison}");
            assert!(sums.iter().all(|v| v.is_finite()), "{name}: {sums:?}");
            assert_eq!(sums[1], f32::from(u8::from(poison.is_finite())), "{name}");
            assert_eq!(sums[2..], [1.0, 1.0], "{name}");
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let [v_splats, splats] = rows(5, 20_000);
    assert_same_for_any_thread_count("sums", || {
        let mut sums = vec![0.5; 20_000 * SUMS];
        cpu::add_screen_gradients(&mut sums, &v_splats, &splats, HALF_SIZE);
        sums
    });
}

#[test]
fn other_shapes_are_refused_and_nothing_is_nothing() {
    for device in devices() {
        let zeros = |n: usize, width: usize| Tensor::<2>::zeros([n, width], &device);
        let add = |sums, v_splats, first, splats| {
            add_screen_gradients(sums, v_splats, first, splats, HALF_SIZE)
        };
        assert!(add(zeros(3, 1), zeros(3, 16), 0, zeros(3, 16)).is_err());
        assert!(add(zeros(2, 2), zeros(3, 16), 0, zeros(3, 16)).is_err());
        assert!(add(zeros(3, 2), zeros(2, 16), 0, zeros(3, 16)).is_err());
        assert!(add(zeros(3, 2), zeros(4, 16), 2, zeros(3, 16)).is_err());
        assert!(add(zeros(3, 2), zeros(3, 16), 0, zeros(3, 10)).is_err());
        let none = add(zeros(0, 2), zeros(0, 16), 0, zeros(0, 16)).expect("fits");
        assert_eq!(none.dims(), [0, 2]);
    }
}
