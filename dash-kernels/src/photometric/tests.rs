use burn::tensor::{Device, Tensor};

use super::{Photometric, cpu, photometric, reference};
use crate::testing::*;

/// Below, at and above the window, a tile and a band, and no multiples of any vector length.
const SHAPES: [[usize; 3]; 6] = [
    [1, 1, 1],
    [1, 7, 3],
    [11, 11, 1],
    [13, 29, 3],
    [64, 33, 3],
    [23, 301, 3],
];
const WEIGHTS: [f32; 3] = [0.0, 0.2, 1.0];

/// An image, and a target that it equals in places.
fn images(seed: u64, shape: [usize; 3]) -> (Vec<f32>, Vec<f32>) {
    let mut rng = rng(seed);
    let n = shape.iter().product();
    let image = uniform(&mut rng, n, 0.0, 1.0);
    let noise = uniform(&mut rng, n, -0.3, 0.3);
    let target = image
        .iter()
        .zip(noise)
        .enumerate()
        .map(|(i, (x, n))| if i % 5 == 1 { *x } else { x + n })
        .collect();
    (image, target)
}

fn both_of(found: Photometric) -> [f64; 2] {
    [found.loss, found.mse].map(|value| f64::from(values(value)[0]))
}

#[test]
fn one_pixel_by_hand() {
    for device in devices() {
        let one = |v| tensor(&[v], [1, 1, 1], &device);
        let found = photometric(one(0.75), one(0.5), 0.0).expect("equal shapes");
        assert_eq!(both_of(found), [0.25, 0.0625]);
        // The similarity of a pixel and zero, everything around it being zero too.
        let similarity = crate::ssim::reference::ssim(&[0.75f64], &[0.0], [1, 1, 1])[0];
        let [loss, mse] = both_of(photometric(one(0.75), one(0.0), 0.2).expect("equal shapes"));
        assert!(
            (loss - (0.8 * 0.75 + 0.2 * (1.0 - similarity))).abs() < 5e-6,
            "{loss}"
        );
        assert_eq!(mse, 0.5625);
    }
}

#[test]
fn reference_gradient_matches_central_differences() {
    for (seed, shape) in [[4, 5, 2], [13, 12, 1]].into_iter().enumerate() {
        let (image, target) = images(seed as u64, shape);
        let (image, target) = (to_f64(&image), to_f64(&target));
        for dssim in WEIGHTS.map(f64::from) {
            let loss = |image: &[f64]| reference::photometric(image, &target, dssim, shape).0;
            let gradient = reference::photometric(&image, &target, dssim, shape).2;
            // Where both are equal the two differences cancel, as the gradient says.
            let expected = central_differences(&image, 1e-5, loss);
            let scale = gradient.iter().fold(0.0f64, |max, v| max.max(v.abs()));
            assert_close(
                "gradient",
                &gradient,
                &expected,
                DIFFERENCES_RELATIVE * scale,
                DIFFERENCES_RELATIVE,
            );
        }
    }
}

#[test]
fn backends_match_the_reference() {
    for device in devices() {
        for (seed, shape) in SHAPES.into_iter().enumerate() {
            let (image, target) = images(seed as u64, shape);
            for dssim in WEIGHTS {
                let (loss, mse, gradient) = reference::photometric(
                    &to_f64(&image),
                    &to_f64(&target),
                    f64::from(dssim),
                    shape,
                );
                let device = device.clone().autodiff();
                let leaf = tensor(&image, shape, &device).require_grad();
                let target = tensor(&target, shape, &device);
                let found = photometric(leaf.clone(), target, dssim).expect("equal shapes");
                // One less a similarity that a GPU works out in f32.
                assert_close(
                    "loss and error",
                    &both_of(found.clone()),
                    &[loss, mse],
                    2e-6,
                    2e-6,
                );
                // The squared error is a number to read: asking for its gradient changes nothing.
                let grads = (found.loss * 3.0 + found.mse).backward();
                let v_image = values(leaf.grad(&grads).expect("the image is tracked"));
                let tripled: Vec<f64> = gradient.iter().map(|v| 3.0 * v).collect();
                assert_agrees("v_image", &v_image, &tripled);
            }
        }
    }
}

/// It stands in for the similarity and the absolute error, one by one.
#[test]
fn it_is_the_sum_of_its_parts() {
    let (shape, dssim) = ([31, 45, 3], 0.2);
    let (image, target) = images(7, shape);
    for device in devices() {
        let device = device.autodiff();
        let gradient = |loss: &dyn Fn(Tensor<3>, Tensor<3>) -> Tensor<1>| {
            let leaf = tensor(&image, shape, &device).require_grad();
            let loss = loss(leaf.clone(), tensor(&target, shape, &device));
            let grads = loss.clone().backward();
            let v_image = values(leaf.grad(&grads).expect("tracked"));
            (values(loss.inner())[0], v_image)
        };
        let fused = gradient(&|x, y| photometric(x, y, dssim).expect("equal shapes").loss);
        let parts = gradient(&|x, y| {
            let l1 = (x.clone() - y.clone()).abs().mean();
            let similarity = crate::ssim::ssim(x, y).expect("equal shapes").mean();
            l1 * (1.0 - dssim) + (-similarity + 1.0) * dssim
        });
        assert!((fused.0 - parts.0).abs() < 1e-6, "{} {}", fused.0, parts.0);
        assert_agrees("v_image", &fused.1, &to_f64(&parts.1));
    }
}

