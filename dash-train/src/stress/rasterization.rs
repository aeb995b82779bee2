//! Splats that are hard to blend.

use burn::tensor::Device;
use dash_kernels::rasterize::{N_CHANNELS, RasterizeOptions, rasterize, reference};
use dash_kernels::splats::{ALPHA_MIN, CONIC_A, CONIC_B, CONIC_C, MEAN_X, MEAN_Y, N_COLUMNS};
use rand::Rng;

use super::Case;
use super::inputs::{gradient, rng, tensor, to_host, tracked, uniform, widen};
use super::measured::{Measured, largest_difference, worst_of};
use crate::Error;

const FAMILY: &str = "rasterization";

/// Difference of a pixel: front to back thousands of splats add up in single precision, to depths of 3.
const PIXEL: f64 = 5e-5;
/// The same under needles. Their exponents lose digits when terms of up to `50^2 / 0.3` cancel: they are off by
/// 1e-3, and an alpha near 1/255 appears or vanishes.
const NEEDLE_PIXEL: f64 = 5e-3;
/// Relative error of the whole gradient. Among thousands of similar splats, the colour that one adds and the colour
/// that it hides cancel, so that single values lose digits.
const GRADIENT: f64 = 5e-3;
/// Pixels nearer than this to a threshold, relatively, are not judged: rounding may decide them.
const BAND: f64 = 2e-4;
const BACKGROUND: [f32; 3] = [0.25, 0.5, 0.125];

pub(super) const CASES: &[Case] = &[
    Case {
        family: FAMILY,
        name: "coincident splats",
        extreme: "10,000 splats of one place and one depth, drawn twice",
        measure: coincident,
    },
    Case {
        family: FAMILY,
        name: "deep pixels",
        extreme: "pixels under 10,000 faint splats of different depths",
        measure: deep,
    },
    Case {
        family: FAMILY,
        name: "needle splats",
        extreme: "splats of 10 to 1e8 px across a picture of 50 x 30",
        measure: needles,
    },
];

/// A packed row with the covariance `[xx, xy, yy]`.
fn row(
    mean: [f32; 2],
    [xx, xy, yy]: [f64; 3],
    opacity: f32,
    colour: [f32; 3],
    depth: f32,
) -> [f32; N_COLUMNS] {
    let det = xx * yy - xy * xy;
    let extent = 2.0 * (f64::from(opacity) / ALPHA_MIN).ln();
    let radius = |variance: f64| (extent * variance).sqrt() as f32;
    let conic = [yy / det, -xy / det, xx / det].map(|value| value as f32);
    let [x, y] = mean;
    let [a, b, c] = conic;
    let [red, green, blue] = colour;
    let mut row = [0.0; N_COLUMNS];
    row[..12].copy_from_slice(&[
        x,
        y,
        a,
        b,
        c,
        opacity,
        red,
        green,
        blue,
        depth,
        radius(xx),
        radius(yy),
    ]);
    row
}

/// Whether a splat's exponent at a place is all rounding, which then decides whether it is drawn: a
/// negative one is not.
fn is_on_a_spine(splats: &[f32], [x, y]: [f64; 2]) -> bool {
    splats.chunks_exact(N_COLUMNS).any(|row| {
        let value = |column: usize| f64::from(row[column]);
        let (dx, dy) = (value(MEAN_X) - x, value(MEAN_Y) - y);
        let along = value(CONIC_A) * dx * dx + value(CONIC_C) * dy * dy;
        (0.5 * along + value(CONIC_B) * dx * dy).abs() < 1e-6 * along
    })
}

fn judge(
    splats: &[f32],
    pixel: f64,
    [width, height]: [usize; 2],
    device: &Device,
) -> Result<Measured, Error> {
    let options = RasterizeOptions {
        width,
        height,
        background: BACKGROUND,
    };
    let n = splats.len() / N_COLUMNS;
    let wide = widen(splats);
    let background = BACKGROUND.map(f64::from);
    let mut v_image = uniform(&mut rng(21), width * height * N_CHANNELS, -1.0, 1.0);
    let mut judged = vec![true; width * height];
    for (i, v) in v_image.chunks_exact_mut(N_CHANNELS).enumerate() {
        let (px, py) = (i % width, i / width);
        let spine = is_on_a_spine(splats, [px as f64 + 0.5, py as f64 + 0.5]);
        if spine || reference::margin(&wide, px, py) < BAND {
            judged[i] = false;
            v.fill(0.0);
        }
    }
    let expected = reference::rasterize(&wide, [width, height], background);
    let v_expected = reference::rasterize_vjp(&wide, [width, height], background, &widen(&v_image));

    let tracked_splats = tracked(splats, [n, N_COLUMNS], device);
    let out = rasterize(tracked_splats.clone(), &options)?;
    let image = to_host(out.clone().inner());
    let v_out = tensor(
        &v_image,
        [height, width, N_CHANNELS],
        &device.clone().autodiff(),
    );
    let v_splats = gradient(&tracked_splats, &(out * v_out).sum().backward());

    let mut measured = Measured::default();
    measured.saw(&image);
    let errors = (0..width * height).filter(|i| judged[*i]).map(|i| {
        let at = i * N_CHANNELS..(i + 1) * N_CHANNELS;
        largest_difference(&image[at.clone()], &expected[at])
    });
    let worst = worst_of(errors);
    measured.judge("pixels", worst, pixel);
    let few = judged.iter().filter(|judged| **judged).count() < width * height / 2;
    measured.none("pictures at a threshold", usize::from(few));
    measured.agree("gradient", &v_splats, &v_expected, GRADIENT);

    let again = to_host(rasterize(tensor(splats, [n, N_COLUMNS], device), &options)?);
    let bits = image
        .iter()
        .zip(&again)
        .filter(|(a, b)| a.to_bits() != b.to_bits());
    measured.none("other bits when drawn again", bits.count());
    Ok(measured)
}

fn coincident(device: &Device) -> Result<Measured, Error> {
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
    judge(&splats, PIXEL, [40, 24], device)
}

fn deep(device: &Device) -> Result<Measured, Error> {
    let mut rng = rng(22);
    let splats: Vec<f32> = (0..10_000)
        .flat_map(|i| {
            let mean = [rng.random_range(0.0..16.0), rng.random_range(0.0..16.0)];
            let colour = std::array::from_fn(|_| rng.random());
            row(
                mean,
                [2e5, 3e4, 1.5e5],
                0.0045,
                colour,
                1.0 + 1e-3 * i as f32,
            )
        })
        .collect();
    judge(&splats, PIXEL, [16, 16], device)
}

fn needles(device: &Device) -> Result<Measured, Error> {
    let mut rng = rng(23);
    let splats: Vec<f32> = (0..300)
        .flat_map(|_| {
            let long = 10f64.powf(rng.random_range(2.0..16.0));
            let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
            let (c, s) = (angle.cos(), angle.sin());
            row(
                [rng.random_range(0.0..50.0), rng.random_range(0.0..30.0)],
                [long * c * c + 0.3, long * c * s, long * s * s + 0.3],
                rng.random_range(0.1..0.9),
                [0.2, 0.5, 0.7],
                rng.random_range(0.5..9.0),
            )
        })
        .collect();
    judge(&splats, NEEDLE_PIXEL, [50, 30], device)
}
