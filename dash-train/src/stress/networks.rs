//! Small networks of all widths, and values at both ends of what f32 holds.

use burn::tensor::Device;
use dash_kernels::mlp::{MlpLayout, mlp, reference};

use super::Case;
use super::inputs::{gradient, rng, tensor, to_host, tracked, uniform, widen};
use super::measured::Measured;
use crate::Error;

const FAMILY: &str = "network";

/// Relative error of a row's outputs and gradients, as lengths: what comes through up to five layers, each of up to a
/// thousand products, may all but cancel in the last.
const RELATIVE: f64 = 1e-4;

pub(super) const CASES: &[Case] = &[
    Case {
        family: FAMILY,
        name: "widths",
        extreme: "1 to 1,024 units, one layer to five, 1 to 2,000 rows",
        measure: widths,
    },
    Case {
        family: FAMILY,
        name: "sizes",
        extreme: "rows of 1e-15 to 1e15 and of zeros, weights of 1e-9 and of 1e9",
        measure: sizes,
    },
    Case {
        family: FAMILY,
        name: "dead units",
        extreme: "all units off, and units exactly at zero",
        measure: dead_units,
    },
    Case {
        family: FAMILY,
        name: "overflow",
        extreme: "sums and gradients beyond what f32 holds",
        measure: overflow,
    },
];

/// Weights that keep the size of activations from layer to layer, and biases of up to `bias`.
fn parameters(layout: &MlpLayout, seed: u64, bias: f32) -> Vec<f32> {
    let mut values = uniform(&mut rng(seed), layout.n_parameters(), -1.0, 1.0);
    for layer in layout.layers() {
        let bound = (6.0 / layer.n_inputs as f32).sqrt();
        for weight in &mut values[layer.first..layer.first_bias()] {
            *weight *= bound;
        }
        for value in &mut values[layer.first_bias()..][..layer.n_outputs] {
            *value *= bias;
        }
    }
    values
}

/// What a network gives, and its gradients `[input, parameters]`.
fn on_device(
    layout: &MlpLayout,
    [input, parameters, v_out]: [&[f32]; 3],
    device: &Device,
) -> Result<[Vec<f32>; 3], Error> {
    let n = input.len() / layout.n_inputs();
    let input = tracked(input, [n, layout.n_inputs()], device);
    let parameters = tracked(parameters, [parameters.len()], device);
    let out = mlp(input.clone(), parameters.clone(), layout)?;
    let found = to_host(out.clone().inner());
    let v_out = tensor(v_out, [n, layout.n_outputs()], &device.clone().autodiff());
    let gradients = (out * v_out).sum().backward();
    Ok([
        found,
        gradient(&input, &gradients),
        gradient(&parameters, &gradients),
    ])
}

/// Outputs and their gradients row by row, those of the parameters as a whole.
fn judge(
    measured: &mut Measured,
    name: &str,
    layout: &MlpLayout,
    values: [&[f32]; 3],
    device: &Device,
) -> Result<(), Error> {
    let [out, v_input, v_parameters] = on_device(layout, values, device)?;
    let [input, parameters, v_out] = values.map(widen);
    let part = |what: &str| format!("{name}: {what}");
    let expected = reference::mlp(&input, &parameters, layout);
    measured.agree_by_row(
        &part("outputs"),
        &out,
        &expected,
        layout.n_outputs(),
        RELATIVE,
    );
    let expected = reference::mlp_vjp(&input, &parameters, &v_out, layout);
    let width = layout.n_inputs();
    measured.agree_by_row(&part("input"), &v_input, &expected.0, width, RELATIVE);
    measured.agree(&part("parameters"), &v_parameters, &expected.1, RELATIVE);
    Ok(())
}

fn widths(device: &Device) -> Result<Measured, Error> {
    let mut measured = Measured::default();
    let forms: [(&[usize], usize); 5] = [
        (&[1, 1], 2_000),
        (&[1, 1_024, 1], 65),
        (&[256, 256, 256, 10], 129),
        (&[15, 17, 31, 33, 16, 3], 2_000),
        (&[1_000, 3], 1),
    ];
    for (seed, (widths, n)) in forms.into_iter().enumerate() {
        let layout = MlpLayout::new(widths)?;
        let mut rng = rng(80 + seed as u64);
        // Away from zero, where a rounding error turns a unit off.
        let input = uniform(&mut rng, n * layout.n_inputs(), 0.5, 1.0);
        let v_out = uniform(&mut rng, n * layout.n_outputs(), 0.5, 1.0);
        let parameters = parameters(&layout, 90 + seed as u64, 0.1);
        let name = format!("{widths:?}, {n} rows");
        judge(
            &mut measured,
            &name,
            &layout,
            [&input, &parameters, &v_out],
            device,
        )?;
    }
    Ok(measured)
}

