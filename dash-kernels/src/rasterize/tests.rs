use burn::tensor::Tensor;
use rand::Rng;
use rand::seq::SliceRandom;

use super::{
    CHANNEL_ALPHA, CHANNEL_DEPTH, N_CHANNELS, RasterizeOptions, cpu, rasterize, reference,
};
use crate::splats::{self, ALPHA_MAX, ALPHA_MIN, N_COLUMNS, N_DIFFERENTIABLE, TRANSMITTANCE_STOP};
use crate::testing::{
    COSINE, assert_agrees, assert_close, assert_finite, assert_same_for_any_thread_count,
    central_differences, cosine, devices, normals, rng, tensor, to_f32, to_f64, values,
};

const BACKGROUND: [f32; 3] = [0.25, 0.5, 0.125];

fn options(width: usize, height: usize) -> RasterizeOptions {
    RasterizeOptions {
        width,
        height,
        background: BACKGROUND,
    }
}

fn background<T: num_traits::Float>() -> [T; 3] {
    BACKGROUND.map(|value| T::from(value).expect("every float type holds the background"))
}

/// A packed row with the covariance `[xx, xy, yy]`, its radii as projection gives them.
fn row(
    mean: [f32; 2],
    cov: [f64; 3],
    opacity: f32,
    colour: [f32; 3],
    depth: f32,
) -> [f32; N_COLUMNS] {
    let [xx, xy, yy] = cov;
    let det = xx * yy - xy * xy;
    let extent = 2.0 * (f64::from(opacity) / ALPHA_MIN).ln();
    let radius = |variance: f64| (extent * variance).sqrt() as f32;
    [
        mean[0],
        mean[1],
        (yy / det) as f32,
        (-xy / det) as f32,
        (xx / det) as f32,
        opacity,
        colour[0],
        colour[1],
        colour[2],
        depth,
        radius(xx),
        radius(yy),
    ]
}

/// Splats of a few pixels all over an image and beyond its borders.
fn random(seed: u64, n: usize, width: usize, height: usize) -> Vec<f32> {
    let mut rng = rng(seed);
    (0..n)
        .flat_map(|_| {
            let spread = |rng: &mut rand_pcg::Pcg64| rng.random_range(0.3f64..4.0).powi(2) + 0.3;
            let (xx, yy) = (spread(&mut rng), spread(&mut rng));
            let xy = rng.random_range(-0.9..0.9) * (xx * yy).sqrt();
            row(
                [
                    rng.random_range(-5.0..width as f32 + 5.0),
                    rng.random_range(-5.0..height as f32 + 5.0),
                ],
                [xx, xy, yy],
                rng.random_range(0.02..1.0),
                std::array::from_fn(|_| rng.random()),
                rng.random_range(0.5..9.0),
            )
        })
        .collect()
}

fn cotangents(seed: u64, n: usize) -> Vec<f64> {
    to_f64(&to_f32(&normals(&mut rng(seed), n * N_CHANNELS)))
}

/// Zeroes the cotangents of pixels where rounding may decide what is drawn; returns how many.
fn mask_thresholds(splats: &[f64], size: [usize; 2], v_image: &mut [f64]) -> usize {
    /// Far above the rounding of alpha and transmittance in single precision.
    const BAND: f64 = 2e-4;
    let [width, _] = size;
    let mut masked = 0;
    for (i, v) in v_image.chunks_exact_mut(N_CHANNELS).enumerate() {
        if reference::margin(splats, i % width, i / width) < BAND {
            v.fill(0.0);
            masked += 1;
        }
    }
    masked
}

