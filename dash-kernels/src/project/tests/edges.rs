//! Sizes, layouts, extreme and broken values, threads.

use std::ops::Range;

use super::*;

#[test]
fn edges_of_size_and_layout() {
    let options = ProjectOptions::default();
    for device in devices() {
        for n in [0, 1] {
            let set = Set::random(30, n, 4);
            let out = set
                .tensors(&device)
                .project(&camera(), &options)
                .expect("valid");
            assert_eq!(out.dims(), [n, N_COLUMNS]);
        }
        let empty = Set::random(30, 0, 4).tensors(&device.clone().autodiff());
        let means = empty.means.clone().require_grad();
        let empty = Tensors {
            means: means.clone(),
            ..empty
        };
        let out = empty.project(&camera(), &options).expect("valid");
        let gradient = means.grad(&out.sum().backward()).expect("tracked");
        assert_eq!(gradient.dims(), [0, 3]);

        let set = Set::random(31, 40, 4);
        let expected = values(
            set.tensors(&device)
                .project(&camera(), &options)
                .expect("valid"),
        );
        let mut strided = set.tensors(&device);
        let by_axis: Vec<f64> = (0..3)
            .flat_map(|axis| set.means.iter().skip(axis).step_by(3).copied())
            .collect();
        strided.means = tensor(&to_f32(&by_axis), [3, 40], &device).transpose();
        let got = values(strided.project(&camera(), &options).expect("valid"));
        assert_eq!(got, expected, "a transposed tensor gives the same splats");
    }
}

#[test]
fn refuses_what_does_not_fit() {
    let device = devices().remove(0);
    let camera = camera();
    let options = ProjectOptions::default();
    let good = Set::random(32, 5, 4).tensors(&device);
    let mut bad = good.clone();
    bad.quats = tensor(&[0.0; 12], [4, 3], &device);
    let error = bad
        .project(&camera, &options)
        .expect_err("quats are [4, 3]");
    assert!(
        error
            .to_string()
            .contains("`quats` has shape [4, 3], expected [5, 4]"),
        "{error}"
    );
    let mut bad = good.clone();
    bad.sh_coeffs = tensor(&[0.0; 75], [5, 5, 3], &device);
    let error = bad.project(&camera, &options).expect_err("5 coefficients");
    assert!(
        error.to_string().contains("K one of [1, 4, 9, 16]"),
        "{error}"
    );
    let too_high = ProjectOptions {
        sh_degree: Some(2),
        ..options.clone()
    };
    let error = good
        .clone()
        .project(&camera, &too_high)
        .expect_err("degree 2 of 4");
    assert!(error.to_string().contains("at most 1"), "{error}");
    let broken = Camera {
        fx: f64::NAN,
        ..camera.clone()
    };
    let error = good
        .project(&broken, &options)
        .expect_err("NaN focal length");
    assert!(error.to_string().contains("expected finite"), "{error}");
}

#[test]
fn culls_what_is_not_drawn() {
    let set = Set::random(33, 1, 1);
    let mut centred = set.clone();
    centred.means = vec![0.1, 0.1, 3.0];
    centred.opacities = vec![0.0];
    let options = ProjectOptions::default();
    let view = view::<f32>(&options, 1);
    let project = |set: &Set| cpu::project(&Narrow::new(set).gaussians(), &view);
    assert!(
        project(&centred)[splats::RADIUS_X] > 0.0,
        "the case itself is drawn"
    );
    type Change = fn(&mut Set);
    let changes: [(&str, Change); 5] = [
        ("zero quaternion", |set| set.quats = vec![0.0; 4]),
        ("behind the camera", |set| set.means[2] = -4.0),
        ("nearer than the near plane", |set| {
            set.means = vec![0.2, -0.1, -0.15]
        }),
        ("transparent", |set| set.opacities = vec![-6.0]),
        ("beside the image", |set| set.means[0] = 30.0),
    ];
    for (name, change) in changes {
        let mut set = centred.clone();
        change(&mut set);
        assert_eq!(project(&set), [0.0; N_COLUMNS], "{name}");
        let narrow = Narrow::new(&set);
        let splats = cpu::project(&narrow.gaussians(), &view);
        let v = cpu::project_vjp(&narrow.gaussians(), &view, &splats, &[1.0; N_COLUMNS], true);
        let v_sh_coeffs = v.v_sh_coeffs();
        let all = [v.v_means, v.v_quats, v.v_scales, v.v_opacities, v_sh_coeffs].concat();
        assert!(all.iter().all(|&value| value == 0.0), "{name}: {all:?}");
    }
}

