//! Fully connected networks on CubeCL devices: a launch for each layer. Parameters and gradients that are not finite are read as
//! zero.
//!
//! Forward and gradient to the input: a unit owns [`ROWS`] rows of [`COLUMNS`] outputs, neighbouring units neighbouring
//! outputs of the same rows, whose values come from the cache. Gradient to the parameters: a unit owns [`INPUTS`] times
//! [`COLUMNS`] weights and a chunk of rows; a last launch adds up the chunks, one unit for each parameter. No shared
//! memory, no atomics; deterministic.

mod parameters;

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{Buffer, arg, contiguous, finite_or_zero, uninitialised, units};

use super::{MlpLayer, MlpLayout, Perceptron, PerceptronVjp};
use parameters::{add_parts, parameters_vjp_kernel};

/// Rows of a unit.
const ROWS: usize = 8;
/// Outputs of a unit.
const COLUMNS: usize = 4;
/// Inputs for whose weights a unit sums gradients.
const INPUTS: usize = 4;
/// Fewest rows per chunk, and most chunks, of the sums of parameter gradients.
const PART: usize = 128;
const MOST_PARTS: usize = 256;
/// Most values that those sums take.
const MOST_SUMS: usize = 1 << 24;

impl Perceptron for CubeBackend {
    fn mlp(input: CubeTensor, parameters: CubeTensor, layout: MlpLayout) -> CubeTensor {
        let [input, parameters] = [input, parameters].map(contiguous);
        forward(&input, &parameters, &layout, layout.layers().len())
            .pop()
            .unwrap_or(input)
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
        let [input, parameters] = [input, parameters].map(contiguous);
        let client = &input.client;
        let n = input.meta.shape()[0];
        let hidden = forward(&input, &parameters, layout, layout.layers().len() - 1);
        let n_parameters = layout.n_parameters();
        let most_parts = (MOST_SUMS / n_parameters).clamp(1, MOST_PARTS);
        let part = n.div_ceil(most_parts).max(PART);
        let n_parts = n.div_ceil(part);
        let sums = needs_parameters.then(|| Buffer::uninitialised(client, n_parts * n_parameters));
        let mut v = contiguous(v_out);
        let mut v_input = None;
        for (index, layer) in layout.layers().iter().enumerate().rev() {
            let inputs = index.checked_sub(1).map_or(&input, |index| &hidden[index]);
            if let Some(sums) = &sums {
                let own = (layer.n_inputs + 1).div_ceil(INPUTS) * groups(layer.n_outputs);
                let (count, dim) = units(client, n_parts * own);
                parameters_vjp_kernel::launch(
                    client,
                    count,
                    dim,
                    arg(inputs),
                    arg(&v),
                    sums.arg(),
                    sizes(layer, n),
                    part as u32,
                    n_parameters as u32,
                );
            }
            if index > 0 || needs_input {
                v = layer_vjp(&v, inputs, &parameters, layer, index > 0);
            }
            if index == 0 && needs_input {
                v_input = Some(v.clone());
            }
        }
        let v_parameters = sums.map(|sums| {
            let total = uninitialised(&parameters, [n_parameters]);
            let (count, dim) = units(client, n_parameters);
            let (parts, n) = (n_parts as u32, n_parameters as u32);
            add_parts::launch(client, count, dim, sums.arg(), arg(&total), parts, n);
            total
        });
        [v_input, v_parameters]
    }
}

/// Units that the outputs of one row take.
fn groups(n_outputs: usize) -> usize {
    n_outputs.div_ceil(COLUMNS)
}

/// Outputs of each of the first `n_layers` layers.
fn forward(
    input: &CubeTensor,
    parameters: &CubeTensor,
    layout: &MlpLayout,
    n_layers: usize,
) -> Vec<CubeTensor> {
    let mut all: Vec<CubeTensor> = Vec::new();
    for (index, layer) in layout.layers().iter().enumerate().take(n_layers) {
        let read = all.last().unwrap_or(input);
        let n = read.meta.shape()[0];
        let out = uninitialised(read, [n, layer.n_outputs]);
        let (count, dim) = units(&read.client, n.div_ceil(ROWS) * groups(layer.n_outputs));
        layer_kernel::launch(
            &read.client,
            count,
            dim,
            arg(read),
            arg(parameters),
            arg(&out),
            sizes(layer, n),
            index + 1 < layout.layers().len(),
        );
        all.push(out);
    }
    all
}