#[test]
fn two_splats_by_hand() {
    // Both centred on the pixel (2, 1): alpha is the opacity there.
    let near = row([2.5, 1.5], [1.0, 0.0, 1.0], 0.5, [1.0, 0.0, 0.5], 2.0);
    let far = row([2.5, 1.5], [2.0, 0.0, 1.0], 0.75, [0.0, 1.0, 0.5], 4.0);
    let splats = [far, near].concat();
    let v_pixel = [1.0, 2.0, -1.0, 0.5, 0.25];
    for device in devices() {
        let device = device.autodiff();
        let splats = tensor(&splats, [2, N_COLUMNS], &device).require_grad();
        let image = rasterize(splats.clone(), &options(5, 4)).expect("valid");
        let at = (5 + 2) * N_CHANNELS;
        let got = to_f64(&values(image.clone().inner())[at..at + N_CHANNELS]);
        // Weights 0.5 and 0.5 * 0.75; 0.125 of the background.
        let expected = [
            0.5 + 0.125 * 0.25,
            0.375 + 0.125 * 0.5,
            0.4375 + 0.125 * 0.125,
            0.875,
            0.5 * 2.0 + 0.375 * 4.0,
        ];
        assert_close("pixel", &got, &expected, 1e-6, 0.0);
        // One pixel to the right: exp(-1/2) and exp(-1/4) of the opacities.
        let (alpha_1, alpha_2) = (0.5 * (-0.5f64).exp(), 0.75 * (-0.25f64).exp());
        let got = to_f64(&values(image.clone().inner())[at + N_CHANNELS..][..N_CHANNELS]);
        let alpha = 1.0 - (1.0 - alpha_1) * (1.0 - alpha_2);
        assert_close("alpha", &[got[CHANNEL_ALPHA]], &[alpha], 1e-6, 0.0);

        let mut v_image = vec![0.0; 5 * 4 * N_CHANNELS];
        v_image[at..at + N_CHANNELS].copy_from_slice(&v_pixel);
        let v_image = tensor(&v_image, [4, 5, N_CHANNELS], &device);
        let gradients = (image * v_image).sum().backward();
        let v = to_f64(&values(splats.grad(&gradients).expect("tracked")));
        // The cotangent's product with each splat's own channels, and with the background.
        let own = |c: [f64; 3], z: f64| c[0] + 2.0 * c[1] - c[2] + 0.25 * z;
        let seen = own([0.25, 0.5, 0.125], 0.0) - 0.5;
        let (own_near, own_far) = (own([1.0, 0.0, 0.5], 2.0), own([0.0, 1.0, 0.5], 4.0));
        let v_far = 0.5 * (own_far - seen);
        let v_near = own_near - (0.75 * own_far + 0.25 * seen);
        let mut expected = [0.0; 2 * N_COLUMNS];
        for (k, weight, v_opacity) in [(0, 0.375, v_far), (1, 0.5, v_near)] {
            let row = &mut expected[k * N_COLUMNS..];
            row[splats::OPACITY] = v_opacity;
            for (j, v) in [1.0, 2.0, -1.0].into_iter().enumerate() {
                row[splats::RED + j] = weight * v;
            }
            row[splats::DEPTH] = weight * 0.25;
        }
        assert_close("gradient", &v, &expected, 1e-6, 1e-6);
    }
}

#[test]
fn reference_gradient_against_central_differences() {
    /// A whole frame: the differences' own error of many summed pixels.
    const RELATIVE: f64 = 1e-6;
    let size = [19, 14];
    let splats = to_f64(&random(1, 25, size[0], size[1]));
    let mut v_image = cotangents(1, size[0] * size[1]);
    let masked = mask_thresholds(&splats, size, &mut v_image);
    assert!(masked < size[0] * size[1] / 10, "{masked} pixels masked");
    let gradient = reference::rasterize_vjp(&splats, size, background(), &v_image);
    let expected = central_differences(&splats, 1e-6, |moved| {
        let image = reference::rasterize(moved, size, background());
        image.iter().zip(&v_image).map(|(value, v)| value * v).sum()
    });
    let scale = expected.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    for (i, (got, expected)) in gradient.iter().zip(&expected).enumerate() {
        if i % N_COLUMNS < N_DIFFERENTIABLE {
            let close = (got - expected).abs() <= RELATIVE * (expected.abs() + scale);
            assert!(
                close,
                "row {}, column {}: {got} != {expected}",
                i / N_COLUMNS,
                i % N_COLUMNS
            );
        } else {
            assert_eq!(*got, 0.0, "radii carry no gradient");
        }
    }
}

