use burn::tensor::Tensor;

use super::{Beside, Bounds, cpu, reference, space_time, space_time_beside};
use crate::testing::{
    assert_agrees, assert_close, assert_same_for_any_thread_count, central_differences, devices,
    normals, random, rng, tensor, to_f64, values,
};

/// One and a half wide about the origin along x, two along y, three from -2 along z.
fn bounds(clamp: bool) -> Bounds {
    Bounds {
        min: [-0.75, -1.0, -2.0],
        scale: [1.0 / 1.5, 0.5, 1.0 / 3.0],
        clamp,
    }
}

#[test]
fn by_hand() {
    let positions = [0.0, 0.0, 1.0, -0.75, 3.0, -5.0];
    for device in devices() {
        let at = |clamp: bool| {
            let positions = tensor(&positions, [2, 3], &device);
            values(space_time(positions, &bounds(clamp), 0.25).expect("three axes"))
        };
        assert_close(
            "inside",
            &to_f64(&at(true)),
            &[0.5, 0.5, 1.0, 0.25, 0.0, 1.0, 0.0, 0.25],
            1e-6,
            0.0,
        );
        assert_close(
            "outside",
            &to_f64(&at(false)),
            &[0.5, 0.5, 1.0, 0.25, 0.0, 2.0, -1.0, 0.25],
            1e-6,
            0.0,
        );
    }
}

#[test]
fn reference_vjp_matches_central_differences() {
    let at = normals(&mut rng(1), 20 * 3);
    let v_out = normals(&mut rng(2), 20 * 4);
    for clamp in [false, true] {
        let bounds = bounds(clamp);
        let expected = central_differences(&at, 1e-6, |at| {
            let out = reference::space_time(at, &bounds, 0.3);
            out.iter().zip(&v_out).map(|(out, v)| out * v).sum()
        });
        let got = reference::space_time_vjp(&at, &v_out, &bounds);
        assert_close("gradient", &got, &expected, 1e-8, 1e-8);
        let moved = got.iter().filter(|v| **v == 0.0).count();
        assert_eq!(moved > 5, clamp, "{moved} on a face");
    }
}

#[test]
fn backends_match_the_reference() {
    for device in devices() {
        let device = device.autodiff();
        for (n, clamp) in [(1, true), (300, true), (300, false), (5000, true)] {
            let name = format!("{device:?}, {n} positions, {clamp}");
            let (positions, v_out) = (random(3, 3 * n), random(4, 4 * n));
            let (bounds, wide) = (bounds(clamp), to_f64(&positions));
            let tracked = tensor(&positions, [n, 3], &device).require_grad();
            let out = space_time(tracked.clone(), &bounds, 0.7).expect("three axes");
            let expected = reference::space_time(&wide, &bounds, f64::from(0.7f32));
            let found = to_f64(&values(out.clone().inner()));
            assert_close(&name, &found, &expected, 3e-7, 3e-7);
            let v_out_tensor = tensor(&v_out, [n, 4], &device);
            let grads = (out * v_out_tensor).sum().backward();
            let gradient = values(tracked.grad(&grads).expect("tracked"));
            let expected = reference::space_time_vjp(&wide, &to_f64(&v_out), &bounds);
            assert_close(&name, &to_f64(&gradient), &expected, 0.0, 1e-6);
            assert_agrees(&name, &gradient, &expected);
        }
    }
}