/// Gradient of a layer's inputs from that of its outputs.
fn layer_vjp(
    v: &CubeTensor,
    inputs: &CubeTensor,
    parameters: &CubeTensor,
    layer: &MlpLayer,
    is_hidden: bool,
) -> CubeTensor {
    let n = v.meta.shape()[0];
    let out = uninitialised(v, [n, layer.n_inputs]);
    let (count, dim) = units(&v.client, n.div_ceil(ROWS) * groups(layer.n_inputs));
    layer_vjp_kernel::launch(
        &v.client,
        count,
        dim,
        arg(v),
        arg(inputs),
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

/// Where a unit's rows start; those behind the last are the last again.
#[cube]
fn row_starts(first_row: usize, n_rows: usize, width: usize) -> Array<usize> {
    let mut starts = Array::<usize>::new(ROWS);
    #[unroll]
    for row in 0..ROWS {
        starts[row] = usize::min(first_row + row, n_rows - 1usize) * width;
    }
    starts
}

/// A unit's columns, as far apart as there are groups; those behind the last are the last again.
#[cube]
fn columns(group: usize, n_groups: usize, width: usize) -> Array<usize> {
    let mut all = Array::<usize>::new(COLUMNS);
    #[unroll]
    for column in 0..COLUMNS {
        all[column] = usize::min(group + column * n_groups, width - 1usize);
    }
    all
}

#[cube(launch)]
fn layer_kernel(
    input: &[f32],      // [N, n_inputs]
    parameters: &[f32], // [P]
    out: &mut [f32],    // [N, n_outputs]
    sizes: Sizes,
    #[comptime] is_hidden: bool,
) {
    let (n_inputs, n_outputs) = (sizes.n_inputs as usize, sizes.n_outputs as usize);
    let n_rows = sizes.n_rows as usize;
    let n_groups = n_outputs.div_ceil(COLUMNS);
    let group = ABSOLUTE_POS % n_groups;
    let first_row = ABSOLUTE_POS / n_groups * ROWS;
    if first_row >= n_rows {
        terminate!();
    }
    let rows = row_starts(first_row, n_rows, n_inputs);
    let columns = columns(group, n_groups, n_outputs);
    let first = sizes.first as usize;
    let mut weights = Array::<f32>::new(COLUMNS);
    let mut sums = Array::<f32>::new(comptime!(ROWS * COLUMNS));
    #[unroll]
    for column in 0..COLUMNS {
        let bias = finite_or_zero(parameters[first + n_inputs * n_outputs + columns[column]]);
        #[unroll]
        for row in 0..ROWS {
            sums[row * COLUMNS + column] = bias;
        }
    }
    for k in 0..n_inputs {
        #[unroll]
        for column in 0..COLUMNS {
            weights[column] = finite_or_zero(parameters[first + k * n_outputs + columns[column]]);
        }
        #[unroll]
        for row in 0..ROWS {
            let value = finite_or_zero(input[rows[row] + k]);
            #[unroll]
            for column in 0..COLUMNS {
                sums[row * COLUMNS + column] += value * weights[column];
            }
        }
    }
    #[unroll]
    for row in 0..ROWS {
        #[unroll]
        for column in 0..COLUMNS {
            let at = group + column * n_groups;
            if first_row + row < n_rows && at < n_outputs {
                let value = finite_or_zero(sums[row * COLUMNS + column]);
                if is_hidden {
                    out[(first_row + row) * n_outputs + at] = f32::max(value, 0.0f32);
                } else {
                    out[(first_row + row) * n_outputs + at] = value;
                }
            }
        }
    }
}

#[cube(launch)]
fn layer_vjp_kernel(
    v: &[f32],          // [N, n_outputs]
    inputs: &[f32],     // [N, n_inputs]
    parameters: &[f32], // [P]
    out: &mut [f32],    // [N, n_inputs]
    sizes: Sizes,
    #[comptime] is_hidden: bool,
) {
    let (n_inputs, n_outputs) = (sizes.n_inputs as usize, sizes.n_outputs as usize);
    let n_rows = sizes.n_rows as usize;
    let n_groups = n_inputs.div_ceil(COLUMNS);
    let group = ABSOLUTE_POS % n_groups;
    let first_row = ABSOLUTE_POS / n_groups * ROWS;
    if first_row >= n_rows {
        terminate!();
    }
    let rows = row_starts(first_row, n_rows, n_outputs);
    let columns = columns(group, n_groups, n_inputs);
    let first = sizes.first as usize;
    let mut weights = Array::<f32>::new(COLUMNS);
    let mut sums = Array::<f32>::new(comptime!(ROWS * COLUMNS));
    #[unroll]
    for i in 0..comptime!(ROWS * COLUMNS) {
        sums[i] = 0.0f32;
    }
    for k in 0..n_outputs {
        #[unroll]
        for column in 0..COLUMNS {
            weights[column] = finite_or_zero(parameters[first + columns[column] * n_outputs + k]);
        }
        #[unroll]
        for row in 0..ROWS {
            let value = finite_or_zero(v[rows[row] + k]);
            #[unroll]
            for column in 0..COLUMNS {
                sums[row * COLUMNS + column] += value * weights[column];
            }
        }
    }
    #[unroll]
    for row in 0..ROWS {
        #[unroll]
        for column in 0..COLUMNS {
            let input = group + column * n_groups;
            if first_row + row < n_rows && input < n_inputs {
                let at = (first_row + row) * n_inputs + input;
                let value = finite_or_zero(sums[row * COLUMNS + column]);
                if is_hidden {
                    out[at] = select(inputs[at] > 0.0f32, value, 0.0f32);
                } else {
                    out[at] = value;
                }
            }
        }
    }
}
