//! Gradients that are hard to follow.

use burn::tensor::Device;
use dash_kernels::adam::{AdamStep, adam_step, reference};

use super::Case;
use super::inputs::{tensor, to_host, widen};
use super::measured::{Measured, largest_difference};
use crate::Error;

const FAMILY: &str = "adam";

const RATE: f64 = 0.25;
/// Difference of a parameter in steps of full length: squares of tiny gradients are denormal or zero in
/// single precision, where epsilon has damped the step already.
const STEPS: f64 = 1e-3;

pub(super) const CASES: &[Case] = &[
    Case {
        family: FAMILY,
        name: "gradients",
        extreme: "|g| of 1e-38 to 1e38, ten steps",
        measure: gradients,
    },
    Case {
        family: FAMILY,
        name: "changing gradients",
        extreme: "|g| that falls from 1e17 to 1e-17 and back within 70 steps",
        measure: changing,
    },
    Case {
        family: FAMILY,
        name: "lost gradients",
        extreme: "NaN and infinite gradients among others",
        measure: lost,
    },
];

/// Parameters and both moments.
type State<T> = [Vec<T>; 3];

/// The state after steps along gradients, on the device and in `f64`.
fn follow(
    n: usize,
    gradients: impl Iterator<Item = Vec<f32>>,
    device: &Device,
) -> Result<(State<f32>, State<f64>), Error> {
    let mut state = [(); 3].map(|()| tensor(&vec![0.0; n], [n], device));
    let mut expected = [(); 3].map(|()| vec![0.0f64; n]);
    for (step, gradient) in (1..).zip(gradients) {
        let settings = AdamStep {
            learning_rate: RATE,
            step,
            ..AdamStep::default()
        };
        let [param, first, second] = state;
        let after = adam_step(
            param,
            tensor(&gradient, [n], device),
            first,
            second,
            &settings,
        )?;
        state = [after.0, after.1, after.2];
        let [param, first, second] = &mut expected;
        reference::adam_step(param, &widen(&gradient), first, second, &settings);
    }
    Ok((state.map(to_host), expected))
}

fn gradients(device: &Device) -> Result<Measured, Error> {
    let sizes: Vec<f32> = (-38..=38)
        .flat_map(|exponent| {
            let g = 10f64.powi(exponent) as f32;
            [g, -g]
        })
        .collect();
    let steps = 10;
    let (got, expected) = follow(sizes.len(), (0..steps).map(|_| sizes.clone()), device)?;
    let mut measured = Measured::default();
    got.iter().for_each(|values| measured.saw(values));
    let error = largest_difference(&got[0], &expected[0]) / RATE;
    measured.judge("parameters, in steps", error, STEPS * f64::from(steps));
    Ok(measured)
}

fn changing(device: &Device) -> Result<Measured, Error> {
    let exponents = (-17..=17).rev().chain(-17..=17);
    let all = exponents.map(|exponent| {
        let g = 10f64.powi(exponent) as f32;
        vec![g, -g]
    });
    let (got, expected) = follow(2, all, device)?;
    let mut measured = Measured::default();
    got.iter().for_each(|values| measured.saw(values));
    measured.agree("parameters", &got[0], &expected[0], STEPS);
    Ok(measured)
}

fn lost(device: &Device) -> Result<Measured, Error> {
    let gradient = vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, 1.0];
    let n = gradient.len();
    let (got, expected) = follow(n, (0..5).map(|_| gradient.clone()), device)?;
    let mut measured = Measured::default();
    got.iter().for_each(|values| measured.saw(values));
    measured.agree("parameters", &got[0], &expected[0], STEPS);
    let touched = got
        .iter()
        .flat_map(|values| &values[..3])
        .filter(|v| **v != 0.0);
    measured.none("steps along what is lost", touched.count());
    Ok(measured)
}
