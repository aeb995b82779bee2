//! Trajectories of many spans: where they are at a time, how far they go, and some of them.

use burn::tensor::Tensor;
use dash_kernels::KernelError;
use dash_kernels::displacement::{self, displacement};
use dash_kernels::rows::{self, take_rows};
use dash_kernels::trajectory::{self, Polyline, squared_extent};

use super::{
    Bench, Errors, Measurement, Op, Pass, Target, generator, gradient, normal, time, to_f64,
    uniform, values,
};
use crate::TrainError;

/// As many as a long clip has.
const SPANS: usize = 48;
/// One in so many rows is taken.
const STRIDE: usize = 5;
/// In the middle of the clip, on a knot.
const ANCHOR: f32 = 0.5;

pub(super) fn measure_displacement(
    bench: &mut Bench,
    target: Target,
    n: usize,
) -> Result<(), TrainError> {
    use displacement::reference;
    let basis = uniform(&mut generator(13), SPANS, -1.0, 1.0);
    let wide = to_f64(&basis);
    let case = Case {
        op: Op::Displacement,
        run: |coefficients| displacement(coefficients, &basis),
        expected: |coefficients: &[f64]| reference::displacement(coefficients, &wide),
        expected_vjp: |_: &[f64], v: &[f64]| reference::displacement_vjp(v, &wide),
    };
    case.measure(bench, target, n, [n, 3])
}

pub(super) fn measure_squared_extent(
    bench: &mut Bench,
    target: Target,
    n: usize,
) -> Result<(), TrainError> {
    use trajectory::reference;
    let (polyline, anchor) = (Polyline::new(SPANS, ANCHOR)?, f64::from(ANCHOR));
    let case = Case {
        op: Op::SquaredExtent,
        run: |coefficients| squared_extent(coefficients, polyline),
        expected: |coefficients: &[f64]| reference::squared_extent(coefficients, SPANS, anchor),
        expected_vjp: |coefficients: &[f64], v: &[f64]| {
            reference::squared_extent_vjp(coefficients, v, SPANS, anchor)
        },
    };
    case.measure(bench, target, n, [n])
}

pub(super) fn measure_take_rows(
    bench: &mut Bench,
    target: Target,
    n: usize,
) -> Result<(), TrainError> {
    use rows::reference;
    let (width, taken) = (3 * SPANS, n.div_ceil(STRIDE));
    let rows: Vec<u32> = (0..n as u32).step_by(STRIDE).collect();
    let case = Case {
        op: Op::TakeRows,
        run: |coefficients| take_rows(coefficients, &rows),
        expected: |coefficients: &[f64]| reference::take_rows(coefficients, width, &rows),
        expected_vjp: |_: &[f64], v: &[f64]| reference::take_rows_vjp(v, n, width, &rows),
    };
    case.measure(bench, target, n, [taken, width])
}

/// An operation on coefficients, and its reference.
struct Case<F, E, G> {
    op: Op,
    run: F,
    expected: E,
    expected_vjp: G,
}

impl<F, E, G> Case<F, E, G>
where
    E: Fn(&[f64]) -> Vec<f64>,
    G: Fn(&[f64], &[f64]) -> Vec<f64>,
{
    fn measure<const R: usize>(
        self,
        bench: &mut Bench,
        target: Target,
        n: usize,
        out_shape: [usize; R],
    ) -> Result<(), TrainError>
    where
        F: Fn(Tensor<2>) -> Result<Tensor<R>, KernelError>,
    {
        let shape = [n, 3 * SPANS];
        let mut rng = generator(11);
        let coefficients: Vec<f32> = (0..n * 3 * SPANS).map(|_| 0.1 * normal(&mut rng)).collect();
        let wide = to_f64(&coefficients);
        let tensor = target.tensor(&coefficients, shape);
        let got = values((self.run)(tensor.clone())?)?;
        let timing = time(Some(target.device), || {
            drop((self.run)(tensor.clone())?);
            Ok(())
        })?;
        bench.add(Measurement {
            error: Errors::of(&got, &(self.expected)(&wide)),
            time: Some(timing),
            ..target.measurement(self.op, "f32", Pass::Forward, n)
        });

        let cotangent = uniform(&mut rng, out_shape.iter().product(), -1.0, 1.0);
        let expected = (self.expected_vjp)(&wide, &to_f64(&cotangent));
        let cotangent = target.constant(&cotangent, out_shape);
        let leaf = target.leaf(&coefficients, shape);
        let both = || {
            let out = (self.run)(leaf.clone())?;
            Ok::<_, TrainError>((out * cotangent.clone()).sum().backward())
        };
        let got = gradient(&leaf, &both()?)?;
        let timing = time(Some(target.device), || both().map(drop))?;
        bench.add(Measurement {
            error: Errors::of(&got, &expected),
            time: Some(timing),
            ..target.measurement(self.op, "f32", Pass::Gradient, n)
        });
        Ok(())
    }
}
