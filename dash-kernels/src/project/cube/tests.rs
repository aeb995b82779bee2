//! Poison, and that what is culled is culled as the reference culls it.

use burn::backend::Backend;

use crate::cube::tests::{cube_tensor, cube_values};
use crate::project::{Gaussians, ProjectOptions, ShSlices, reference};
use crate::testing::*;

use super::*;
use crate::Camera;

/// Row lengths of means, quats, scales, opacities and SH coefficients of degree 1.
const WIDTHS: [usize; 5] = [3, 4, 3, 1, 12];

/// One Gaussian in view, a copy of it for every poison in every slot.
fn poisoned() -> [Vec<f32>; 5] {
    let good: [Vec<f32>; 5] = [
        vec![0.1, -0.2, 3.0],
        vec![0.9, 0.1, -0.3, 0.2],
        vec![-2.0, -1.5, -2.5],
        vec![0.7],
        (0..12).map(|k| 0.1 * k as f32 - 0.4).collect(),
    ];
    let mut all = good.clone();
    for input in 0..5 {
        for slot in 0..WIDTHS[input] {
            for value in poison() {
                for other in 0..5 {
                    all[other].extend_from_slice(&good[other]);
                }
                let at = all[input].len() - WIDTHS[input] + slot;
                all[input][at] = value;
            }
        }
    }
    all
}

fn gaussians<'a, T>(inputs: &'a [Vec<T>; 5]) -> Gaussians<'a, T> {
    Gaussians {
        means: &inputs[0],
        quats: &inputs[1],
        scales: &inputs[2],
        opacities: &inputs[3],
        sh_coeffs: ShSlices::joined(&inputs[4], 4),
    }
}

#[test]
fn poison_in_every_slot() {
    let inputs = poisoned();
    let n = inputs[3].len();
    let camera = Camera::new(50.0, 55.0, 31.0, 25.0, 64, 48);
    let options = ProjectOptions::default();
    let view = View::new(&camera, &options, 1);
    // Constant coefficients, then the others.
    let (dc, rest): (Vec<_>, Vec<_>) = inputs[4].chunks(12).map(|row| row.split_at(3)).unzip();
    let tensors = || GaussianTensors::<CubeBackend> {
        means: cube_tensor(&inputs[0], [n, 3]),
        quats: cube_tensor(&inputs[1], [n, 4]),
        scales: cube_tensor(&inputs[2], [n, 3]),
        opacities: cube_tensor(&inputs[3], [n]),
        sh_dc: cube_tensor(&dc.concat(), [n, 1, 3]),
        sh_rest: cube_tensor(&rest.concat(), [n, 3, 3]),
    };
    let g = tensors();
    let splats = CubeBackend::project(
        g.means,
        g.quats,
        g.scales,
        g.opacities,
        g.sh_dc,
        g.sh_rest,
        view,
    );
    let got = cube_values(&splats);
    assert_finite("splats", &got);

    let wide = inputs.each_ref().map(|values| to_f64(values));
    let expected = reference::project(&gaussians(&wide), &View::new(&camera, &options, 1));
    let mut drawn = 0;
    for (i, (got, expected)) in got
        .chunks_exact(N_COLUMNS)
        .zip(expected.chunks_exact(N_COLUMNS))
        .enumerate()
    {
        // f32 can't hold the squares of larger values, f64 can.
        let in_range = WIDTHS.iter().zip(&inputs).all(|(&width, values)| {
            values[width * i..width * (i + 1)]
                .iter()
                .all(|v| v.abs() < 1e15)
        });
        if !in_range {
            continue;
        }
        if got[splats::RADIUS_X] > 0.0 {
            drawn += 1;
            let tolerance = 2e-4;
            assert_close(
                &format!("Gaussian {i}"),
                &to_f64(got),
                expected,
                1e-5,
                tolerance,
            );
        } else if !is_on_a_threshold(&inputs, i) {
            assert_eq!(expected[splats::RADIUS_X], 0.0, "Gaussian {i} is missing");
        }
    }
    assert!(drawn > n / 4, "{drawn} of {n} drawn");

    let v_splats = cube_tensor(&vec![1.0; n * N_COLUMNS], [n, N_COLUMNS]);
    for gradient in CubeBackend::project_vjp(tensors(), view, splats, v_splats, true) {
        assert_finite("gradient", &cube_values(&gradient.expect("asked for")));
    }
    CubeBackend::sync(&cubecl::Device::default()).expect("the device answers");
}

/// Whether rounding may decide: the Gaussian stands on the near plane, or its size is near the
/// largest number there is.
fn is_on_a_threshold(inputs: &[Vec<f32>; 5], i: usize) -> bool {
    let depth = inputs[0][3 * i + 2];
    let near = crate::splats::NEAR_PLANE as f32;
    let huge = inputs[2][3 * i..3 * i + 3]
        .iter()
        .any(|&log_scale| log_scale > 40.0);
    (depth - near).abs() < 1e-6 || huge
}
