//! Every operation on every backend, with each of the poison values in each slot of every input
//! and of the output's gradient: what comes out is finite.

use burn::tensor::{Device, Tensor};

use crate::Camera;
use crate::adam::{AdamStep, adam_step};
use crate::displacement::displacement;
use crate::hash_encode::{HashGridConfig, HashGridLayout, Interpolation, LevelSizing, hash_encode};
use crate::mlp::{MlpLayout, mlp};
use crate::project::{ProjectOptions, project};
use crate::rasterize::{N_CHANNELS, RasterizeOptions, rasterize};
use crate::rows::{join_rows, take_rows};
use crate::space_time::{Bounds, space_time};
use crate::splats::N_COLUMNS;
use crate::ssim::ssim;
use crate::testing::{assert_finite, devices, poison, random, tensor, values};
use crate::trajectory::{Polyline, squared_extent};

/// A tensor whose gradient is asked for.
fn tracked<const R: usize>(data: &[f32], shape: [usize; R], device: &Device) -> Tensor<R> {
    tensor(data, shape, &device.clone().autodiff()).require_grad()
}

/// Fails unless `out` and the gradients that `v_out` causes are finite.
#[track_caller]
fn assert_sound<const R: usize>(
    name: &str,
    out: Tensor<R>,
    v_out: &[f32],
    gradients: impl FnOnce(&burn::tensor::Gradients) -> Vec<Vec<f32>>,
) {
    assert_finite(name, &values(out.clone()));
    let v_out = tensor(v_out, out.dims(), &out.device());
    let found = gradients(&(out * v_out).sum().backward());
    for (input, gradient) in found.iter().enumerate() {
        assert_finite(&format!("{name}, gradient of input {input}"), gradient);
    }
}

#[test]
fn adam() {
    let poison = poison();
    let n = 4 * poison.len();
    let good = [
        random(1, n),
        random(2, n),
        random(3, n),
        random(4, n).iter().map(|v| v * v).collect(),
    ];
    let mut bad = good.clone();
    for (input, values) in bad.iter_mut().enumerate() {
        values[input * poison.len()..][..poison.len()].copy_from_slice(&poison);
    }
    for device in devices() {
        for skip_zero_grad in [false, true] {
            let settings = AdamStep {
                step: 7,
                skip_zero_grad,
                ..AdamStep::default()
            };
            let [param, grad, first, second] =
                bad.each_ref().map(|values| tensor(values, [n], &device));
            let (param, first, second) =
                adam_step(param, grad, first, second, &settings).expect("equal shapes");
            let (param, moments) = (values(param), [values(first), values(second)]);
            for i in 0..n {
                let name = format!("{device:?}, element {i}");
                if !bad[0][i].is_finite() {
                    // There is nothing to put in its place.
                    assert_eq!(param[i].to_bits(), bad[0][i].to_bits(), "{name}");
                    continue;
                }
                let stepped = param[i] != bad[0][i];
                assert!(param[i].is_finite(), "{name}");
                assert!(
                    !stepped || moments.iter().all(|m| m[i].is_finite()),
                    "{name}"
                );
                // Moments that are no numbers are healed by the next good gradient.
                let lost = !bad[2][i].is_finite() || !bad[3][i].is_finite();
                assert!(stepped || !lost, "{name} does not move");
            }
        }
    }
}

#[test]
fn hash_encoding() {
    let layout = HashGridLayout::new(&HashGridConfig {
        n_levels: 4,
        n_features_per_level: 2,
        log2_hashmap_size: 7,
        base_resolution: vec![3, 3, 3],
        finest_resolution: vec![40, 30, 20],
        interpolation: Interpolation::Smoothstep,
        sizing: LevelSizing::Paper,
    })
    .expect("a good configuration");
    let (n, width, rows) = (90, layout.n_features(), layout.n_entries());
    let good = [
        random(5, 3 * n).iter().map(|x| x.abs().fract()).collect(),
        random(6, 2 * rows),
        random(7, n * width),
    ];
    for device in devices() {
        for input in 0..good.len() {
            let mut bad: [Vec<f32>; 3] = good.clone();
            let stride = bad[input].len() / poison().len() - 1;
            for offset in 0..stride.min(width) {
                bad[input] = good[input].clone();
                for (i, value) in poison().into_iter().enumerate() {
                    bad[input][i * stride + offset] = value;
                }
                let positions = tracked(&bad[0], [n, 3], &device);
                let table = tracked(&bad[1], [rows, 2], &device);
                let out = hash_encode(positions.clone(), table.clone(), &layout).expect("fits");
                let name = format!("{device:?}, poison in input {input} from {offset} on");
                assert_sound(&name, out, &bad[2], |grads| {
                    vec![
                        values(positions.grad(grads).expect("tracked")),
                        values(table.grad(grads).expect("tracked")),
                    ]
                });
            }
        }
    }
}

