mod edges;
mod needles;

use burn::tensor::Tensor;
use rand::Rng;
use rand::seq::SliceRandom;

use super::{
    CHANNEL_ALPHA, CHANNEL_DEPTH, N_CHANNELS, RasterizeOptions, cpu, rasterize, reference,
};
use crate::splats::{self, ALPHA_MAX, ALPHA_MIN, N_COLUMNS, N_DIFFERENTIABLE, TRANSMITTANCE_STOP};
use crate::testing::{
    COSINE, RELATIVE_L2, assert_agrees, assert_close, assert_finite,
    assert_same_for_any_thread_count, central_differences, cosine, devices, normals, poison,
    relative_l2, rng, tensor, to_f32, to_f64, values,
};

const BACKGROUND: [f32; 3] = [0.25, 0.5, 0.125];

pub(super) fn options(width: usize, height: usize) -> RasterizeOptions {
    RasterizeOptions {
        width,
        height,
        background: BACKGROUND,
    }
}

pub(super) fn background<T: num_traits::Float>() -> [T; 3] {
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
        0.0,
        0.0,
        0.0,
        0.0,
    ]
}

/// Splats of a few pixels all over an image and beyond its borders.
pub(super) fn random(seed: u64, n: usize, width: usize, height: usize) -> Vec<f32> {
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

pub(super) fn cotangents(seed: u64, n: usize) -> Vec<f64> {
    to_f64(&to_f32(&normals(&mut rng(seed), n * N_CHANNELS)))
}

/// Zeroes the cotangents of pixels where rounding may decide what is drawn; returns how many.
pub(super) fn mask_thresholds(splats: &[f64], size: [usize; 2], v_image: &mut [f64]) -> usize {
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
    /// A pixel that is off by more has a splat more or less than the reference.
    const FLIPPED: f64 = 1e-4;
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
            let mut n_flipped = 0;
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
                let off = got
                    .iter()
                    .zip(expected)
                    .any(|(g, e)| (g - e).abs() > FLIPPED * e.abs().max(1.0));
                n_flipped += usize::from(off);
            }
            assert!(
                1000 * n_flipped <= width * height,
                "seed {seed}: {n_flipped} of {} pixels flipped",
                width * height
            );
            let v_out = tensor(&to_f32(&v_image), [height, width, N_CHANNELS], &device);
            let gradients = (image * v_out).sum().backward();
            let got = values(splats.grad(&gradients).expect("tracked"));
            for column in 0..N_COLUMNS {
                let pick = |values: &[f64]| crate::testing::column(values, column, N_COLUMNS);
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
