//! The gradient of a layer's parameters: a unit owns [`INPUTS`] times [`COLUMNS`] weights and a chunk of rows, then one unit
//! for each parameter adds up the chunks.

use cubecl::prelude::*;

use super::{COLUMNS, INPUTS, Sizes, columns};
use crate::cube::finite_or_zero;

/// Gradients of the parameters, summed over a chunk of rows. Biases follow the weights, like weights of one more input
/// that is always one.
#[cube(launch)]
pub(super) fn parameters_vjp_kernel(
    inputs: &[f32],   // [N, n_inputs]
    v: &[f32],        // [N, n_outputs]
    sums: &mut [f32], // [n_parts, P]
    sizes: Sizes,
    part: u32,
    n_parameters: u32,
) {
    let (n_inputs, n_outputs) = (sizes.n_inputs as usize, sizes.n_outputs as usize);
    let n_rows = sizes.n_rows as usize;
    let n_groups = n_outputs.div_ceil(COLUMNS);
    let own = (n_inputs + 1usize).div_ceil(INPUTS) * n_groups;
    let first_row = ABSOLUTE_POS / own * part as usize;
    if first_row >= n_rows {
        terminate!();
    }
    let group = ABSOLUTE_POS % n_groups;
    let first_input = ABSOLUTE_POS % own / n_groups * INPUTS;
    let columns = columns(group, n_groups, n_outputs);
    let mut values = Array::<f32>::new(INPUTS);
    let mut held = Array::<f32>::new(comptime!(INPUTS * COLUMNS));
    #[unroll]
    for i in 0..comptime!(INPUTS * COLUMNS) {
        held[i] = 0.0f32;
    }
    for row in first_row..usize::min(first_row + part as usize, n_rows) {
        #[unroll]
        for i in 0..INPUTS {
            let input = usize::min(first_input + i, n_inputs - 1usize);
            let value = finite_or_zero(inputs[row * n_inputs + input]);
            values[i] = select(first_input + i < n_inputs, value, 1.0f32);
        }
        #[unroll]
        for column in 0..COLUMNS {
            let v = finite_or_zero(v[row * n_outputs + columns[column]]);
            #[unroll]
            for i in 0..INPUTS {
                held[i * COLUMNS + column] += values[i] * v;
            }
        }
    }
    let slot = ABSOLUTE_POS / own * n_parameters as usize + sizes.first as usize;
    #[unroll]
    for i in 0..INPUTS {
        #[unroll]
        for column in 0..COLUMNS {
            let at = group + column * n_groups;
            if first_input + i <= n_inputs && at < n_outputs {
                sums[slot + (first_input + i) * n_outputs + at] = held[i * COLUMNS + column];
            }
        }
    }
}

#[cube(launch)]
pub(super) fn add_parts(
    sums: &[f32],      // [n_parts, P]
    total: &mut [f32], // [P]
    n_parts: u32,
    n_parameters: u32,
) {
    // The memory of the total may be longer than it.
    let n_parameters = n_parameters as usize;
    if ABSOLUTE_POS >= n_parameters {
        terminate!();
    }
    let mut sum = 0.0f32;
    for part in 0..n_parts as usize {
        sum += sums[part * n_parameters + ABSOLUTE_POS];
    }
    total[ABSOLUTE_POS] = finite_or_zero(sum);
}