#[test]
fn similarity() {
    let shape = [13, 19, 2];
    let n = shape.iter().product();
    let good: [Vec<f32>; 3] = [random(8, n), random(9, n), random(10, n)];
    for device in devices() {
        for input in 0..good.len() {
            for value in poison() {
                let mut bad = good.clone();
                bad[input][n / 2] = value;
                bad[input][0] = value;
                let (x, y) = (
                    tracked(&bad[0], shape, &device),
                    tracked(&bad[1], shape, &device),
                );
                let out = ssim(x.clone(), y.clone()).expect("equal shapes");
                let name = format!("{device:?}, {value} in input {input}");
                assert_sound(&name, out, &bad[2], |grads| {
                    vec![
                        values(x.grad(grads).expect("tracked")),
                        values(y.grad(grads).expect("tracked")),
                    ]
                });
            }
        }
    }
}

/// Fails unless `op` on `good[0] [N, width]` is sound with each poison value in each slot of it and of `good[1]`, the
/// output's gradient.
#[track_caller]
fn assert_sound_on_rows<const R: usize>(
    good: [Vec<f32>; 2],
    width: usize,
    op: impl Fn(Tensor<2>) -> Tensor<R>,
) {
    let n = good[0].len() / width;
    for device in devices() {
        for input in 0..good.len() {
            for slot in 0..good[input].len() {
                for value in poison() {
                    let mut bad = good.clone();
                    bad[input][slot] = value;
                    let rows = tracked(&bad[0], [n, width], &device);
                    let out = op(rows.clone());
                    let name = format!("{device:?}, {value} in slot {slot} of input {input}");
                    assert_sound(&name, out, &bad[1], |grads| {
                        vec![values(rows.grad(grads).expect("tracked"))]
                    });
                }
            }
        }
    }
}

#[test]
fn extents_of_trajectories() {
    let (n, n_spans) = (3, 4);
    let polyline = Polyline::new(n_spans, 0.4).expect("a time in [0, 1]");
    let good = [random(12, n * 3 * n_spans), random(13, n)];
    assert_sound_on_rows(good, 3 * n_spans, |coefficients| {
        squared_extent(coefficients, polyline).expect("fits")
    });
}

#[test]
fn displacements_along_trajectories() {
    let (n, basis) = (3, [0.5, -1.0, 1.0, 0.0]);
    let good = [random(16, n * 3 * basis.len()), random(17, 3 * n)];
    assert_sound_on_rows(good, 3 * basis.len(), |coefficients| {
        displacement(coefficients, &basis).expect("fits")
    });
}

#[test]
fn points_of_the_unit_cube() {
    for clamp in [false, true] {
        let bounds = Bounds {
            min: [-1.0, 0.0, -3.0],
            scale: [0.5, 2.0, 1e-3],
            clamp,
        };
        let good = [random(20, 2 * 3), random(21, 2 * 4)];
        assert_sound_on_rows(good, 3, |positions| {
            space_time(positions, &bounds, 0.5).expect("three axes")
        });
    }
}

#[test]
fn taken_rows() {
    let (n, width, rows) = (5, 3, [0, 3]);
    let good = [random(18, n * width), random(19, rows.len() * width)];
    assert_sound_on_rows(good, width, |values| {
        take_rows(values, &rows).expect("ascending")
    });
}

#[test]
fn joined_rows() {
    let (n, width) = (5, 2);
    let good = [random(22, n * width), random(23, n * width)];
    assert_sound_on_rows(good, width, |rows| {
        let (first, second) = (rows.clone().narrow(0, 0, 3), rows.narrow(0, 3, 2));
        join_rows(first, second).expect("of one width")
    });
}

#[test]
fn networks() {
    let layout = MlpLayout::new(&[3, 5, 2]).expect("good widths");
    let poison = poison();
    // Rows are independent: each value has one of its own.
    let n = poison.len();
    let good = [
        random(14, 3 * n),
        random(15, layout.n_parameters()),
        random(16, 2 * n),
    ];
    let check = |bad: &[Vec<f32>; 3], name: &str, device: &Device| {
        let input = tracked(&bad[0], [n, 3], device);
        let parameters = tracked(&bad[1], [layout.n_parameters()], device);
        let out = mlp(input.clone(), parameters.clone(), &layout).expect("fits");
        assert_sound(name, out, &bad[2], |grads| {
            vec![
                values(input.grad(grads).expect("tracked")),
                values(parameters.grad(grads).expect("tracked")),
            ]
        });
    };
    for device in devices() {
        for (input, width) in [(0, 3), (2, 2)] {
            for slot in 0..width {
                let mut bad = good.clone();
                for (row, &value) in poison.iter().enumerate() {
                    bad[input][row * width + slot] = value;
                }
                check(
                    &bad,
                    &format!("{device:?}, slot {slot} of input {input}"),
                    &device,
                );
            }
        }
        for slot in 0..layout.n_parameters() {
            for value in poison {
                let mut bad = good.clone();
                bad[1][slot] = value;
                check(
                    &bad,
                    &format!("{device:?}, {value} in parameter {slot}"),
                    &device,
                );
            }
        }
    }
}