fn sizes(device: &Device) -> Result<Measured, Error> {
    let mut measured = Measured::default();
    let layout = MlpLayout::new(&[8, 32, 32, 4])?;
    let sizes = [1e-15, 1e-9, 1e-3, 1.0, 1e3, 1e9, 1e15, 0.0];
    let mut rng = rng(100);
    for (name, factor) in [("weights of 1e-9", 1e-9), ("of 1", 1.0), ("of 1e9", 1e9)] {
        let mut parameters = parameters(&layout, 101, 0.0);
        let (first, last) = (layout.layers()[0], layout.layers()[2]);
        for weight in &mut parameters[first.first..first.first_bias()] {
            *weight *= factor;
        }
        for weight in &mut parameters[last.first..last.first_bias()] {
            *weight /= factor;
        }
        for size in sizes {
            let mut input = uniform(&mut rng, 3 * 8, -1.0, 1.0);
            for value in &mut input {
                *value *= size;
            }
            let v_out = uniform(&mut rng, 3 * 4, 0.5, 1.0);
            let name = format!("{name}, rows of {size:e}");
            judge(
                &mut measured,
                &name,
                &layout,
                [&input, &parameters, &v_out],
                device,
            )?;
        }
    }
    Ok(measured)
}

fn dead_units(device: &Device) -> Result<Measured, Error> {
    let mut measured = Measured::default();
    let layout = MlpLayout::new(&[2, 20, 3])?;
    let input = uniform(&mut rng(110), 70 * 2, 0.0, 1.0);
    let v_out = uniform(&mut rng(111), 70 * 3, 0.5, 1.0);
    for (name, bias) in [("off", -100.0), ("at zero", 0.0)] {
        let mut parameters = parameters(&layout, 112, 1.0);
        let hidden = layout.layers()[0];
        if bias == 0.0 {
            parameters[..hidden.first_bias()].fill(0.0);
        }
        parameters[hidden.first_bias()..][..hidden.n_outputs].fill(bias);
        judge(
            &mut measured,
            name,
            &layout,
            [&input, &parameters, &v_out],
            device,
        )?;
        let [_, v_input, v_parameters] = on_device(&layout, [&input, &parameters, &v_out], device)?;
        let weights = &v_parameters[..layout.layers()[1].first_bias()];
        let moved = v_input.iter().chain(weights).filter(|v| **v != 0.0);
        measured.none(
            format!("{name}: gradients behind dead units"),
            moved.count(),
        );
    }
    Ok(measured)
}

fn overflow(device: &Device) -> Result<Measured, Error> {
    let mut measured = Measured::default();
    let layout = MlpLayout::new(&[3, 20, 20, 4])?;
    let n = 70;
    for (name, [input, weight, v_out]) in [
        ("sums", [1e30, 1e20, 1.0]),
        ("products", [f32::MAX, f32::MAX, 1.0]),
        ("gradients", [1.0, 1e15, 1e30]),
        ("everything", [f32::MAX; 3]),
    ] {
        let mut rng = rng(120);
        let input = uniform(&mut rng, n * 3, -1.0, 1.0)
            .iter()
            .map(|x| x * input)
            .collect::<Vec<_>>();
        let v_out = uniform(&mut rng, n * 4, -1.0, 1.0)
            .iter()
            .map(|x| x * v_out)
            .collect::<Vec<_>>();
        let parameters = uniform(&mut rng, layout.n_parameters(), -1.0, 1.0);
        let parameters = parameters.iter().map(|x| x * weight).collect::<Vec<_>>();
        let found = on_device(&layout, [&input, &parameters, &v_out], device)?;
        let lost = found.iter().flatten().filter(|value| !value.is_finite());
        measured.none(format!("{name}: values that are not finite"), lost.count());
    }
    Ok(measured)
}
