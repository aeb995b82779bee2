//! Sizes, layouts, extreme and broken values, threads.

use super::*;

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
    assert!(error.to_string().contains("expected [N, 16]"), "{error}");
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