#[test]
fn kernels_against_the_reference() {
    for (seed, n, width, height) in [
        (2, 400, 64, 48),
        (3, 1500, 97, 61),
        (4, 60, 16, 16),
        (5, 30, 1, 1),
    ] {
        let splats = random(seed, n, width, height);
        let size = [width, height];
        let wide = to_f64(&splats);
        let expected = reference::rasterize(&wide, size, background());
        let mut v_image = cotangents(seed, width * height);
        let masked = mask_thresholds(&wide, size, &mut v_image);
        assert!(
            masked <= width * height / 2,
            "{masked} of {} pixels masked",
            width * height
        );
        let expected_gradient = reference::rasterize_vjp(&wide, size, background(), &v_image);
        for device in devices() {
            let device = device.autodiff();
            let splats = tensor(&splats, [n, N_COLUMNS], &device).require_grad();
            let image = rasterize(splats.clone(), &options(width, height)).expect("valid");
            let got = to_f64(&values(image.clone().inner()));
            for (i, (got, expected)) in got
                .chunks_exact(N_CHANNELS)
                .zip(expected.chunks_exact(N_CHANNELS))
                .enumerate()
            {
                // A splat that rounding drops or keeps changes the pixel by at most its alpha.
                let flipped = v_image[i * N_CHANNELS] == 0.0;
                let tolerance = if flipped { 0.05 } else { 2e-5 };
                assert_close(
                    &format!("seed {seed}, pixel {i}"),
                    got,
                    expected,
                    tolerance,
                    0.0,
                );
            }
            let v_out = tensor(&to_f32(&v_image), [height, width, N_CHANNELS], &device);
            let gradients = (image * v_out).sum().backward();
            let got = values(splats.grad(&gradients).expect("tracked"));
            for column in 0..N_COLUMNS {
                let pick = |values: &[f64]| -> Vec<f64> {
                    values
                        .iter()
                        .skip(column)
                        .step_by(N_COLUMNS)
                        .copied()
                        .collect()
                };
                let name = format!("seed {seed}, column {column}");
                assert_agrees(
                    &name,
                    &to_f32(&pick(&to_f64(&got))),
                    &pick(&expected_gradient),
                );
            }
        }
    }
}

/// A wrong gradient must not pass for a right one.
#[test]
#[should_panic(expected = "p99")]
fn negative_control() {
    let splats = random(6, 100, 40, 30);
    let wide = to_f64(&splats);
    let mut v_image = cotangents(6, 40 * 30);
    mask_thresholds(&wide, [40, 30], &mut v_image);
    let expected = reference::rasterize_vjp(&wide, [40, 30], background(), &v_image);
    let black = RasterizeOptions {
        background: [0.0; 3],
        ..options(40, 30)
    };
    let (_, saved) = cpu::rasterize_saving(&splats, &black);
    assert_agrees(
        "no background",
        &cpu::rasterize_vjp(&saved, &to_f32(&v_image)),
        &expected,
    );
}

#[test]
fn edges_of_size_and_layout() {
    for device in devices() {
        let none = Tensor::<2>::zeros([0, N_COLUMNS], &device.clone().autodiff()).require_grad();
        let image = rasterize(none.clone(), &options(3, 2)).expect("valid");
        let expected = [BACKGROUND.as_slice(), &[0.0, 0.0]].concat().repeat(6);
        assert_eq!(
            values(image.clone().inner()),
            expected,
            "only the background"
        );
        let gradient = none.grad(&image.sum().backward()).expect("tracked");
        assert_eq!(gradient.dims(), [0, N_COLUMNS]);

        let culled = tensor(&[0.0; 5 * N_COLUMNS], [5, N_COLUMNS], &device);
        let image = rasterize(culled, &options(3, 2)).expect("valid");
        assert_eq!(values(image), expected, "all culled");

        let splats = random(7, 30, 33, 17);
        let contiguous = tensor(&splats, [30, N_COLUMNS], &device);
        let by_column: Vec<f32> = (0..N_COLUMNS)
            .flat_map(|column| splats.iter().skip(column).step_by(N_COLUMNS).copied())
            .collect();
        let strided = tensor(&by_column, [N_COLUMNS, 30], &device).transpose();
        let [a, b] = [contiguous, strided]
            .map(|splats| values(rasterize(splats, &options(33, 17)).expect("valid")));
        assert_eq!(a, b, "a transposed tensor gives the same image");
    }
}

