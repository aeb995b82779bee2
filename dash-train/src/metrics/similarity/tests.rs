use rand::{Rng, SeedableRng};
use rand_pcg::Pcg32;

use super::*;

/// Both sides are f64; only the order of the sums differs.
const TOLERANCE: f64 = 1e-12;

fn random_image(width: usize, height: usize, seed: u64) -> Vec<f32> {
    let mut rng = Pcg32::seed_from_u64(seed);
    (0..width * height * CHANNELS)
        .map(|_| rng.random())
        .collect()
}

fn assert_close(got: f64, expected: f64, what: &str) {
    assert!(
        got.is_finite() && (got - expected).abs() <= TOLERANCE,
        "{what}: got {got}, expected {expected}"
    );
}

/// One window's terms, from the two-dimensional definition: (full, contrast).
fn one_window(a: &[f64], b: &[f64], size: [usize; 2], centre: [isize; 2]) -> (f64, f64) {
    let half = (WINDOW / 2) as isize;
    let gauss = |x: isize, y: isize| (-((x * x + y * y) as f64) / (2.0 * 1.5 * 1.5)).exp();
    let at = |plane: &[f64], x: isize, y: isize| {
        let inside = x >= 0 && y >= 0 && x < size[0] as isize && y < size[1] as isize;
        if inside {
            plane[y as usize * size[0] + x as usize]
        } else {
            0.0
        }
    };
    let offsets: Vec<_> = (-half..=half)
        .flat_map(|y| (-half..=half).map(move |x| (x, y)))
        .collect();
    let total: f64 = offsets.iter().map(|(x, y)| gauss(*x, *y)).sum();
    let mean = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        offsets
            .iter()
            .map(|(x, y)| {
                let (px, py) = (centre[0] + x, centre[1] + y);
                gauss(*x, *y) / total * f(at(a, px, py), at(b, px, py))
            })
            .sum()
    };
    let (mu_a, mu_b) = (mean(&|a, _| a), mean(&|_, b| b));
    let var_a = mean(&|a, _| (a - mu_a).powi(2));
    let var_b = mean(&|_, b| (b - mu_b).powi(2));
    let covariance = mean(&|a, b| (a - mu_a) * (b - mu_b));
    let contrast = (2.0 * covariance + 0.0009) / (var_a + var_b + 0.0009);
    let luminance = (2.0 * mu_a * mu_b + 0.0001) / (mu_a * mu_a + mu_b * mu_b + 0.0001);
    (luminance * contrast, contrast)
}

#[test]
fn ssim_is_the_two_dimensional_definition() {
    for [width, height] in [[1, 1], [1, 9], [5, 3], [13, 17]] {
        let (a, b) = (
            random_image(width, height, 1),
            random_image(width, height, 2),
        );
        let mut expected = 0.0;
        for channel in 0..CHANNELS {
            let (a, b) = (plane(&a, channel), plane(&b, channel));
            for pixel in 0..width * height {
                let centre = [(pixel % width) as isize, (pixel / width) as isize];
                expected += one_window(&a, &b, [width, height], centre).0;
            }
        }
        expected /= (width * height * CHANNELS) as f64;
        assert_close(ssim(&a, &b, width, height), expected, "ssim");
    }
}

#[test]
fn a_single_pixel_by_hand() {
    // The window's centre weighs 0.26601 squared; the other 120 positions are zeros.
    let weight = {
        let side: f64 = (-5..=5).map(|x| (-f64::from(x * x) / 4.5).exp()).sum();
        1.0 / (side * side)
    };
    assert!((weight - 0.0707622).abs() < 1e-6, "{weight}");
    let (a, b) = (0.25, 0.75);
    let luminance = (2.0 * weight * weight * a * b + C1) / (weight * weight * (a * a + b * b) + C1);
    let spread = weight * (1.0 - weight);
    let structure = (2.0 * spread * a * b + C2) / (spread * (a * a + b * b) + C2);
    let got = ssim(&[a as f32; 3], &[b as f32; 3], 1, 1);
    assert_close(got, luminance * structure, "1 x 1");
    assert_close(ms_ssim(&[a as f32; 3], &[b as f32; 3], 1, 1), got, "1 x 1");
}

#[test]
fn identical_images_score_one_and_the_order_does_not_matter() {
    for [width, height] in [[1, 1], [12, 31], [64, 48]] {
        let (a, b) = (
            random_image(width, height, 3),
            random_image(width, height, 4),
        );
        let constant = vec![0.7; a.len()];
        for image in [&a, &constant] {
            assert_close(ssim(image, image, width, height), 1.0, "ssim");
            assert_close(ms_ssim(image, image, width, height), 1.0, "ms_ssim");
        }
        assert_close(
            ssim(&b, &a, width, height),
            ssim(&a, &b, width, height),
            "ssim",
        );
        assert_close(
            ms_ssim(&b, &a, width, height),
            ms_ssim(&a, &b, width, height),
            "ms_ssim",
        );
    }
}