#[test]
fn channels_beyond_the_targets_are_not_looked_at() {
    let shape = [21, 34, 3];
    let (image, target) = images(8, shape);
    let (loss, mse, gradient) =
        reference::photometric(&to_f64(&image), &to_f64(&target), 0.2, shape);
    let beyond = [f32::NAN, 7.0];
    let pixels = |image: &[f32]| image.chunks(3).map(<[f32]>::to_vec).collect::<Vec<_>>();
    let wide: Vec<f32> = pixels(&image)
        .into_iter()
        .flat_map(|pixel| [pixel, beyond.to_vec()].concat())
        .collect();
    for device in devices() {
        let device = device.autodiff();
        let leaf = tensor(&wide, [21, 34, 5], &device).require_grad();
        let target = tensor(&target, shape, &device);
        let found = photometric(leaf.clone(), target, 0.2).expect("shapes that go together");
        assert_close(
            "loss and error",
            &both_of(found.clone()),
            &[loss, mse],
            1e-7,
            2e-6,
        );
        let v_wide = values(leaf.grad(&found.loss.backward()).expect("tracked"));
        let first: Vec<f32> = v_wide.chunks(5).flat_map(|v| v[..3].to_vec()).collect();
        assert_agrees("v_image", &first, &gradient);
        assert!(v_wide.chunks(5).all(|v| v[3..] == [0.0, 0.0]));
    }
}

#[test]
fn equal_images_cost_nothing_and_have_no_gradient() {
    let shape = [20, 14, 3];
    let (image, _) = images(3, shape);
    let ([loss, mse], gradient) = cpu::photometric(&image, &image, 0.2, shape);
    assert!(loss.abs() < 1e-7 && mse == 0.0, "{loss} {mse}");
    assert!(gradient.iter().all(|v| v.abs() < 1e-9));
}

/// A picture that is no picture must be noticed, and must not spread.
#[test]
fn a_pixel_that_is_not_finite_makes_the_loss_not_finite_and_gets_no_gradient() {
    let shape = [12, 17, 3];
    let at = 100;
    for device in devices() {
        for poison in poison() {
            for in_target in [false, true] {
                let (mut image, mut target) = images(5, shape);
                let poisoned = if in_target { &mut target } else { &mut image };
                poisoned[at] = poison;
                let (loss, v_image) = judged(&image, &target, shape, &device);
                let name = format!("{device:?}, {poison}, in the target: {in_target}");
                assert_eq!(loss.is_finite(), poison.is_finite(), "{name}: {loss}");
                assert!(v_image.iter().all(|v| v.is_finite()), "{name}");
                if !poison.is_finite() && !in_target {
                    assert_eq!(v_image[at], 0.0, "{name}");
                }
            }
        }
    }
}

fn judged(image: &[f32], target: &[f32], shape: [usize; 3], device: &Device) -> (f32, Vec<f32>) {
    let device = device.clone().autodiff();
    let leaf = tensor(image, shape, &device).require_grad();
    let target = tensor(target, shape, &device);
    let loss = photometric(leaf.clone(), target, 0.2)
        .expect("equal shapes")
        .loss;
    let grads = loss.clone().backward();
    let v_image = leaf.grad(&grads).expect("tracked");
    (values(loss.inner())[0], values(v_image))
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let shape = [97, 141, 3];
    let (image, target) = images(9, shape);
    let run = || cpu::photometric(&image, &target, 0.2, shape);
    let one = with_threads(1, run);
    for threads in [2, 8] {
        let many = with_threads(threads, run);
        assert_eq!(bits(&one.0), bits(&many.0));
        assert_eq!(bits(&one.1), bits(&many.1));
    }
}

#[test]
fn other_shapes_and_weights_are_refused() {
    for device in devices() {
        let zeros = |shape| Tensor::<3>::zeros(shape, &device);
        assert!(photometric(zeros([2, 3, 1]), zeros([3, 2, 1]), 0.2).is_err());
        assert!(photometric(zeros([0, 3, 1]), zeros([0, 3, 1]), 0.2).is_err());
        assert!(photometric(zeros([2, 3, 1]), zeros([2, 3, 3]), 0.2).is_err());
        for dssim in [-0.1, 1.1, f32::NAN] {
            assert!(photometric(zeros([2, 3, 1]), zeros([2, 3, 1]), dssim).is_err());
        }
    }
}
