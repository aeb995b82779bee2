//! The photometric loss of a picture and a noisy copy of it, in one pass and of its parts.

use burn::tensor::Tensor;
use dash_kernels::KernelError;
use dash_kernels::photometric::{photometric, reference};
use dash_kernels::ssim::ssim;

use super::{
    Bench, Errors, Measurement, Op, Pass, Target, generator, gradient, time, to_f64, uniform,
    values,
};
use crate::Error;

const CHANNELS: usize = 3;
/// That of 3D Gaussian Splatting.
const DSSIM: f32 = 0.2;

type Loss = fn(Tensor<3>, Tensor<3>) -> Result<Tensor<1>, KernelError>;
const VARIANTS: [(&str, Loss); 2] = [("f32", in_one_pass), ("f32, of its parts", of_its_parts)];

fn in_one_pass(x: Tensor<3>, y: Tensor<3>) -> Result<Tensor<1>, KernelError> {
    Ok(photometric(x, y, DSSIM)?.loss)
}

fn of_its_parts(x: Tensor<3>, y: Tensor<3>) -> Result<Tensor<1>, KernelError> {
    let l1 = (x.clone() - y.clone()).abs().mean();
    let dissimilarity = -ssim(x, y)?.mean() + 1.0;
    Ok(l1 * (1.0 - DSSIM) + dissimilarity * DSSIM)
}

pub(super) fn measure(bench: &mut Bench, target: Target, n: usize) -> Result<(), Error> {
    let side = (n as f64).sqrt().round().max(1.0) as usize;
    let shape = [side, side, CHANNELS];
    let len = side * side * CHANNELS;
    let mut rng = generator(8);
    let x = uniform(&mut rng, len, 0.0, 1.0);
    let noise = uniform(&mut rng, len, -0.2, 0.2);
    let y: Vec<f32> = x.iter().zip(noise).map(|(x, n)| x + n).collect();
    let (loss, _, v_x) = reference::photometric(&to_f64(&x), &to_f64(&y), f64::from(DSSIM), shape);
    for (variant, of) in VARIANTS {
        let (x_tensor, y_tensor) = (target.tensor(&x, shape), target.tensor(&y, shape));
        let got = values(of(x_tensor.clone(), y_tensor.clone())?)?;
        let timing = time(Some(target.device), || {
            drop(of(x_tensor.clone(), y_tensor.clone())?);
            Ok(())
        })?;
        bench.add(Measurement {
            error: Errors::of(&got, &[loss]),
            time: Some(timing),
            ..target.measurement(Op::Photometric, variant, Pass::Forward, side * side)
        });
        let (leaf, y) = (target.leaf(&x, shape), target.constant(&y, shape));
        let both = || Ok::<_, Error>(of(leaf.clone(), y.clone())?.backward());
        let got = gradient(&leaf, &both()?)?;
        let timing = time(Some(target.device), || both().map(drop))?;
        bench.add(Measurement {
            error: Errors::of(&got, &v_x),
            time: Some(timing),
            ..target.measurement(Op::Photometric, variant, Pass::Gradient, side * side)
        });
    }
    Ok(())
}
