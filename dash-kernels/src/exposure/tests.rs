use burn::tensor::Tensor;

use super::{CHANNELS, RESPONSE, cpu, expose, reference};
use crate::splats::{N_COLUMNS, RED};
use crate::testing::{
    assert_agrees, assert_close, assert_same_for_any_thread_count, central_differences, devices,
    normals, random, rng, tensor, to_f64, values,
};

#[test]
fn reference_vjp_matches_central_differences() {
    let n = 3 * N_COLUMNS;
    let both = normals(&mut rng(1), n + RESPONSE);
    let v_out = normals(&mut rng(2), n);
    let expected = central_differences(&both, 1e-5, |both| {
        let (splats, response) = both.split_at(n);
        let out = reference::expose(splats, response);
        out.iter().zip(&v_out).map(|(out, v)| out * v).sum()
    });
    let (splats, response) = both.split_at(n);
    let (v_splats, v_response) = reference::expose_vjp(splats, response, &v_out);
    let got = [v_splats, v_response].concat();
    assert_close("gradient", &got, &expected, 1e-8, 1e-8);
}

#[test]
fn backends_match_the_reference() {
    for device in devices() {
        for n in [1, 33, 9_000] {
            let name = format!("{device:?}, {n} splats");
            let (splats, v_out) = (random(3, n * N_COLUMNS), random(4, n * N_COLUMNS));
            let response = random(5, RESPONSE);
            let device = device.clone().autodiff();
            let leaves = (
                tensor(&splats, [n, N_COLUMNS], &device).require_grad(),
                tensor(&response, [2, CHANNELS], &device).require_grad(),
            );
            let out = expose(leaves.0.clone(), leaves.1.clone()).expect("fits");
            let wide = [&splats, &response, &v_out].map(|values| to_f64(values));
            let expected = reference::expose(&wide[0], &wide[1]);
            let found = to_f64(&values(out.clone().inner()));
            assert_close(&name, &found, &expected, 1e-6, 1e-6);
            assert_eq!(
                values(leaves.0.clone().inner()),
                splats,
                "{name}: not changed"
            );
            let grads = (out * tensor(&v_out, [n, N_COLUMNS], &device))
                .sum()
                .backward();
            let expected = reference::expose_vjp(&wide[0], &wide[1], &wide[2]);
            let v_splats = values(leaves.0.grad(&grads).expect("tracked"));
            assert_agrees(&name, &v_splats, &expected.0);
            let v_response = values(leaves.1.grad(&grads).expect("tracked"));
            assert_agrees(&name, &v_response, &expected.1);
        }
    }
}

/// One splat at fault does not take the camera's exposure with it.
#[test]
fn a_gradient_that_is_not_finite_does_not_count_for_the_response() {
    for device in devices() {
        let device = device.autodiff();
        for poison in [f32::NAN, f32::INFINITY, f32::MAX] {
            let splats = vec![4.0; 2 * N_COLUMNS];
            let mut v_out = vec![1.0; 2 * N_COLUMNS];
            v_out[RED] = poison;
            let response = tensor(&[0.0; RESPONSE], [2, CHANNELS], &device).require_grad();
            let splats = tensor(&splats, [2, N_COLUMNS], &device);
            let out = expose(splats, response.clone()).expect("fits");
            let grads = (out * tensor(&v_out, [2, N_COLUMNS], &device))
                .sum()
                .backward();
            let found = values(response.grad(&grads).expect("tracked"));
            if poison == f32::MAX {
                // A CPU adds in f64, whose product is finite.
                assert!(found[1..3] == [8.0, 8.0] && found[4..] == [2.0, 2.0]);
            } else {
                assert_eq!(found, [4.0, 8.0, 8.0, 1.0, 2.0, 2.0], "{device:?}");
            }
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let (splats, v_out) = (random(6, 20_000 * N_COLUMNS), random(7, 20_000 * N_COLUMNS));
    let response = random(8, RESPONSE);
    assert_same_for_any_thread_count("gradient", || {
        let (v_splats, v_response) = cpu::expose_vjp(&splats, &response, &v_out);
        [v_splats, v_response.to_vec()].concat()
    });
}

#[test]
fn other_shapes_are_refused_and_nothing_is_nothing() {
    for device in devices() {
        let zeros = |shape: [usize; 2]| Tensor::<2>::zeros(shape, &device);
        assert!(expose(zeros([2, 10]), zeros([2, 3])).is_err());
        assert!(expose(zeros([2, N_COLUMNS]), zeros([3, 2])).is_err());
        let none = expose(zeros([0, N_COLUMNS]), zeros([2, 3])).expect("fits");
        assert_eq!(none.dims(), [0, N_COLUMNS]);
    }
}
