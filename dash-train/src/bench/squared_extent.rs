//! How far trajectories of many spans go.

use dash_kernels::trajectory::{Polyline, reference, squared_extent};

use super::{
    Bench, Errors, Measurement, Op, Pass, Target, generator, gradient, normal, time, to_f64,
    uniform, values,
};
use crate::TrainError;

/// As many as a long clip has.
const SPANS: usize = 48;
/// In the middle of the clip, on a knot.
const ANCHOR: f32 = 0.5;

pub(super) fn measure(bench: &mut Bench, target: Target, n: usize) -> Result<(), TrainError> {
    let shape = [n, 3 * SPANS];
    let mut rng = generator(11);
    let coefficients: Vec<f32> = (0..n * 3 * SPANS).map(|_| 0.1 * normal(&mut rng)).collect();
    let polyline = Polyline::new(SPANS, ANCHOR)?;
    let wide = to_f64(&coefficients);
    let expected = reference::squared_extent(&wide, SPANS, f64::from(ANCHOR));
    let tensor = target.tensor(&coefficients, shape);
    let got = values(squared_extent(tensor.clone(), polyline)?)?;
    let timing = time(Some(target.device), || {
        drop(squared_extent(tensor.clone(), polyline)?);
        Ok(())
    })?;
    bench.add(Measurement {
        error: Errors::of(&got, &expected),
        time: Some(timing),
        ..target.measurement(Op::SquaredExtent, "f32", Pass::Forward, n)
    });

    let cotangent = uniform(&mut rng, n, -1.0, 1.0);
    let expected =
        reference::squared_extent_vjp(&wide, &to_f64(&cotangent), SPANS, f64::from(ANCHOR));
    let cotangent = target.constant(&cotangent, [n]);
    let leaf = target.leaf(&coefficients, shape);
    let both = || {
        let out = squared_extent(leaf.clone(), polyline)?;
        Ok::<_, TrainError>((out * cotangent.clone()).sum().backward())
    };
    let got = gradient(&leaf, &both()?)?;
    let timing = time(Some(target.device), || both().map(drop))?;
    bench.add(Measurement {
        error: Errors::of(&got, &expected),
        time: Some(timing),
        ..target.measurement(Op::SquaredExtent, "f32", Pass::Gradient, n)
    });
    Ok(())
}
