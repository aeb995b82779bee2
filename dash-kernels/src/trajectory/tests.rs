use burn::tensor::Tensor;

use super::{Polyline, cpu, reference, squared_extent};
use crate::testing::{
    assert_agrees, assert_close, assert_same_for_any_thread_count, central_differences, devices,
    normals, random, rng, tensor, to_f64, values,
};

/// Anchors at both ends, on knots and between them.
const FORMS: [(usize, f32); 9] = [
    (1, 0.0),
    (1, 0.3),
    (1, 1.0),
    (2, 0.5),
    (5, 0.0),
    (5, 1.0),
    (12, 0.53),
    (48, 0.506),
    (48, 0.25),
];

fn polyline(n_spans: usize, anchor: f32) -> Polyline {
    Polyline::new(n_spans, anchor).expect("a time in [0, 1]")
}

#[test]
fn by_hand() {
    // Along x: at -2.5, -0.5, 0.5, 3.5 when the knots are passed, at 0 in the middle of the second span.
    let row = [2.0, 0.0, 0.0, 1.0, 0.0, 0.0, 3.0, 0.0, 0.0];
    let squares = 2.5f64.powi(2) + 0.25 + 0.25 + 3.5f64.powi(2);
    let steady = 2.0 * (0.5f64.powi(2) + (1.0f64 / 6.0).powi(2));
    let expected = [squares / steady];
    assert_close(
        "reference",
        &reference::squared_extent(&to_f64(&row), 3, 0.5),
        &expected,
        0.0,
        1e-12,
    );
    for device in devices() {
        let got = squared_extent(tensor(&row, [1, 9], &device), polyline(3, 0.5));
        let got = to_f64(&values(got.expect("nine coefficients")));
        assert_close(&format!("{device:?}"), &got, &expected, 0.0, 1e-6);
    }
}

#[test]
fn a_steady_motion_of_length_one_has_extent_one() {
    for (n_spans, anchor) in FORMS {
        let row = [0.0, -1.0 / n_spans as f64, 0.0].repeat(n_spans);
        let got = reference::squared_extent(&row, n_spans, f64::from(anchor));
        assert_close("steady", &got, &[1.0], 0.0, 1e-12);
    }
}

#[test]
fn reference_vjp_matches_central_differences() {
    for (n_spans, anchor) in [(1, 0.3), (4, 0.0), (5, 0.53), (3, 1.0)] {
        let at = normals(&mut rng(1), 2 * 3 * n_spans);
        let v_out = [0.7, -1.3];
        let expected = central_differences(&at, 1e-5, |at| {
            let out = reference::squared_extent(at, n_spans, anchor);
            out.iter().zip(v_out).map(|(out, v)| out * v).sum()
        });
        let got = reference::squared_extent_vjp(&at, &v_out, n_spans, anchor);
        assert_close("gradient", &got, &expected, 1e-7, 1e-7);
    }
}

#[test]
fn backends_match_the_reference() {
    for device in devices() {
        for (n_spans, anchor) in FORMS {
            for n in [1, 7, 300] {
                let name = format!("{device:?}, {n_spans} spans at rest at {anchor}, {n} rows");
                let coefficients = random(2, n * 3 * n_spans);
                let v_out = random(3, n);
                let wide = to_f64(&coefficients);
                // Where between its knots the anchor lies is a matter of f32.
                let at = f64::from(anchor * n_spans as f32) / n_spans as f64;
                let expected = reference::squared_extent(&wide, n_spans, at);
                let device = device.clone().autodiff();
                let tracked = tensor(&coefficients, [n, 3 * n_spans], &device).require_grad();
                let out = squared_extent(tracked.clone(), polyline(n_spans, anchor))
                    .expect("the right shape");
                let found = to_f64(&values(out.clone().inner()));
                assert_close(&name, &found, &expected, 1e-6, 3e-6);
                let grads = (out * tensor(&v_out, [n], &device)).sum().backward();
                let gradient = values(tracked.grad(&grads).expect("tracked"));
                let expected = reference::squared_extent_vjp(&wide, &to_f64(&v_out), n_spans, at);
                assert_agrees(&name, &gradient, &expected);
            }
        }
    }
}

#[test]
fn long_trajectories_that_return_do_not_cancel() {
    let n_spans = 48;
    let mut row = vec![0.0f32; 3 * n_spans];
    // Far away and back before the anchor; a thousandth after it.
    (row[0], row[3]) = (1e6, -1e6);
    row[3 * 40] = 1e-3;
    let out = cpu::squared_extent_vjp(&row, &[1.0], polyline(n_spans, 0.5));
    let expected = reference::squared_extent_vjp(&to_f64(&row), &[1.0], n_spans, 0.5);
    let after = 3 * n_spans / 2..;
    assert_close(
        "after the anchor",
        &to_f64(&out[after.clone()]),
        &expected[after],
        0.0,
        1e-6,
    );
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let (n, n_spans) = (5_000, 12);
    let coefficients = random(4, n * 3 * n_spans);
    let v_out = random(5, n);
    let polyline = polyline(n_spans, 0.4);
    assert_same_for_any_thread_count("extent", || cpu::squared_extent(&coefficients, polyline));
    assert_same_for_any_thread_count("gradient", || {
        cpu::squared_extent_vjp(&coefficients, &v_out, polyline)
    });
}

#[test]
fn strided_and_empty_tensors_are_read_and_other_shapes_refused() {
    let rows = random(6, 5 * 9);
    for device in devices() {
        let plain = tensor(&rows, [5, 9], &device);
        let strided = tensor(&values(plain.clone().transpose()), [9, 5], &device).transpose();
        let extent = |coefficients| squared_extent(coefficients, polyline(3, 0.2));
        let [plain, strided] = [plain, strided].map(|t| values(extent(t).expect("nine wide")));
        assert_eq!(plain, strided);
        let empty = extent(Tensor::zeros([0, 9], &device)).expect("nine wide");
        assert_eq!(empty.dims(), [0]);
        assert!(extent(Tensor::zeros([5, 6], &device)).is_err());
    }
    assert!(Polyline::new(0, 0.0).is_err());
    for anchor in [-0.1, 1.1, f32::NAN] {
        assert!(Polyline::new(3, anchor).is_err(), "{anchor}");
    }
}