#[test]
fn refuses_what_does_not_fit() {
    let device = devices().remove(0);
    let error = rasterize(Tensor::zeros([4, 9], &device), &options(8, 8)).expect_err("9 columns");
    assert!(error.to_string().contains("expected [N, 12]"), "{error}");
    let splats = Tensor::<2>::zeros([4, N_COLUMNS], &device);
    let error = rasterize(splats.clone(), &options(0, 8)).expect_err("no width");
    assert!(error.to_string().contains("0 x 8"), "{error}");
    let nan = RasterizeOptions {
        background: [0.0, f32::NAN, 0.0],
        ..options(8, 8)
    };
    let error = rasterize(splats, &nan).expect_err("NaN background");
    assert!(error.to_string().contains("finite"), "{error}");
}

/// Equal depths are drawn by row: the first splats hide the others, to the bit.
#[test]
fn ten_thousand_coincident_splats() {
    let n = 10_000;
    let splats: Vec<f32> = (0..n)
        .flat_map(|i| {
            let shade = i as f32 / n as f32;
            row(
                [20.3, 10.7],
                [9.0, 2.0, 6.0],
                0.02,
                [shade, 1.0 - shade, 0.5],
                3.0,
            )
        })
        .collect();
    let (image, saved) = cpu::rasterize_saving(&splats, &options(40, 24));
    let wide = to_f64(&splats);
    let expected = reference::rasterize(&wide, [40, 24], background());
    let mut v_image = cotangents(12, 40 * 24);
    let masked = mask_thresholds(&wide, [40, 24], &mut v_image);
    assert!(masked < 40 * 24 / 2, "{masked} pixels masked");
    for (i, v) in v_image.iter().enumerate() {
        let error = (f64::from(image[i]) - expected[i]).abs();
        let judged = *v != 0.0;
        assert!(
            !judged || error < 2e-5,
            "value {i}: {} != {}",
            image[i],
            expected[i]
        );
    }
    let v = cpu::rasterize_vjp(&saved, &to_f32(&v_image));
    assert_finite("gradient", &v);
    // A splat among hundreds of almost the same: what it adds and what it hides cancel, so single
    // values lose digits that the whole gradient does not.
    let cosine = cosine(
        &to_f64(&v),
        &reference::rasterize_vjp(&wide, [40, 24], background(), &v_image),
    );
    assert!(cosine >= COSINE, "{cosine}");
    assert_eq!(
        image,
        cpu::rasterize(&splats, &options(40, 24)),
        "saving changes nothing"
    );
}

/// A pixel stops before the splat that would bring its transmittance under 1e-4.
#[test]
fn stops_before_the_threshold() {
    let splats: Vec<f32> = (0..4)
        .flat_map(|i| row([0.5, 0.5], [1.0, 0.0, 1.0], 0.95, [1.0; 3], i as f32))
        .collect();
    let image = cpu::rasterize(&splats, &options(1, 1));
    // Transmittances 0.05, 2.5e-3, 1.25e-4; the fourth splat would leave 6.25e-6.
    assert!((f64::from(image[CHANNEL_ALPHA]) - (1.0 - 0.05f64.powi(3))).abs() < 1e-6);
    let depth = f64::from(image[CHANNEL_DEPTH]);
    assert!((depth - (0.0475 + 2.0 * 0.002_375)).abs() < 1e-6, "{depth}");
    assert!(0.05f64.powi(3) > TRANSMITTANCE_STOP && 0.05f64.powi(4) < TRANSMITTANCE_STOP);
}