#[test]
fn poison_gives_finite_splats_and_gradients() {
    let poison = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        f32::MIN,
        f32::MIN_POSITIVE,
        1e-40,
        -1e-40,
        0.0,
        -0.0,
        1e-20,
        1e10,
        -1e10,
        1e20,
        -1e20,
        88.0,
        -88.0,
        40.0,
        -40.0,
        20.0,
    ];
    for activation in [Activation::Exp, Activation::Linear] {
        let options = ProjectOptions {
            activation,
            ..ProjectOptions::default()
        };
        let view = view::<f32>(&options, 4);
        let set = Narrow::new(&Set::random(34, 1, 4));
        for part in 0..5 {
            for slot in 0..set.parts[part].len() {
                for value in poison {
                    let mut parts = set.parts.clone();
                    parts[part][slot] = value;
                    let bad = Narrow { parts, n_coeffs: 4 };
                    let splats = cpu::project(&bad.gaussians(), &view);
                    let name = format!("{activation:?}, input {part}, slot {slot}, {value}");
                    assert_finite(&name, &splats);
                    let v_splats = [1.0; N_COLUMNS];
                    let v = cpu::project_vjp(&bad.gaussians(), &view, &splats, &v_splats, true);
                    let v_sh_coeffs = v.v_sh_coeffs();
                    let all = [v.v_means, v.v_quats, v.v_scales, v.v_opacities, v_sh_coeffs];
                    assert_finite(&name, &all.concat());
                }
            }
        }
    }
}

/// Needles of such lengths, about 25 pixels to a unit, and of axis ratios of 1e2 to 1e8.
fn needles(seed: u64, n: usize, lengths: Range<f64>) -> Set {
    let mut rng = rng(seed);
    let mut set = Set::random(seed, n, 1);
    for (scale, opacity) in set.scales.chunks_exact_mut(3).zip(&mut set.opacities) {
        let length = rng.random_range(lengths.start.ln()..lengths.end.ln());
        let ratio = rng.random_range(100f64.ln()..1e8f64.ln());
        let logs = [length, length - ratio, length - ratio];
        scale.copy_from_slice(&to_f64(&to_f32(&logs)));
        *opacity = 2.0;
    }
    set
}

/// `conic v_conic conic` times the rows of the covariance's root cancels to nothing but rounding from 10 pixels on;
/// cross products do not.
#[test]
fn needles_keep_their_gradient() {
    for (seed, lengths) in [(39, 0.01..0.4), (40, 0.4..4.0), (41, 4.0..400.0)] {
        let set = needles(seed, 1000, lengths.clone());
        let name = format!("lengths {lengths:?}");
        let v_splats = cotangents(seed, set.len());
        assert_kernels_agree(&name, &set, &ProjectOptions::default(), &v_splats);
    }
}

