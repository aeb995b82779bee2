//! Trajectories of many spans: displacement at a time, extent, and gathered rows; positions in the unit cube.

use burn::tensor::Tensor;
use dash_kernels::KernelError;
use dash_kernels::displacement::{self, displacement};
use dash_kernels::rows::{self, join_rows, take_rows};
use dash_kernels::space_time::{self, Bounds, space_time};
use dash_kernels::trajectory::{self, Polyline, squared_extent};

use super::{
    Bench, Errors, Measurement, Op, Pass, Target, generator, gradient, time, to_f64, uniform,
    values,
};
use crate::Error;
use crate::numbers::standard_normal;

/// As many as a long clip has.
const SPANS: usize = 48;
/// Of a trajectory's row.
const WIDTH: usize = 3 * SPANS;
/// One in so many rows is taken.
const STRIDE: usize = 5;
/// In the middle of the clip, on a knot.
const ANCHOR: f32 = 0.5;

pub(super) fn measure_displacement(
    bench: &mut Bench,
    target: Target,
    n: usize,
) -> Result<(), Error> {
    use displacement::reference;
    let basis = uniform(&mut generator(13), SPANS, -1.0, 1.0);
    let wide = to_f64(&basis);
    let case = Case {
        op: Op::Displacement,
        width: WIDTH,
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
) -> Result<(), Error> {
    use trajectory::reference;
    let (polyline, anchor) = (Polyline::new(SPANS, ANCHOR)?, f64::from(ANCHOR));
    let case = Case {
        op: Op::SquaredExtent,
        width: WIDTH,
        run: |coefficients| squared_extent(coefficients, polyline),
        expected: |coefficients: &[f64]| reference::squared_extent(coefficients, SPANS, anchor),
        expected_vjp: |coefficients: &[f64], v: &[f64]| {
            reference::squared_extent_vjp(coefficients, v, SPANS, anchor)
        },
    };
    case.measure(bench, target, n, [n])
}

pub(super) fn measure_take_rows(bench: &mut Bench, target: Target, n: usize) -> Result<(), Error> {
    use rows::reference;
    let taken = n.div_ceil(STRIDE);
    let rows: Vec<u32> = (0..n as u32).step_by(STRIDE).collect();
    let case = Case {
        op: Op::TakeRows,
        width: WIDTH,
        run: |coefficients| take_rows(coefficients, &rows),
        expected: |coefficients: &[f64]| reference::take_rows(coefficients, WIDTH, &rows),
        expected_vjp: |_: &[f64], v: &[f64]| reference::take_rows_vjp(v, n, WIDTH, &rows),
    };
    case.measure(bench, target, n, [taken, WIDTH])
}

pub(super) fn measure_join_rows(bench: &mut Bench, target: Target, n: usize) -> Result<(), Error> {
    use rows::reference;
    let case = Case {
        op: Op::JoinRows,
        width: WIDTH,
        run: |rows: Tensor<2>| join_rows(rows.clone(), rows),
        expected: |rows: &[f64]| reference::join_rows(rows, rows),
        expected_vjp: |_: &[f64], v: &[f64]| {
            let [first, second] = reference::join_rows_vjp(v, n * WIDTH);
            first.iter().zip(second).map(|(a, b)| a + b).collect()
        },
    };
    case.measure(bench, target, n, [2 * n, WIDTH])
}

pub(super) fn measure_space_time(bench: &mut Bench, target: Target, n: usize) -> Result<(), Error> {
    use space_time::reference;
    let bounds = Bounds {
        min: [-0.2, -0.1, -0.3],
        scale: [2.5, 5.0, 1.5],
        clamp: true,
    };
    let time = f64::from(ANCHOR);
    let case = Case {
        op: Op::SpaceTime,
        width: 3,
        run: |positions| space_time(positions, &bounds, ANCHOR),
        expected: |positions: &[f64]| reference::space_time(positions, &bounds, time),
        expected_vjp: |positions: &[f64], v: &[f64]| {
            reference::space_time_vjp(positions, v, &bounds)
        },
    };
    case.measure(bench, target, n, [n, 4])
}

/// An operation on rows, and its reference.
struct Case<F, E, G> {
    op: Op,
    /// Of a row.
    width: usize,
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
    ) -> Result<(), Error>
    where
        F: Fn(Tensor<2>) -> Result<Tensor<R>, KernelError>,
    {
        let shape = [n, self.width];
        let mut rng = generator(11);
        let coefficients: Vec<f32> = (0..n * self.width)
            .map(|_| 0.1 * standard_normal::<f32>(&mut rng))
            .collect();
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
            Ok::<_, Error>((out * cotangent.clone()).sum().backward())
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
