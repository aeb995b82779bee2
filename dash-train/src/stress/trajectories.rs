//! Trajectories that are hard to sum.

use burn::tensor::Device;
use dash_kernels::trajectory::{Polyline, reference, squared_extent};

use super::Case;
use super::inputs::{gradient, rng, tensor, to_host, tracked, uniform, widen};
use super::measured::Measured;
use crate::Error;

const FAMILY: &str = "trajectory";

/// Relative error of a trajectory's extent and of its gradient: thousands of additions, none of which cancels.
const RELATIVE: f64 = 1e-4;

pub(super) const CASES: &[Case] = &[
    Case {
        family: FAMILY,
        name: "lengths",
        extreme: "trajectories of 1e-15 to 1e15 world units, and at rest",
        measure: lengths,
    },
    Case {
        family: FAMILY,
        name: "there and back",
        extreme: "1e6 units away and back on one side of the anchor, a thousandth on the other",
        measure: there_and_back,
    },
    Case {
        family: FAMILY,
        name: "spans",
        extreme: "1 to 4,096 spans, anchors at 0, at 1, on knots and between them",
        measure: spans,
    },
];

/// Extents and gradients of trajectories, each by itself.
fn judge(
    measured: &mut Measured,
    coefficients: &[f32],
    n_spans: usize,
    anchor: f32,
    device: &Device,
) -> Result<(), Error> {
    let width = 3 * n_spans;
    let n = coefficients.len() / width;
    let v_out = uniform(&mut rng(61), n, 0.5, 1.5);
    let tracked = tracked(coefficients, [n, width], device);
    let out = squared_extent(tracked.clone(), Polyline::new(n_spans, anchor)?)?;
    let found = to_host(out.clone().inner());
    let v = tensor(&v_out, [n], &device.clone().autodiff());
    let gradients = (out * v).sum().backward();
    let coefficients = widen(coefficients);
    // Where between its knots the anchor lies is a matter of f32.
    let anchor = f64::from(anchor * n_spans as f32) / n_spans as f64;
    let expected = reference::squared_extent(&coefficients, n_spans, anchor);
    let part = |what: &str| format!("{n_spans} spans: {what}");
    measured.agree_by_row(&part("extents"), &found, &expected, 1, RELATIVE);
    let expected = reference::squared_extent_vjp(&coefficients, &widen(&v_out), n_spans, anchor);
    let found = gradient(&tracked, &gradients);
    measured.agree_by_row(&part("gradient"), &found, &expected, width, RELATIVE);
    Ok(())
}

fn lengths(device: &Device) -> Result<Measured, Error> {
    let mut measured = Measured::default();
    let n_spans = 48;
    let mut rng = rng(62);
    let scales = [1e-15, 1e-9, 1e-3, 1.0, 1e3, 1e9, 1e15, 0.0];
    let rows = scales.map(|scale| {
        uniform(&mut rng, 3 * n_spans, -1.0, 1.0)
            .into_iter()
            .map(move |c| c * scale / 48.0)
    });
    let coefficients: Vec<f32> = rows.into_iter().flatten().collect();
    judge(&mut measured, &coefficients, n_spans, 0.506, device)?;
    Ok(measured)
}

fn there_and_back(device: &Device) -> Result<Measured, Error> {
    let mut measured = Measured::default();
    let n_spans = 8;
    let mut row = vec![0.0f32; 3 * n_spans];
    (row[0], row[3]) = (1e6, -1e6);
    row[3 * 6] = 1e-3;
    judge(&mut measured, &row, n_spans, 0.5, device)?;
    // By axis: what is small lies along one of its own.
    row[3 * 6] = 0.0;
    row[3 * 6 + 1] = 1e-3;
    let tracked = tracked(&row, [1, 3 * n_spans], device);
    let out = squared_extent(tracked.clone(), Polyline::new(n_spans, 0.5)?)?;
    let found = gradient(&tracked, &out.sum().backward());
    let expected = reference::squared_extent_vjp(&widen(&row), &[1.0], n_spans, 0.5);
    measured.agree_by_row("each coefficient", &found, &expected, 1, RELATIVE);
    Ok(measured)
}

fn spans(device: &Device) -> Result<Measured, Error> {
    let mut measured = Measured::default();
    for (seed, n_spans) in [1, 2, 3, 48, 4096].into_iter().enumerate() {
        let coefficients = uniform(&mut rng(63 + seed as u64), 2 * 3 * n_spans, -1.0, 1.0);
        for anchor in [0.0, 1.0, 0.5, 0.3337, 1.0f32.next_down()] {
            judge(&mut measured, &coefficients, n_spans, anchor, device)?;
        }
    }
    Ok(measured)
}
