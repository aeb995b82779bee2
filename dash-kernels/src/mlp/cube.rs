//! Fully connected networks on CubeCL devices: a launch for each layer.
//!
//! Forward and gradient to the input: a unit owns one output of [`ROWS`] rows, neighbouring units the same rows, whose
//! values come from the cache. Gradient to the parameters: a unit owns one parameter and a part of the rows; a second
//! launch adds up the parts, one unit for each parameter. No shared memory, no atomics; deterministic.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{Buffer, arg, contiguous, finite_or_zero, uninitialised, units};

use super::{MlpLayer, MlpLayout, Perceptron, PerceptronVjp};

/// Rows of a unit.
const ROWS: usize = 8;
/// Fewest rows, and most parts, that gradients of the parameters are summed over.
const PART: usize = 128;
const MOST_PARTS: usize = 256;
/// Most values that those sums take.
const MOST_SUMS: usize = 1 << 24;

impl Perceptron for CubeBackend {
    fn mlp(input: CubeTensor, parameters: CubeTensor, layout: MlpLayout) -> CubeTensor {
        let (input, parameters) = (contiguous(input), contiguous(parameters));
        let n_layers = layout.layers().len();
        let hidden = hidden(&input, &parameters, &layout);
        let last = hidden.last().unwrap_or(&input);
        give(last, &parameters, &layout.layers()[n_layers - 1], false)
    }
}

impl PerceptronVjp for CubeBackend {
    fn mlp_vjp(
        input: CubeTensor,
        parameters: CubeTensor,
        v_out: CubeTensor,
        layout: &MlpLayout,
        [needs_input, needs_parameters]: [bool; 2],
    ) -> [Option<CubeTensor>; 2] {
        let [input, parameters, v_out] = [input, parameters, v_out].map(contiguous);
        let client = &input.client;
        let n = input.meta.shape()[0];
        let hidden = hidden(&input, &parameters, layout);
        let n_parameters = layout.n_parameters();
        let most_parts = (MOST_SUMS / n_parameters).clamp(1, MOST_PARTS);
        let part = n.div_ceil(most_parts).max(PART);
        let n_parts = n.div_ceil(part);
        let sums = needs_parameters.then(|| Buffer::uninitialised(client, n_parts * n_parameters));
        let mut v = v_out;
        let mut v_input = None;
        for (index, layer) in layout.layers().iter().enumerate().rev() {
            let given = if index == 0 {
                &input
            } else {
                &hidden[index - 1]
            };
            if let Some(sums) = &sums {
                let own = (layer.n_inputs + 1) * layer.n_outputs;
                let (count, dim) = units(client, n_parts * own);
                sum_parts::launch(
                    client,
                    count,
                    dim,
                    arg(given),
                    arg(&v),
                    sums.arg(),
                    sizes(layer, n),
                    part as u32,
                    n_parameters as u32,
                );
            }
            if index > 0 || needs_input {
                v = read(&v, given, &parameters, layer, index > 0);
            }
            if index == 0 && needs_input {
                v_input = Some(v.clone());
            }
        }
        let v_parameters = sums.map(|sums| {
            let total = uninitialised(&parameters, [n_parameters]);
            let (count, dim) = units(client, n_parameters);
            add_parts::launch(client, count, dim, sums.arg(), arg(&total), n_parts as u32);
            total
        });
        [v_input, v_parameters]
    }
}

/// What every layer but the last gives.
fn hidden(input: &CubeTensor, parameters: &CubeTensor, layout: &MlpLayout) -> Vec<CubeTensor> {
    let mut all: Vec<CubeTensor> = Vec::new();
    for layer in &layout.layers()[..layout.layers().len() - 1] {
        let given = give(all.last().unwrap_or(input), parameters, layer, true);
        all.push(given);
    }
    all
}

/// A layer's output.
fn give(
    input: &CubeTensor,
    parameters: &CubeTensor,
    layer: &MlpLayer,
    is_hidden: bool,
) -> CubeTensor {
    let n = input.meta.shape()[0];
    let out = uninitialised(input, [n, layer.n_outputs]);
    let (count, dim) = units(&input.client, n.div_ceil(ROWS) * layer.n_outputs);
    forward::launch(
        &input.client,
        count,
        dim,
        arg(input),
        arg(parameters),
        arg(&out),
        sizes(layer, n),
        is_hidden,
    );
    out
}

/// Gradient of what a layer reads, `given`, from that of what it gives.
fn read(
    v: &CubeTensor,
    given: &CubeTensor,
    parameters: &CubeTensor,
    layer: &MlpLayer,
    is_hidden: bool,
) -> CubeTensor {
    let n = v.meta.shape()[0];
    let out = uninitialised(v, [n, layer.n_inputs]);
    let (count, dim) = units(&v.client, n.div_ceil(ROWS) * layer.n_inputs);
    backward::launch(
        &v.client,
        count,
        dim,
        arg(v),
        arg(given),
        arg(parameters),
        arg(&out),
        sizes(layer, n),
        is_hidden,
    );
    out
}