#[test]
fn constants_differ_in_luminance_only() {
    let (a, b) = (0.5_f64, 0.75_f64);
    let luminance = (2.0 * a * b + C1) / (a * a + b * b + C1);
    for (side, weight) in [(161, 0.1333), (11, 1.0), (21, 0.2856 / 0.3304)] {
        let n = side * side * CHANNELS;
        let got = ms_ssim(&vec![a as f32; n], &vec![b as f32; n], side, side);
        assert_close(got, luminance.powf(weight), "constants");
    }
}

#[test]
fn one_scale_is_the_mean_over_the_windows_that_fit() {
    let (width, height) = (14, 12);
    let (a, b) = (
        random_image(width, height, 5),
        random_image(width, height, 6),
    );
    let b: Vec<f32> = a.iter().zip(&b).map(|(a, b)| 0.7 * a + 0.3 * b).collect();
    assert_eq!(ms_ssim_scales(width, height), 1);
    let mut expected = 0.0;
    for channel in 0..CHANNELS {
        let (a, b) = (plane(&a, channel), plane(&b, channel));
        for (x, y) in (5..9).flat_map(|x| (5..7).map(move |y| (x, y))) {
            expected += one_window(&a, &b, [width, height], [x, y]).0;
        }
    }
    assert_close(
        ms_ssim(&a, &b, width, height),
        expected / 24.0,
        "windows that fit",
    );
}

#[test]
fn two_scales_from_the_definition() {
    let (width, height) = (21, 22);
    let (a, b) = (
        random_image(width, height, 7),
        random_image(width, height, 8),
    );
    let b: Vec<f32> = a.iter().zip(&b).map(|(a, b)| 0.6 * a + 0.4 * b).collect();
    assert_eq!(ms_ssim_scales(width, height), 2);
    let fine_weight = 0.0448 / (0.0448 + 0.2856);
    let mut expected = 0.0;
    for channel in 0..CHANNELS {
        let (a, b) = (plane(&a, channel), plane(&b, channel));
        let centres =
            |w: isize, h: isize| (5..w - 5).flat_map(move |x| (5..h - 5).map(move |y| [x, y]));
        let fine: f64 = centres(21, 22)
            .map(|centre| one_window(&a, &b, [width, height], centre).1)
            .sum();
        let small = |plane: &[f64]| -> Vec<f64> {
            (0..11 * 11)
                .map(|i| {
                    let (x, y) = (i % 11, i / 11);
                    let columns: Vec<_> = (2 * x..(2 * x + 2).min(21)).collect();
                    let sum: f64 = columns
                        .iter()
                        .map(|x| plane[2 * y * 21 + x] + plane[(2 * y + 1) * 21 + x])
                        .sum();
                    sum / (2 * columns.len()) as f64
                })
                .collect()
        };
        let coarse = one_window(&small(&a), &small(&b), [11, 11], [5, 5]).0;
        expected += (fine / (11.0 * 12.0)).powf(fine_weight) * coarse.powf(1.0 - fine_weight);
    }
    assert_close(ms_ssim(&a, &b, width, height), expected / 3.0, "two scales");
}

#[test]
fn scales_by_the_smaller_side() {
    for (side, n_scales) in [
        (1, 1),
        (20, 1),
        (21, 2),
        (41, 3),
        (81, 4),
        (160, 4),
        (161, 5),
        (4096, 5),
    ] {
        assert_eq!(ms_ssim_scales(side, 5000), n_scales, "{side}");
        assert_eq!(ms_ssim_scales(5000, side), n_scales, "{side}");
    }
}

#[test]
fn a_negative_is_worse_than_noise_and_within_bounds() {
    let (width, height) = (48, 40);
    let a = random_image(width, height, 9);
    let negative: Vec<f32> = a.iter().map(|v| 1.0 - v).collect();
    let other = random_image(width, height, 10);
    let of_negative = ssim(&a, &negative, width, height);
    assert!((-1.0..0.0).contains(&of_negative), "{of_negative}");
    assert!(of_negative < ssim(&a, &other, width, height));
    assert_eq!(ms_ssim(&a, &negative, width, height), 0.0);
}

#[test]
fn nan_is_not_a_good_score() {
    let (width, height) = (30, 30);
    let a = random_image(width, height, 11);
    let mut b = a.clone();
    b[1234] = f32::NAN;
    assert!(ssim(&a, &b, width, height).is_nan());
    assert!(ms_ssim(&a, &b, width, height).is_nan());
}