/// `a c - b^2` of the covariance loses 15 % here; the sum does not.
#[test]
fn needles_keep_their_determinant() {
    /// What the sum holds up to a ratio of 1e8, as measured for the project.
    const RELATIVE: f64 = 5e-5;
    let n = 500;
    let set = needles(35, n, 1.0..30.0);
    let options = ProjectOptions::default();
    let expected = reference::project(&set.gaussians(), &view(&options, 1));
    let got = cpu::project(&Narrow::new(&set).gaussians(), &view(&options, 1));
    let mut n_drawn = 0;
    for (i, (got, expected)) in got
        .chunks_exact(N_COLUMNS)
        .zip(expected.chunks_exact(N_COLUMNS))
        .enumerate()
    {
        let drawn = [f64::from(got[splats::RADIUS_X]), expected[splats::RADIUS_X]].map(|r| r > 0.0);
        assert_eq!(drawn[0], drawn[1], "needle {i}: drawn by one of them");
        if !drawn[0] {
            continue;
        }
        n_drawn += 1;
        // Radius^2 is proportional to the covariance's diagonal, and conic a = yy / det.
        let det = |radius_y: f64, a: f64| radius_y * radius_y / a;
        let got = det(
            f64::from(got[splats::RADIUS_Y]),
            f64::from(got[splats::CONIC_A]),
        );
        let expected = det(expected[splats::RADIUS_Y], expected[splats::CONIC_A]);
        let error = (got / expected - 1.0).abs();
        assert!(
            error <= RELATIVE,
            "needle {i}: relative error {error:e} of the determinant"
        );
    }
    assert!(n_drawn > n / 2, "the case is too poor: {n_drawn} drawn");
}

#[test]
fn jacobian_stops_at_the_border() {
    let camera = Camera::new(100.0, 100.0, 20.0, 50.0, 100, 100);
    let view = View::<f64>::new(&camera, &ProjectOptions::default(), 0);
    // 0.3 of half the field of view beyond each side, which is 0.2 and 0.8 from the axis.
    assert_close("lowest", &view.lowest, &[-0.35, -0.65], 1e-12, 0.0);
    assert_close("highest", &view.highest, &[0.95, 0.65], 1e-12, 0.0);
    let conic = |x: f64| {
        let set = Set {
            means: vec![x, 0.0, 1.0],
            quats: vec![1.0, 0.2, 0.3, 0.4],
            scales: vec![-0.5, -1.0, -0.2],
            opacities: vec![2.0],
            sh_coeffs: vec![0.0; 3],
            n_coeffs: 1,
        };
        let row = reference::project(&set.gaussians(), &view);
        assert!(row[splats::RADIUS_X] > 0.0, "drawn");
        let v_row: Vec<f64> = (0..N_COLUMNS)
            .map(|k| f64::from(u8::from(k == splats::CONIC_A)))
            .collect();
        (
            row[splats::CONIC_A],
            reference::project_vjp(&set.gaussians(), &view, &v_row).v_means[0],
        )
    };
    let (inside, slope_inside) = conic(0.9499);
    let (outside, slope_outside) = conic(0.9501);
    let (far, _) = conic(1.2);
    assert!(slope_inside.abs() > 1e-6, "{slope_inside}");
    assert_eq!(slope_outside, 0.0);
    assert!((inside - outside).abs() < 1e-3 * inside && outside == far);
}

#[test]
fn same_bits_for_any_thread_count() {
    let narrow = Narrow::new(&Set::random(36, 5000, 9));
    let view = view::<f32>(&ProjectOptions::default(), 9);
    let v_splats = to_f32(&cotangents(36, 5000));
    assert_same_for_any_thread_count("project", || {
        let mut all = cpu::project(&narrow.gaussians(), &view);
        let v = cpu::project_vjp(&narrow.gaussians(), &view, &all, &v_splats, true);
        let v_sh_coeffs = v.v_sh_coeffs();
        for part in [v.v_means, v.v_quats, v.v_scales, v.v_opacities, v_sh_coeffs] {
            all.extend(part);
        }
        all
    });
}

/// Only the SH coefficients may be left out: they are what costs.
#[test]
fn untracked_inputs_get_no_gradient() {
    for device in devices() {
        let device = device.autodiff();
        let set = Set::random(37, 50, 16).tensors(&device);
        let opacities = set.opacities.clone().require_grad();
        let inputs = Tensors {
            opacities: opacities.clone(),
            ..set.clone()
        };
        let out = inputs
            .project(&camera(), &ProjectOptions::default())
            .expect("valid");
        let gradients = out.sum().backward();
        assert!(opacities.grad(&gradients).is_some());
        assert!(set.sh_coeffs.grad(&gradients).is_none());
    }
}