/// A layer and how many rows go through it.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
struct Sizes {
    n_rows: u32,
    n_inputs: u32,
    n_outputs: u32,
    first: u32,
}

fn sizes(layer: &MlpLayer, n: usize) -> SizesLaunch {
    SizesLaunch::new(
        n as u32,
        layer.n_inputs as u32,
        layer.n_outputs as u32,
        layer.first as u32,
    )
}

#[cube(launch)]
fn forward(
    input: &[f32],
    parameters: &[f32],
    out: &mut [f32],
    sizes: Sizes,
    #[comptime] is_hidden: bool,
) {
    let (n_inputs, n_outputs) = (sizes.n_inputs as usize, sizes.n_outputs as usize);
    let n_rows = sizes.n_rows as usize;
    let column = ABSOLUTE_POS % n_outputs;
    let first_row = ABSOLUTE_POS / n_outputs * ROWS;
    if first_row >= n_rows {
        terminate!();
    }
    let weights = sizes.first as usize + column;
    let bias = finite_or_zero(parameters[weights + n_inputs * n_outputs]);
    let mut sums = Array::<f32>::new(ROWS);
    #[unroll]
    for row in 0..ROWS {
        sums[row] = bias;
    }
    for k in 0..n_inputs {
        let weight = finite_or_zero(parameters[weights + k * n_outputs]);
        #[unroll]
        for row in 0..ROWS {
            // Rows behind the last are the last again.
            let at = usize::min(first_row + row, n_rows - 1usize);
            sums[row] += finite_or_zero(input[at * n_inputs + k]) * weight;
        }
    }
    #[unroll]
    for row in 0..ROWS {
        if first_row + row < n_rows {
            let value = finite_or_zero(sums[row]);
            let at = (first_row + row) * n_outputs + column;
            if is_hidden {
                out[at] = f32::max(value, 0.0f32);
            } else {
                out[at] = value;
            }
        }
    }
}

#[cube(launch)]
fn backward(
    v: &[f32],
    given: &[f32],
    parameters: &[f32],
    out: &mut [f32],
    sizes: Sizes,
    #[comptime] is_hidden: bool,
) {
    let (n_inputs, n_outputs) = (sizes.n_inputs as usize, sizes.n_outputs as usize);
    let n_rows = sizes.n_rows as usize;
    let column = ABSOLUTE_POS % n_inputs;
    let first_row = ABSOLUTE_POS / n_inputs * ROWS;
    if first_row >= n_rows {
        terminate!();
    }
    let weights = sizes.first as usize + column * n_outputs;
    let mut sums = Array::<f32>::new(ROWS);
    #[unroll]
    for row in 0..ROWS {
        sums[row] = 0.0f32;
    }
    for k in 0..n_outputs {
        let weight = finite_or_zero(parameters[weights + k]);
        #[unroll]
        for row in 0..ROWS {
            let at = usize::min(first_row + row, n_rows - 1usize);
            sums[row] += finite_or_zero(v[at * n_outputs + k]) * weight;
        }
    }
    #[unroll]
    for row in 0..ROWS {
        if first_row + row < n_rows {
            let at = (first_row + row) * n_inputs + column;
            let value = finite_or_zero(sums[row]);
            if is_hidden {
                out[at] = select(given[at] > 0.0f32, value, 0.0f32);
            } else {
                out[at] = value;
            }
        }
    }
}

/// A parameter's gradient, summed over a part of the rows. Biases come behind the weights, as if one more input were
/// always one.
#[cube(launch)]
fn sum_parts(
    given: &[f32],
    v: &[f32],
    sums: &mut [f32],
    sizes: Sizes,
    part: u32,
    n_parameters: u32,
) {
    let (n_inputs, n_outputs) = (sizes.n_inputs as usize, sizes.n_outputs as usize);
    let own = (n_inputs + 1usize) * n_outputs;
    let parameter = ABSOLUTE_POS % own;
    let first_row = ABSOLUTE_POS / own * part as usize;
    let n_rows = sizes.n_rows as usize;
    if first_row >= n_rows {
        terminate!();
    }
    let (input, column) = (parameter / n_outputs, parameter % n_outputs);
    let end = usize::min(first_row + part as usize, n_rows);
    let mut sum = 0.0f32;
    for row in first_row..end {
        let mut value = 1.0f32;
        if input < n_inputs {
            value = finite_or_zero(given[row * n_inputs + input]);
        }
        sum += value * finite_or_zero(v[row * n_outputs + column]);
    }
    let slot = ABSOLUTE_POS / own * n_parameters as usize;
    sums[slot + sizes.first as usize + parameter] = sum;
}

#[cube(launch)]
fn add_parts(sums: &[f32], total: &mut [f32], n_parts: u32) {
    if ABSOLUTE_POS >= total.len() {
        terminate!();
    }
    let mut sum = 0.0f32;
    for part in 0..n_parts as usize {
        sum += sums[part * total.len() + ABSOLUTE_POS];
    }
    total[ABSOLUTE_POS] = finite_or_zero(sum);
}
