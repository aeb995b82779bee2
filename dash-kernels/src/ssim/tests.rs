use burn::tensor::Tensor;

use super::window::{C1, C2, RADIUS, TAPS, window};
use super::{cpu, reference, ssim};
use crate::testing::*;

/// Sizes on both sides of the window and of a tile's width, and no multiples of any vector length.
const SHAPES: [[usize; 3]; 8] = [
    [1, 1, 1],
    [1, 7, 3],
    [5, 1, 2],
    [11, 11, 1],
    [13, 29, 3],
    [64, 33, 3],
    [23, 301, 3],
    [12, 805, 1],
];

fn images(seed: u64, shape: [usize; 3]) -> (Vec<f32>, Vec<f32>, Vec<f32>) {
    let mut rng = rng(seed);
    let n = shape.iter().product();
    let x = uniform(&mut rng, n, 0.0, 1.0);
    let noise = uniform(&mut rng, n, -0.3, 0.3);
    let y = x
        .iter()
        .zip(noise)
        .map(|(x, n)| (x + n).clamp(0.0, 1.0))
        .collect();
    (x, y, uniform(&mut rng, n, -1.0, 1.0))
}

#[test]
fn one_pixel_by_hand() {
    // Everything but the centre is padding: a mean is the value times the centre's weight.
    let w = window()[RADIUS].powi(2);
    let (x, y) = (0.5f64, 0.25f64);
    let (mx, my) = (w * x, w * y);
    let variance = w * (x * x + y * y) - mx * mx - my * my;
    let covariance = w * x * y - mx * my;
    let expected = (2.0 * mx * my + C1) * (2.0 * covariance + C2)
        / ((mx * mx + my * my + C1) * (variance + C2));
    assert_close(
        "reference",
        &reference::ssim(&[x], &[y], [1, 1, 1]),
        &[expected],
        0.0,
        1e-12,
    );
    for device in devices() {
        let one = |v| tensor(&[v], [1, 1, 1], &device);
        let got = values(ssim(one(0.5), one(0.25)).expect("equal shapes"));
        // A GPU adds up in f32.
        assert_close("ssim", &to_f64(&got), &[expected], 0.0, 5e-6);
    }
}

#[test]
fn the_window_is_the_normalised_gaussian() {
    let window = window();
    assert!((window.iter().sum::<f64>() - 1.0).abs() < 1e-15);
    // The values printed in every port of 3D Gaussian Splatting's window.
    assert!((window[RADIUS] - 0.266_011_72).abs() < 1e-7);
    assert!((window[0] - 0.001_028_38).abs() < 1e-7);
    for tap in 0..TAPS {
        assert_eq!(window[tap], window[TAPS - 1 - tap]);
    }
}

#[test]
fn reference_vjp_matches_central_differences() {
    for (seed, shape) in [[4, 5, 2], [13, 12, 1], [1, 1, 1]].into_iter().enumerate() {
        let (x, y, v) = images(seed as u64, shape);
        let (x, y, v) = (to_f64(&x), to_f64(&y), to_f64(&v));
        let (v_x, v_y) = reference::ssim_vjp(&x, &y, &v, shape);
        let by_x = central_differences(&x, 1e-5, |x| dot(&reference::ssim(x, &y, shape), &v));
        let by_y = central_differences(&y, 1e-5, |y| dot(&reference::ssim(&x, y, shape), &v));
        let scale = v_x.iter().fold(0.0f64, |max, v| max.max(v.abs()));
        assert_close(
            "v_x",
            &v_x,
            &by_x,
            DIFFERENCES_RELATIVE * scale,
            DIFFERENCES_RELATIVE,
        );
        assert_close(
            "v_y",
            &v_y,
            &by_y,
            DIFFERENCES_RELATIVE * scale,
            DIFFERENCES_RELATIVE,
        );
    }
}

#[test]
fn backends_match_the_reference() {
    for device in devices() {
        for (seed, shape) in SHAPES.into_iter().enumerate() {
            let (x, y, v) = images(seed as u64, shape);
            let expected = reference::ssim(&to_f64(&x), &to_f64(&y), shape);
            let (v_x, v_y) = reference::ssim_vjp(&to_f64(&x), &to_f64(&y), &to_f64(&v), shape);

            let tracked =
                |values: &[f32]| tensor(values, shape, &device.clone().autodiff()).require_grad();
            let (x, y) = (tracked(&x), tracked(&y));
            let out = ssim(x.clone(), y.clone()).expect("equal shapes");
            assert_agrees("ssim", &values(out.clone().inner()), &expected);
            let v = tensor(&v, shape, &device.clone().autodiff());
            let grads = (out * v).sum().backward();
            assert_agrees("v_x", &values(x.grad(&grads).expect("x is tracked")), &v_x);
            assert_agrees("v_y", &values(y.grad(&grads).expect("y is tracked")), &v_y);
        }
    }
}

/// Smooth images that differ little, as late in training: variances far below C2.
#[test]
fn flat_images_keep_their_gradient() {
    let shape = [40, 50, 3];
    let mut rng = rng(11);
    let n: usize = shape.iter().product();
    let x: Vec<f32> = (0..n)
        .map(|i| 0.6 + 0.3 * (i as f32 * 1e-3).sin())
        .collect();
    let noise = uniform(&mut rng, n, -0.004, 0.004);
    let y: Vec<f32> = x.iter().zip(noise).map(|(x, n)| x + n).collect();
    let v = vec![1.0; n];
    let (v_x, v_y) = reference::ssim_vjp(&to_f64(&x), &to_f64(&y), &to_f64(&v), shape);
    assert_agrees("v_x", &cpu::ssim_vjp(&x, &y, &v, shape), &v_x);
    assert_agrees("v_y", &cpu::ssim_vjp(&y, &x, &v, shape), &v_y);
}

