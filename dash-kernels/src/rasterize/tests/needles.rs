//! Needles, which say where they run relative to the picture.

use super::*;
use crate::testing::named_devices;

const SIZE: [usize; 2] = [50, 34];

/// Needles through the picture with their centres up to 1e5 px away.
fn needles(seed: u64, n: usize) -> Vec<f64> {
    let mut rng = rng(seed);
    let mut one = || {
        let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
        let (ny, nx) = angle.sin_cos();
        let (x, y) = (rng.random_range(0.0..50.0), rng.random_range(0.0..34.0));
        let away = 10f64.powf(rng.random_range(0.0..5.0));
        let across: f64 = rng.random_range(0.3..9.0);
        let along = (away * rng.random_range(0.5..3.0)).powi(2) + 1e4;
        let mean = [(x - away * ny) as f32, (y + away * nx) as f32];
        let (xx, yy) = (
            across * nx * nx + along * ny * ny,
            across * ny * ny + along * nx * nx,
        );
        let colour = std::array::from_fn(|_| rng.random());
        let cov = [xx, (across - along) * nx * ny, yy];
        let mut row = row(
            mean,
            cov,
            rng.random_range(0.1..1.0),
            colour,
            rng.random_range(0.5..9.0),
        );
        // Of the determinant of the covariance, which `row` divides by, rounding leaves nothing.
        row[splats::CONIC_A] = (nx * nx / across + ny * ny / along) as f32;
        row[splats::CONIC_B] = ((1.0 / across - 1.0 / along) * nx * ny) as f32;
        row[splats::CONIC_C] = (ny * ny / across + nx * nx / along) as f32;
        row[splats::ACROSS_X] = nx as f32;
        row[splats::ACROSS_Y] = ny as f32;
        row[splats::ACROSS_OFFSET] = (nx * x + ny * y) as f32;
        row[splats::ALONG] = (1.0 / along) as f32;
        to_f64(&row)
    };
    (0..n).flat_map(|_| one()).collect()
}

/// The shape's gradient by differences: each entry of the inverse covariance in the frame has a motion of its own.
#[test]
fn reference_gradient_against_central_differences() {
    const STEP: f64 = 1e-6;
    let splats = needles(1, 12);
    let mut v_image = cotangents(1, SIZE[0] * SIZE[1]);
    mask_thresholds(&splats, SIZE, &mut v_image);
    let gradient = reference::rasterize_vjp(&splats, SIZE, background(), &v_image);
    let loss = |moved: &[f64]| -> f64 {
        let image = reference::rasterize(moved, SIZE, background());
        image.iter().zip(&v_image).map(|(value, v)| value * v).sum()
    };
    for (i, row) in splats.chunks_exact(N_COLUMNS).enumerate() {
        let v = &gradient[i * N_COLUMNS..(i + 1) * N_COLUMNS];
        let (nx, ny) = (row[splats::ACROSS_X], row[splats::ACROSS_Y]);
        let slope = |step: f64, motion: &[(usize, f64)]| {
            let at = |by: f64| {
                let mut moved = splats.clone();
                for &(column, speed) in motion {
                    moved[i * N_COLUMNS + column] += by * speed;
                }
                loss(&moved)
            };
            (at(step) - at(-step)) / (2.0 * step)
        };
        let along = row[splats::ALONG];
        let across = row[splats::CONIC_A] + row[splats::CONIC_C] - along;
        // A turn of the axes about the centre, to first order.
        let (x, y) = (row[splats::MEAN_X], row[splats::MEAN_Y]);
        let turn = [
            (splats::ACROSS_X, -ny),
            (splats::ACROSS_Y, nx),
            (splats::ACROSS_OFFSET, nx * y - ny * x),
        ];
        let cases = [
            (
                splats::MEAN_X,
                slope(STEP, &[(splats::MEAN_X, 1.0), (splats::ACROSS_OFFSET, nx)]),
                1.0,
            ),
            (
                splats::MEAN_Y,
                slope(STEP, &[(splats::MEAN_Y, 1.0), (splats::ACROSS_OFFSET, ny)]),
                1.0,
            ),
            (
                splats::ACROSS_X,
                slope(STEP, &[(splats::CONIC_A, 1.0)]),
                1.0,
            ),
            (
                splats::ACROSS_Y,
                slope(1e-4 * along.sqrt(), &turn),
                across - along,
            ),
            (
                splats::ACROSS_OFFSET,
                slope(
                    1e-4 * along,
                    &[(splats::ALONG, 1.0), (splats::CONIC_A, 1.0)],
                ),
                1.0,
            ),
            (splats::OPACITY, slope(STEP, &[(splats::OPACITY, 1.0)]), 1.0),
        ];
        for (column, expected, per_entry) in cases {
            let got = v[column] * per_entry;
            let close = (got - expected).abs() <= 1e-4 * expected.abs() + 1e-5;
            assert!(close, "needle {i}, column {column}: {got} != {expected}");
        }
        assert_eq!(v[splats::CONIC_A..=splats::CONIC_C], [0.0; 3]);
    }
}

#[test]
fn kernels_against_the_reference() {
    let n = 40;
    let wide = needles(2, n);
    let expected = reference::rasterize(&wide, SIZE, background());
    let mut v_image = cotangents(2, SIZE[0] * SIZE[1]);
    mask_thresholds(&wide, SIZE, &mut v_image);
    let expected_gradient = reference::rasterize_vjp(&wide, SIZE, background(), &v_image);
    for device in devices() {
        let device = device.autodiff();
        let splats = tensor(&to_f32(&wide), [n, N_COLUMNS], &device).require_grad();
        let image = rasterize(splats.clone(), &options(SIZE[0], SIZE[1])).expect("valid");
        assert_agrees("image", &values(image.clone().inner()), &expected);
        let v_out = tensor(&to_f32(&v_image), [SIZE[1], SIZE[0], N_CHANNELS], &device);
        let gradients = (image * v_out).sum().backward();
        let got = to_f64(&values(splats.grad(&gradients).expect("tracked")));
        for column in 0..N_COLUMNS {
            let pick = |values: &[f64]| crate::testing::column(values, column, N_COLUMNS);
            let off = relative_l2(&pick(&got), &pick(&expected_gradient));
            assert!(off <= RELATIVE_L2, "column {column} is off by {off}");
        }
    }
}

/// Whatever stands in a needle's columns, pictures and gradients are finite.
#[test]
fn poison_in_a_needle_stays_finite() {
    let good = to_f32(&needles(3, 1));
    let mut splats = Vec::new();
    for column in 0..N_COLUMNS {
        for value in poison() {
            splats.extend(&good);
            let at = splats.len() - N_COLUMNS + column;
            splats[at] = value;
        }
    }
    let v_image = to_f32(&cotangents(3, SIZE[0] * SIZE[1]));
    for (name, device) in named_devices() {
        let device = device.autodiff();
        let n = splats.len() / N_COLUMNS;
        let rows = tensor(&splats, [n, N_COLUMNS], &device).require_grad();
        let image = rasterize(rows.clone(), &options(SIZE[0], SIZE[1])).expect("valid");
        assert_finite(&format!("{name}: image"), &values(image.clone().inner()));
        let v_out = tensor(&v_image, [SIZE[1], SIZE[0], N_CHANNELS], &device);
        let gradients = (image * v_out).sum().backward();
        assert_finite(
            &format!("{name}: gradient"),
            &values(rows.grad(&gradients).expect("tracked")),
        );
    }
}
