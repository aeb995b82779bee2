//! Where trajectories of many spans are at a time.

use dash_kernels::displacement::{displacement, reference};

use super::{
    Bench, Errors, Measurement, Op, Pass, Target, generator, gradient, normal, time, to_f64,
    uniform, values,
};
use crate::TrainError;

/// As many as a long clip has.
const N_FUNCTIONS: usize = 48;

pub(super) fn measure(bench: &mut Bench, target: Target, n: usize) -> Result<(), TrainError> {
    let shape = [n, 3 * N_FUNCTIONS];
    let mut rng = generator(13);
    let coefficients: Vec<f32> = (0..n * shape[1]).map(|_| 0.1 * normal(&mut rng)).collect();
    let basis = uniform(&mut rng, N_FUNCTIONS, -1.0, 1.0);
    let wide_basis = to_f64(&basis);
    let expected = reference::displacement(&to_f64(&coefficients), &wide_basis);
    let tensor = target.tensor(&coefficients, shape);
    let got = values(displacement(tensor.clone(), &basis)?)?;
    let timing = time(Some(target.device), || {
        drop(displacement(tensor.clone(), &basis)?);
        Ok(())
    })?;
    bench.add(Measurement {
        error: Errors::of(&got, &expected),
        time: Some(timing),
        ..target.measurement(Op::Displacement, "f32", Pass::Forward, n)
    });

    let cotangent = uniform(&mut rng, 3 * n, -1.0, 1.0);
    let expected = reference::displacement_vjp(&to_f64(&cotangent), &wide_basis);
    let cotangent = target.constant(&cotangent, [n, 3]);
    let leaf = target.leaf(&coefficients, shape);
    let both = || {
        let out = displacement(leaf.clone(), &basis)?;
        Ok::<_, TrainError>((out * cotangent.clone()).sum().backward())
    };
    let got = gradient(&leaf, &both()?)?;
    let timing = time(Some(target.device), || both().map(drop))?;
    bench.add(Measurement {
        error: Errors::of(&got, &expected),
        time: Some(timing),
        ..target.measurement(Op::Displacement, "f32", Pass::Gradient, n)
    });
    Ok(())
}
