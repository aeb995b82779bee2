//! Pictures that are hard to compare.

use burn::tensor::Device;
use dash_kernels::ssim::{reference, ssim};

use super::Case;
use super::inputs::{gradient, rng, tensor, to_host, tracked, uniform, widen};
use super::measured::{Measured, largest_difference};
use crate::Error;

const FAMILY: &str = "ssim";

/// Difference of a similarity: without its variances clamped, single precision is off by 4.6e-4 on
/// constants and beyond 1.
const SIMILARITY: f64 = 1e-3;
/// Relative error of the gradient of textured pictures.
const GRADIENT: f64 = 1e-3;

pub(super) const CASES: &[Case] = &[
    Case {
        family: FAMILY,
        name: "constant images",
        extreme: "pictures of one value: 0, 1e-3, 0.7, 1, 255",
        measure: constant,
    },
    Case {
        family: FAMILY,
        name: "tiny images",
        extreme: "pictures of 1 x 1 to 11 x 11 pixels",
        measure: tiny,
    },
    Case {
        family: FAMILY,
        name: "opposite images",
        extreme: "a picture and its negative, values up to 255",
        measure: opposite,
    },
];

/// Similarity, its range, and both gradients; judged by the gradient only where there is a slope.
fn judge(
    measured: &mut Measured,
    x: &[f32],
    y: &[f32],
    shape: [usize; 3],
    with_gradient: bool,
    device: &Device,
) -> Result<(), Error> {
    let v_out = uniform(&mut rng(41), x.len(), -1.0, 1.0);
    let (a, b) = (tracked(x, shape, device), tracked(y, shape, device));
    let out = ssim(a.clone(), b.clone())?;
    let similarity = to_host(out.clone().inner());
    let v = tensor(&v_out, shape, &device.clone().autodiff());
    let gradients = (out * v).sum().backward();
    let (v_x, v_y) = (gradient(&a, &gradients), gradient(&b, &gradients));
    measured.saw(&similarity);
    measured.saw(&v_x);
    measured.saw(&v_y);
    let (x, y) = (widen(x), widen(y));
    let size = format!("{}x{}", shape[1], shape[0]);
    let expected = reference::ssim(&x, &y, shape);
    let error = largest_difference(&similarity, &expected);
    measured.judge(format!("{size}: similarity"), error, SIMILARITY);
    let outside = similarity.iter().filter(|s| !(-1.0..=1.0).contains(*s));
    measured.none(format!("{size}: outside [-1, 1]"), outside.count());
    if with_gradient {
        let (e_x, e_y) = reference::ssim_vjp(&x, &y, &widen(&v_out), shape);
        measured.agree(&format!("{size}: gradient of x"), &v_x, &e_x, GRADIENT);
        measured.agree(&format!("{size}: gradient of y"), &v_y, &e_y, GRADIENT);
    }
    Ok(())
}

fn constant(device: &Device) -> Result<Measured, Error> {
    let mut measured = Measured::default();
    for shape in [[1, 1, 1], [9, 17, 3], [40, 50, 3]] {
        let n = shape.iter().product();
        for (a, b) in [
            (0.0, 0.0),
            (1.0, 1.0),
            (0.7, 0.7),
            (0.3, 0.31),
            (1e-3, 1.0),
            (0.0, 1.0),
            (255.0, 255.0),
        ] {
            judge(
                &mut measured,
                &vec![a; n],
                &vec![b; n],
                shape,
                false,
                device,
            )?;
        }
    }
    Ok(measured)
}

fn tiny(device: &Device) -> Result<Measured, Error> {
    let mut measured = Measured::default();
    for (seed, shape) in [[1, 1, 3], [1, 7, 3], [5, 1, 2], [2, 2, 3], [11, 11, 1]]
        .into_iter()
        .enumerate()
    {
        let n = shape.iter().product();
        let mut rng = rng(42 + seed as u64);
        let (x, y) = (
            uniform(&mut rng, n, 0.0, 1.0),
            uniform(&mut rng, n, 0.0, 1.0),
        );
        judge(&mut measured, &x, &y, shape, true, device)?;
    }
    Ok(measured)
}

fn opposite(device: &Device) -> Result<Measured, Error> {
    let mut measured = Measured::default();
    let shape = [30, 40, 3];
    let n = shape.iter().product();
    for scale in [1.0, 255.0] {
        let x = uniform(&mut rng(50), n, 0.0, scale);
        let y: Vec<f32> = x.iter().map(|v| scale - v).collect();
        judge(&mut measured, &x, &y, shape, true, device)?;
    }
    Ok(measured)
}