#[test]
fn points_beside_match_the_reference_and_have_no_gradient() {
    for device in devices() {
        let device = device.autodiff();
        for (n, m, clamp) in [(1, 1, true), (70, 30, false), (300, 500, true)] {
            let name = format!("{device:?}, {n} and {m}, {clamp}");
            let (positions, steps) = (random(13, 3 * n), random(14, 4 * m));
            let steps: Vec<f32> = steps.iter().map(|v| 0.1 * v).collect();
            let rows: Vec<u32> = (0..m).map(|k| (k * 7 % n) as u32).collect();
            let tracked = tensor(&positions, [n, 3], &device).require_grad();
            let given = Beside {
                rows: rows.clone(),
                steps: tensor(&steps, [m, 4], &device),
            };
            let out = space_time_beside(tracked.clone(), given, &bounds(clamp), 0.95);
            let out = out.expect("fits");
            let mut expected =
                reference::space_time(&to_f64(&positions), &bounds(clamp), f64::from(0.95f32));
            expected.extend(reference::beside(&expected, &to_f64(&steps), &rows));
            let found = to_f64(&values(out.clone().inner()));
            assert_close(&name, &found, &expected, 3e-7, 3e-7);
            let v_out = random(15, 4 * (n + m));
            let grads = (out * tensor(&v_out, [n + m, 4], &device)).sum().backward();
            let gradient = values(tracked.grad(&grads).expect("tracked"));
            let v_own = to_f64(&v_out[..4 * n]);
            let expected = reference::space_time_vjp(&to_f64(&positions), &v_own, &bounds(clamp));
            assert_agrees(&name, &gradient, &expected);
        }
        let refused = |rows: Vec<u32>, m: usize| {
            let steps = Tensor::zeros([m, 4], &device);
            let positions = Tensor::zeros([3, 3], &device);
            space_time_beside(positions, Beside { rows, steps }, &bounds(true), 0.5).is_err()
        };
        assert!(refused(vec![3], 1) && refused(vec![0], 2) && !refused(vec![2, 2], 2));
    }
}

#[test]
fn what_is_not_finite_is_at_the_corner_and_has_no_gradient() {
    let positions = [f32::NAN, f32::INFINITY, f32::MAX, 0.0, 0.0, f32::MIN];
    for device in devices() {
        let device = device.autodiff();
        for (clamp, far) in [(true, 1.0), (false, f32::MAX / 3.0)] {
            let tracked = tensor(&positions, [2, 3], &device).require_grad();
            let out = space_time(tracked.clone(), &bounds(clamp), 1.0).expect("three axes");
            let found = values(out.clone().inner());
            assert_eq!(found[..2], [0.0, 0.0], "{device:?}");
            assert!(
                (found[2] / far - 1.0).abs() < 1e-6,
                "{device:?}: {}",
                found[2]
            );
            let v_out = [1.0, 1.0, 1.0, 1.0, f32::NAN, f32::NEG_INFINITY, 1.0, 1.0];
            let grads = (out * tensor(&v_out, [2, 4], &device)).sum().backward();
            let gradient = values(tracked.grad(&grads).expect("tracked"));
            assert_eq!(gradient[3..5], [0.0, 0.0], "{device:?}");
            assert_eq!(gradient[2] == 0.0, clamp, "{device:?}");
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let (positions, v_out) = (random(5, 3 * 20_000), random(6, 4 * 20_000));
    let bounds = bounds(true);
    assert_same_for_any_thread_count("points", || cpu::space_time(&positions, &bounds, 0.5));
    assert_same_for_any_thread_count("gradient", || {
        cpu::space_time_vjp(&positions, &v_out, &bounds)
    });
}

#[test]
fn strided_and_empty_tensors_are_read_and_others_refused() {
    let positions = random(7, 5 * 3);
    for device in devices() {
        let at = |positions| space_time(positions, &bounds(true), 0.5);
        let plain = tensor(&positions, [5, 3], &device);
        let strided = tensor(&values(plain.clone().transpose()), [3, 5], &device).transpose();
        let [plain, strided] = [plain, strided].map(|t| values(at(t).expect("three axes")));
        assert_eq!(plain, strided);
        let empty = at(Tensor::zeros([0, 3], &device)).expect("three axes");
        assert_eq!(empty.dims(), [0, 4]);
        assert!(at(Tensor::zeros([5, 2], &device)).is_err());
        let one = || Tensor::zeros([1, 3], &device);
        assert!(space_time(one(), &bounds(true), f32::NAN).is_err());
        let mut bad = bounds(false);
        bad.scale[1] = f32::INFINITY;
        assert!(space_time(one(), &bad, 0.0).is_err());
    }
}