/// A difference that the tolerances must not swallow: one image off by a pixel.
#[test]
fn a_shifted_image_is_noticed() {
    let shape = [20, 30, 3];
    let (x, y, v) = images(12, shape);
    let mut shifted = y.clone();
    shifted.rotate_left(3);
    let expected = reference::ssim(&to_f64(&x), &to_f64(&y), shape);
    assert!(disagreement(&cpu::ssim(&x, &shifted, shape), &expected).is_some());
    let (v_x, _) = reference::ssim_vjp(&to_f64(&x), &to_f64(&y), &to_f64(&v), shape);
    assert!(disagreement(&cpu::ssim_vjp(&x, &shifted, &v, shape), &v_x).is_some());
}

#[test]
fn an_untracked_image_gets_no_gradient() {
    let shape = [6, 9, 3];
    for device in devices() {
        let device = device.autodiff();
        let (x, y, _) = images(3, shape);
        let x = tensor(&x, shape, &device).require_grad();
        let y = tensor(&y, shape, &device);
        let grads = ssim(x.clone(), y.clone())
            .expect("equal shapes")
            .sum()
            .backward();
        assert!(x.grad(&grads).is_some());
        assert!(y.grad(&grads).is_none());
    }
}

#[test]
fn constants_stay_close_to_f64() {
    for shape in SHAPES {
        let n = shape.iter().product();
        for (a, b) in [
            (1.0, 1.0),
            (0.7, 0.7),
            (0.3, 0.31),
            (255.0, 255.0),
            (1e-3, 1.0),
        ] {
            let (x, y) = (vec![a; n], vec![b; n]);
            let expected = reference::ssim(&to_f64(&x), &to_f64(&y), shape);
            let got = to_f64(&cpu::ssim(&x, &y, shape));
            assert_close("v", &got, &expected, 1e-6, 1e-6);
        }
    }
}

#[test]
fn an_image_is_like_itself_and_similarity_is_symmetric_and_bounded() {
    for (seed, shape) in SHAPES.into_iter().enumerate() {
        let (x, y, _) = images(seed as u64, shape);
        for same in cpu::ssim(&x, &x, shape) {
            assert!((same - 1.0).abs() < 1e-6, "got {same}");
        }
        assert_eq!(
            bits(&cpu::ssim(&x, &y, shape)),
            bits(&cpu::ssim(&y, &x, shape))
        );
        let negative: Vec<f32> = x.iter().map(|v| 0.9 - v).collect();
        for value in cpu::ssim(&x, &negative, shape) {
            assert!((-1.0..=1.0).contains(&value), "got {value}");
        }
    }
}

#[test]
fn poisoned_and_huge_pixels_give_finite_results() {
    let shape = [12, 17, 3];
    for poison in [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        1e20,
        1e-40,
    ] {
        let (mut x, y, v) = images(5, shape);
        x[100] = poison;
        let out = cpu::ssim(&x, &y, shape);
        assert!(out.iter().all(|v| (-1.0..=1.0).contains(v)), "{poison}");
        let v_x = cpu::ssim_vjp(&x, &y, &v, shape);
        assert!(v_x.iter().all(|v| v.is_finite()), "{poison}");
        if !poison.is_finite() {
            assert_eq!(v_x[100], 0.0);
            let mut zeroed = x.clone();
            zeroed[100] = 0.0;
            assert_eq!(bits(&out), bits(&cpu::ssim(&zeroed, &y, shape)));
        }
    }
}

#[test]
fn non_contiguous_images_are_read_in_their_order() {
    let shape = [9, 14, 3];
    let (x, y, _) = images(8, shape);
    for device in devices() {
        let plain = |values: &[f32]| tensor(values, shape, &device);
        // Through a copy of the channels-first layout and back: the same values, other strides.
        let strided = |values: &[f32]| {
            let channels_first = values_of_permuted(plain(values));
            tensor(&channels_first, [3, 9, 14], &device).permute([1, 2, 0])
        };
        let expected = values(ssim(plain(&x), plain(&y)).expect("equal shapes"));
        let got = values(ssim(strided(&x), strided(&y)).expect("equal shapes"));
        assert_eq!(bits(&got), bits(&expected));
    }
}

fn values_of_permuted(image: Tensor<3>) -> Vec<f32> {
    values(image.permute([2, 0, 1]))
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let shape = [97, 41, 3];
    let (x, y, v) = images(9, shape);
    let run = || (cpu::ssim(&x, &y, shape), cpu::ssim_vjp(&x, &y, &v, shape));
    let one = with_threads(1, run);
    for threads in [2, 8] {
        let many = with_threads(threads, run);
        assert_eq!(bits(&one.0), bits(&many.0));
        assert_eq!(bits(&one.1), bits(&many.1));
    }
}

#[test]
fn other_shapes_and_empty_images_are_refused() {
    for device in devices() {
        let zeros = |shape| Tensor::<3>::zeros(shape, &device);
        assert!(ssim(zeros([2, 3, 1]), zeros([3, 2, 1])).is_err());
        assert!(ssim(zeros([0, 3, 1]), zeros([0, 3, 1])).is_err());
    }
}
