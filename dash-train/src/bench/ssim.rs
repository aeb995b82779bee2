//! SSIM of a picture and a noisy copy of it.

use dash_kernels::ssim::{reference, ssim};

use super::{
    Bench, Errors, Measurement, Op, Pass, Target, generator, gradient, time, to_f64, uniform,
    values,
};
use crate::Error;

const CHANNELS: usize = 3;

pub(super) fn measure(bench: &mut Bench, target: Target, n: usize) -> Result<(), Error> {
    let side = (n as f64).sqrt().round().max(1.0) as usize;
    let shape = [side, side, CHANNELS];
    let len = side * side * CHANNELS;
    let mut rng = generator(7);
    let x = uniform(&mut rng, len, 0.0, 1.0);
    let noise = uniform(&mut rng, len, -0.2, 0.2);
    let y: Vec<f32> = x
        .iter()
        .zip(noise)
        .map(|(x, n)| (x + n).clamp(0.0, 1.0))
        .collect();
    let (x64, y64) = (to_f64(&x), to_f64(&y));
    let expected = reference::ssim(&x64, &y64, shape);
    let (x_tensor, y_tensor) = (target.tensor(&x, shape), target.tensor(&y, shape));
    let got = values(ssim(x_tensor.clone(), y_tensor.clone())?)?;
    let timing = time(Some(target.device), || {
        drop(ssim(x_tensor.clone(), y_tensor.clone())?);
        Ok(())
    })?;
    bench.add(Measurement {
        error: Errors::of(&got, &expected),
        time: Some(timing),
        ..target.measurement(Op::Ssim, "f32", Pass::Forward, side * side)
    });

    let cotangent = uniform(&mut rng, len, -1.0, 1.0);
    let (v_x, _) = reference::ssim_vjp(&x64, &y64, &to_f64(&cotangent), shape);
    let cotangent = target.constant(&cotangent, shape);
    let (leaf, y) = (target.leaf(&x, shape), target.constant(&y, shape));
    let both = || {
        let out = ssim(leaf.clone(), y.clone())?;
        Ok::<_, Error>((out * cotangent.clone()).sum().backward())
    };
    let got = gradient(&leaf, &both()?)?;
    let timing = time(Some(target.device), || both().map(drop))?;
    bench.add(Measurement {
        error: Errors::of(&got, &v_x),
        time: Some(timing),
        ..target.measurement(Op::Ssim, "f32", Pass::Gradient, side * side)
    });
    Ok(())
}