#[test]
fn no_gradient_through_the_clamp() {
    let splats = row([1.5, 1.5], [1.0, 0.0, 1.0], 1.0, [0.2, 0.4, 0.6], 1.0);
    let (image, saved) = cpu::rasterize_saving(&splats, &options(3, 3));
    let at = 4 * N_CHANNELS;
    assert!((f64::from(image[at + CHANNEL_ALPHA]) - ALPHA_MAX).abs() < 1e-6);
    let mut v_image = vec![0.0; image.len()];
    v_image[at..at + N_CHANNELS].fill(1.0);
    let v = cpu::rasterize_vjp(&saved, &v_image);
    assert_eq!(v[..=splats::OPACITY], [0.0; splats::OPACITY + 1]);
    assert_close(
        "colour",
        &to_f64(&v[splats::RED..=splats::DEPTH]),
        &[ALPHA_MAX; 4],
        1e-6,
        0.0,
    );
}

#[test]
fn needles_stay_finite() {
    let mut rng = rng(8);
    let splats: Vec<f32> = (0..300)
        .flat_map(|_| {
            let long = 10f64.powf(rng.random_range(2.0..16.0));
            let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
            let (c, s) = (angle.cos(), angle.sin());
            row(
                [rng.random_range(0.0..50.0), rng.random_range(0.0..30.0)],
                [long * c * c + 0.3, long * c * s, long * s * s + 0.3],
                rng.random_range(0.1..1.0),
                [0.5; 3],
                rng.random_range(0.5..9.0),
            )
        })
        .collect();
    let (image, saved) = cpu::rasterize_saving(&splats, &options(50, 30));
    assert_finite("image", &image);
    let v = cpu::rasterize_vjp(&saved, &to_f32(&cotangents(8, 50 * 30)));
    assert_finite("gradient", &v);
}

#[test]
fn poison_gives_finite_images_and_gradients() {
    let poison = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        f32::MIN,
        f32::MIN_POSITIVE,
        1e-40,
        0.0,
        -0.0,
        1e10,
        -1e10,
        1e20,
        -1e20,
        -1.0,
        2.0,
    ];
    let good = random(9, 12, 20, 20);
    for column in 0..N_COLUMNS {
        for value in poison {
            let mut splats = good.clone();
            splats[3 * N_COLUMNS + column] = value;
            let name = format!("column {column}, {value}");
            let (image, saved) = cpu::rasterize_saving(&splats, &options(20, 20));
            assert_finite(&name, &image);
            let v = cpu::rasterize_vjp(&saved, &vec![1.0; image.len()]);
            assert_finite(&name, &v);
        }
    }
}

#[test]
fn alpha_is_a_weight_and_order_of_rows_does_not_matter() {
    let (n, width, height) = (600, 70, 45);
    let splats = random(10, n, width, height);
    let image = cpu::rasterize(&splats, &options(width, height));
    for pixel in image.chunks_exact(N_CHANNELS) {
        let alpha = f64::from(pixel[CHANNEL_ALPHA]);
        assert!((0.0..=1.0).contains(&alpha), "{alpha}");
    }
    let mut rows: Vec<&[f32]> = splats.chunks_exact(N_COLUMNS).collect();
    rows.shuffle(&mut rng(10));
    let shuffled = cpu::rasterize(&rows.concat(), &options(width, height));
    assert_eq!(
        image, shuffled,
        "depths differ, so rows may come in any order"
    );
    // With white splats on black, colour is the sum of the weights.
    let mut white = splats;
    for row in white.chunks_exact_mut(N_COLUMNS) {
        row[splats::RED..=splats::BLUE].fill(1.0);
    }
    let black = RasterizeOptions {
        background: [0.0; 3],
        ..options(width, height)
    };
    for pixel in cpu::rasterize(&white, &black).chunks_exact(N_CHANNELS) {
        assert!(
            (pixel[0] - pixel[CHANNEL_ALPHA]).abs() < 1e-5,
            "weights sum to alpha"
        );
    }
}

#[test]
fn same_bits_for_any_thread_count() {
    let splats = random(11, 3000, 150, 130);
    let v_image = to_f32(&cotangents(11, 150 * 130));
    assert_same_for_any_thread_count("rasterize", || {
        let (mut all, saved) = cpu::rasterize_saving(&splats, &options(150, 130));
        all.extend(cpu::rasterize_vjp(&saved, &v_image));
        all
    });
}