#[test]
fn projection() {
    let widths = [3, 4, 3, 1, 12];
    let one: [Vec<f32>; 5] = [
        vec![0.1, -0.2, 3.0],
        vec![0.9, 0.1, -0.3, 0.2],
        vec![-2.0, -1.5, -2.5],
        vec![0.7],
        (0..12).map(|k| 0.1 * k as f32 - 0.4).collect(),
    ];
    // A Gaussian for each poison in each slot, of the inputs and of the splats' gradients.
    let n = (widths.iter().sum::<usize>() + N_COLUMNS) * poison().len();
    let mut bad = one.each_ref().map(|values| values.repeat(n));
    let mut v_out = vec![1.0; n * N_COLUMNS];
    let mut gaussian = 0;
    for (part, &width) in widths.iter().chain([&N_COLUMNS]).enumerate() {
        for slot in 0..width {
            for value in poison() {
                let values = bad.get_mut(part).unwrap_or(&mut v_out);
                values[gaussian * width + slot] = value;
                gaussian += 1;
            }
        }
    }
    assert_eq!(gaussian, n);
    let camera = Camera::new(50.0, 55.0, 31.0, 25.0, 64, 48);
    for device in devices() {
        let means = tracked(&bad[0], [n, 3], &device);
        let quats = tracked(&bad[1], [n, 4], &device);
        let scales = tracked(&bad[2], [n, 3], &device);
        let opacities = tracked(&bad[3], [n], &device);
        let sh_coeffs = tracked(&bad[4], [n, 4, 3], &device);
        let splats = project(
            means.clone(),
            quats.clone(),
            scales.clone(),
            opacities.clone(),
            sh_coeffs.clone(),
            &camera,
            &ProjectOptions::default(),
        )
        .expect("fits");
        assert_sound(&format!("{device:?}"), splats, &v_out, |grads| {
            vec![
                values(means.grad(grads).expect("tracked")),
                values(quats.grad(grads).expect("tracked")),
                values(scales.grad(grads).expect("tracked")),
                values(opacities.grad(grads).expect("tracked")),
                values(sh_coeffs.grad(grads).expect("tracked")),
            ]
        });
    }
}

#[test]
fn rasterization() {
    let (width, height) = (50, 30);
    let good: [f32; N_COLUMNS] = [
        21.0, 14.0, 0.02, 0.004, 0.03, 0.6, 0.3, 0.5, 0.7, 2.0, 30.0, 25.0, 0.0, 0.0, 0.0, 0.0,
    ];
    let mut splats: Vec<f32> = good.to_vec();
    for column in 0..N_COLUMNS {
        for value in poison() {
            splats.extend(good);
            let at = splats.len() - N_COLUMNS + column;
            splats[at] = value;
        }
    }
    let n = splats.len() / N_COLUMNS;
    let options = RasterizeOptions {
        width,
        height,
        background: [0.1, 0.2, 0.3],
    };
    let v_good = random(11, width * height * N_CHANNELS);
    for device in devices() {
        let draw = |splats: &[f32], v_image: &[f32]| {
            let splats = tracked(splats, [splats.len() / N_COLUMNS, N_COLUMNS], &device);
            let image = rasterize(splats.clone(), &options).expect("fits");
            assert_sound(&format!("{device:?}"), image, v_image, |grads| {
                vec![values(splats.grad(grads).expect("tracked"))]
            });
        };
        draw(&splats, &v_good);
        for row in 0..n {
            draw(
                &[
                    good.to_vec(),
                    splats[row * N_COLUMNS..][..N_COLUMNS].to_vec(),
                ]
                .concat(),
                &v_good,
            );
        }
        for channel in 0..N_CHANNELS {
            for value in poison() {
                let mut v_image = v_good.clone();
                // A pixel in the splat's middle.
                v_image[(14 * width + 21) * N_CHANNELS + channel] = value;
                draw(&good.repeat(3), &v_image);
            }
        }
    }
}
