//! Fully connected networks on the CPU.
//!
//! A piece of the work is a block of rows that goes through all layers while it is in the fast cache. Sixteen outputs
//! of four rows at a time are summed up in registers; weights are laid out anew so that those sixteen lie side by side.
//! Rows are independent; gradients of the parameters are summed over parts of the rows whose number and order do not
//! depend on threads.

use rayon::prelude::*;

use super::{MlpLayer, MlpLayout};
use crate::isa::{Kernel, dispatch};

/// Values summed side by side.
const LANES: usize = 16;
/// Rows (of parameters' gradients: inputs) whose sums are held at a time.
const ROWS: usize = 4;
/// Rows that go through all layers together.
const BLOCK: usize = 64;
/// Fewest rows, and most parts, that gradients of the parameters are summed over.
const PART: usize = 8 * BLOCK;
const MOST_PARTS: usize = 64;

type Lanes = [f32; LANES];

/// A layer's parameters, padded with zeros to whole lanes.
struct Packed {
    n_inputs: usize,
    n_outputs: usize,
    /// For each sixteen outputs, their weights for every input.
    weights: Vec<Lanes>,
    biases: Vec<Lanes>,
    /// For each sixteen inputs, their weights for every output.
    transposed: Vec<Lanes>,
}

impl Packed {
    fn new(layer: &MlpLayer, parameters: &[f32], with_transposed: bool) -> Self {
        let MlpLayer {
            n_inputs,
            n_outputs,
            first,
        } = *layer;
        let weight = |k: usize, j: usize| {
            if k < n_inputs && j < n_outputs {
                finite_or_zero(parameters[first + k * n_outputs + j])
            } else {
                0.0
            }
        };
        let biases = parameters[layer.first_bias()..][..n_outputs].chunks(LANES);
        let transposed_panels = if with_transposed { panels(n_inputs) } else { 0 };
        Self {
            n_inputs,
            n_outputs,
            weights: lanes(panels(n_outputs), n_inputs, |j, k| weight(k, j)),
            biases: biases
                .map(|chunk| {
                    std::array::from_fn(|l| chunk.get(l).map_or(0.0, |&b| finite_or_zero(b)))
                })
                .collect(),
            transposed: lanes(transposed_panels, n_outputs, weight),
        }
    }
}

/// `value(lane, step)` of `panels` times sixteen lanes over `n` steps.
fn lanes(panels: usize, n: usize, value: impl Fn(usize, usize) -> f32) -> Vec<Lanes> {
    (0..panels)
        .flat_map(|panel| (0..n).map(move |step| (panel, step)))
        .map(|(panel, step)| std::array::from_fn(|l| value(panel * LANES + l, step)))
        .collect()
}

/// Lanes that hold `width` values.
fn panels(width: usize) -> usize {
    width.div_ceil(LANES)
}

fn pack(parameters: &[f32], layout: &MlpLayout, with_transposed: bool) -> Vec<Packed> {
    layout
        .layers()
        .iter()
        .map(|layer| Packed::new(layer, parameters, with_transposed))
        .collect()
}

/// `input [N, n_inputs], parameters [P] -> [N, n_outputs]`, see [`mlp`](super::mlp()).
pub fn mlp(input: &[f32], parameters: &[f32], layout: &MlpLayout) -> Vec<f32> {
    let (n_inputs, n_outputs) = (layout.n_inputs(), layout.n_outputs());
    let layers = pack(parameters, layout, false);
    let mut out = vec![0.0; input.len() / n_inputs * n_outputs];
    out.par_chunks_mut(BLOCK * n_outputs)
        .zip(input.par_chunks(BLOCK * n_inputs))
        .for_each_init(
            || Activations::new(layout),
            |activations, (out, input)| {
                dispatch(Forward {
                    layers: &layers,
                    input,
                    activations: &mut *activations,
                });
                unpad(out, &activations.0[layers.len()], n_outputs);
            },
        );
    out
}

/// Gradients `[v_input, v_parameters]` of [`mlp`], where `needed`, from `v_out [N, n_outputs]`.
pub fn mlp_vjp(
    input: &[f32],
    parameters: &[f32],
    v_out: &[f32],
    layout: &MlpLayout,
    [needs_input, needs_parameters]: [bool; 2],
) -> [Option<Vec<f32>>; 2] {
    let (n_inputs, n_outputs) = (layout.n_inputs(), layout.n_outputs());
    let n = input.len() / n_inputs;
    let layers = pack(parameters, layout, true);
    let part = n.div_ceil(MOST_PARTS).next_multiple_of(BLOCK).max(PART);
    let mut v_input = vec![0.0; if needs_input { input.len() } else { 0 }];
    let mut v_inputs: Vec<&mut [f32]> = v_input.chunks_mut(part * n_inputs).collect();
    v_inputs.resize_with(n.div_ceil(part), Default::default);
    let sums: Vec<Vec<f32>> = v_inputs
        .into_par_iter()
        .zip(input.par_chunks(part * n_inputs))
        .zip(v_out.par_chunks(part * n_outputs))
        .map(|((v_input, input), v_out)| {
            let mut scratch = Scratch::new(layout, needs_input, needs_parameters);
            let mut v_inputs = v_input.chunks_mut(BLOCK * n_inputs);
            let blocks = input.chunks(BLOCK * n_inputs);
            for (input, v_out) in blocks.zip(v_out.chunks(BLOCK * n_outputs)) {
                dispatch(Backward {
                    layers: &layers,
                    input,
                    v_out,
                    scratch: &mut scratch,
                });
                if let Some(v_input) = v_inputs.next() {
                    unpad(v_input, &scratch.v, n_inputs);
                }
            }
            scratch.parameters(layout)
        })
        .collect();
    let v_parameters = needs_parameters.then(|| {
        let mut sums = sums.into_iter();
        let mut total = sums.next().unwrap_or_default();
        for sum in sums {
            for (total, value) in total.iter_mut().zip(sum) {
                *total += value;
            }
        }
        for value in &mut total {
            *value = finite_or_zero(*value);
        }
        total
    });
    [needs_input.then_some(v_input), v_parameters]
}

/// The input of every layer and the output, for a block of rows in whole lanes.
struct Activations(Vec<Vec<Lanes>>);

impl Activations {
    fn new(layout: &MlpLayout) -> Self {
        let outputs = layout.layers().iter().map(|layer| layer.n_outputs);
        let widths = std::iter::once(layout.n_inputs()).chain(outputs);
        Self(
            widths
                .map(|width| vec![[0.0; LANES]; BLOCK * panels(width)])
                .collect(),
        )
    }
}

/// What the gradient of a block needs, and the sums over blocks.
struct Scratch {
    activations: Activations,
    /// Gradient of what the layer at hand gives, then of what it reads.
    v: Vec<Lanes>,
    v_before: Vec<Lanes>,
    /// For each layer, the gradients of its weights, input by input, and of its biases.
    sums: Vec<(Vec<Lanes>, Vec<Lanes>)>,
    needs_input: bool,
}

impl Scratch {
    fn new(layout: &MlpLayout, needs_input: bool, needs_parameters: bool) -> Self {
        let widest = BLOCK * panels(layout.largest_width());
        let zeros = |n: usize| vec![[0.0; LANES]; n];
        let sums = layout.layers().iter().filter(|_| needs_parameters);
        Self {
            activations: Activations::new(layout),
            v: zeros(widest),
            v_before: zeros(widest),
            sums: sums
                .map(|layer| {
                    let panels = panels(layer.n_outputs);
                    let inputs = layer.n_inputs.next_multiple_of(ROWS);
                    (zeros(inputs * panels), zeros(panels))
                })
                .collect(),
            needs_input,
        }
    }

    /// The sums in the order of the network's parameters.
    fn parameters(&self, layout: &MlpLayout) -> Vec<f32> {
        let mut all = Vec::with_capacity(layout.n_parameters());
        for ((weights, biases), layer) in self.sums.iter().zip(layout.layers()) {
            let rows = weights.chunks_exact(biases.len()).take(layer.n_inputs);
            for row in rows.chain([biases.as_slice()]) {
                all.extend_from_slice(&row.as_flattened()[..layer.n_outputs]);
            }
        }
        all
    }
}

/// Values of rows in whole lanes, without the padding.
fn unpad(out: &mut [f32], padded: &[Lanes], width: usize) {
    let rows = padded.chunks_exact(panels(width));
    for (out, row) in out.chunks_exact_mut(width).zip(rows) {
        out.copy_from_slice(&row.as_flattened()[..width]);
    }
}

/// Finite values of rows in whole lanes, with zeros in the padding and in the rows up to a multiple of [`ROWS`].
/// Returns that many rows.
#[inline(always)]
fn pad(padded: &mut [Lanes], rows: &[f32], width: usize) -> usize {
    let n = rows.len() / width;
    let padded_rows = n.next_multiple_of(ROWS);
    let panels = panels(width);
    for (padded, row) in padded
        .chunks_exact_mut(panels)
        .zip(rows.chunks_exact(width))
    {
        let padded = padded.as_flattened_mut();
        for (padded, &value) in padded.iter_mut().zip(row) {
            *padded = finite_or_zero(value);
        }
        padded[width..].fill(0.0);
    }
    padded[n * panels..padded_rows * panels].fill([0.0; LANES]);
    padded_rows
}

/// One block through all layers.
struct Forward<'a> {
    layers: &'a [Packed],
    input: &'a [f32],
    activations: &'a mut Activations,
}

impl Kernel for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        forward(self.layers, self.input, self.activations, self.layers.len());
    }
}

/// The first `n_layers` layers; returns the rows there are, padded.
#[inline(always)]
fn forward(
    layers: &[Packed],
    input: &[f32],
    Activations(all): &mut Activations,
    n_layers: usize,
) -> usize {
    let n_rows = pad(&mut all[0], input, layers[0].n_inputs);
    for (index, layer) in layers.iter().enumerate().take(n_layers) {
        let (before, after) = all.split_at_mut(index + 1);
        let input = Rows::new(&before[index], layer.n_inputs);
        let (weights, biases) = (&layer.weights, &layer.biases);
        let out = &mut after[0];
        if index + 1 == layers.len() {
            multiply(input, weights, biases, out, n_rows, |_, sums| finite(sums));
        } else {
            multiply(input, weights, biases, out, n_rows, |_, sums| {
                positive(sums)
            });
        }
    }
    n_rows
}

/// One block's gradients, added to the sums; that of its input is left in [`Scratch::v`].
struct Backward<'a> {
    layers: &'a [Packed],
    input: &'a [f32],
    v_out: &'a [f32],
    scratch: &'a mut Scratch,
}

impl Kernel for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self {
            layers,
            input,
            v_out,
            scratch,
        } = self;
        let n_rows = forward(layers, input, &mut scratch.activations, layers.len() - 1);
        pad(&mut scratch.v, v_out, layers[layers.len() - 1].n_outputs);
        for (index, layer) in layers.iter().enumerate().rev() {
            let given = &scratch.activations.0[index];
            let panels = panels(layer.n_outputs);
            if let Some((weights, biases)) = scratch.sums.get_mut(index) {
                let v = &scratch.v[..n_rows * panels];
                add_outer(Rows::new(given, layer.n_inputs), v, weights, panels);
                for row in v.chunks_exact(panels) {
                    for (sum, v) in biases.iter_mut().zip(row) {
                        *sum = plus(*sum, *v);
                    }
                }
            }
            if index == 0 && !scratch.needs_input {
                break;
            }
            let v = Rows::new(&scratch.v, layer.n_outputs);
            let (weights, out) = (&layer.transposed, &mut scratch.v_before);
            if index == 0 {
                multiply(v, weights, &[], out, n_rows, |_, sums| finite(sums));
            } else {
                multiply(v, weights, &[], out, n_rows, |at, sums| {
                    finite_where_positive(sums, &given[at])
                });
            }
            std::mem::swap(&mut scratch.v, &mut scratch.v_before);
        }
    }
}

/// Rows in whole lanes.
#[derive(Clone, Copy)]
struct Rows<'a> {
    values: &'a [f32],
    stride: usize,
    width: usize,
}

impl<'a> Rows<'a> {
    #[inline(always)]
    fn new(values: &'a [Lanes], width: usize) -> Self {
        Self {
            values: values.as_flattened(),
            stride: panels(width) * LANES,
            width,
        }
    }

    #[inline(always)]
    fn four(self, first: usize) -> [&'a [f32]; ROWS] {
        std::array::from_fn(|row| &self.values[(first + row) * self.stride..][..self.width])
    }
}

/// Rows times weights, plus `start` where there is any; `finish(at, sum)` is what is written at `at`.
#[inline(always)]
fn multiply(
    rows: Rows,
    weights: &[Lanes],
    start: &[Lanes],
    out: &mut [Lanes],
    n_rows: usize,
    finish: impl Fn(usize, Lanes) -> Lanes,
) {
    let n_panels = weights.len() / rows.width;
    for first in (0..n_rows).step_by(ROWS) {
        let four = rows.four(first);
        for (panel, weights) in weights.chunks_exact(rows.width).enumerate() {
            let start = start.get(panel).copied().unwrap_or([0.0; LANES]);
            let sums = sum_products(four, weights, [start; ROWS]);
            for (row, sums) in sums.into_iter().enumerate() {
                let at = (first + row) * n_panels + panel;
                out[at] = finish(at, sums);
            }
        }
    }
}

/// `sums[row][l] + sum over k of rows[row][k] * weights[k][l]`.
#[inline(always)]
fn sum_products(rows: [&[f32]; ROWS], weights: &[Lanes], sums: [Lanes; ROWS]) -> [Lanes; ROWS] {
    let rows = rows.map(|row| &row[..weights.len()]);
    let mut sums = sums;
    for k in 0..weights.len() {
        for row in 0..ROWS {
            let value = rows[row][k];
            for l in 0..LANES {
                sums[row][l] += value * weights[k][l];
            }
        }
    }
    sums
}

/// Adds to `sums[k]` the sum over rows of `rows[row][k] * v[row]`.
#[inline(always)]
fn add_outer(rows: Rows, v: &[Lanes], sums: &mut [Lanes], n_panels: usize) {
    let n_rows = v.len() / n_panels;
    for first in (0..rows.width).step_by(ROWS) {
        for panel in 0..n_panels {
            let mut held: [Lanes; ROWS] =
                std::array::from_fn(|k| sums[(first + k) * n_panels + panel]);
            for row in 0..n_rows {
                let values = &rows.values[row * rows.stride + first..][..ROWS];
                let v = &v[row * n_panels + panel];
                for k in 0..ROWS {
                    let value = values[k];
                    for l in 0..LANES {
                        held[k][l] += value * v[l];
                    }
                }
            }
            for (k, held) in held.into_iter().enumerate() {
                sums[(first + k) * n_panels + panel] = held;
            }
        }
    }
}

#[inline(always)]
fn plus(a: Lanes, b: Lanes) -> Lanes {
    let mut out = a;
    for l in 0..LANES {
        out[l] += b[l];
    }
    out
}

#[inline(always)]
fn finite_or_zero(value: f32) -> f32 {
    if value.abs() < f32::INFINITY {
        value
    } else {
        0.0
    }
}

// Loops over lanes become vector instructions, `map` of an array does not.

#[inline(always)]
fn finite(values: Lanes) -> Lanes {
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        out[l] = finite_or_zero(values[l]);
    }
    out
}

/// Zero where they are negative, too.
#[inline(always)]
fn positive(values: Lanes) -> Lanes {
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        out[l] = finite_or_zero(values[l].max(0.0));
    }
    out
}

/// Zero where `what` is not positive, too.
#[inline(always)]
fn finite_where_positive(values: Lanes, what: &Lanes) -> Lanes {
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        let value = finite_or_zero(values[l]);
        out[l] = if what[l] > 0.0 { value } else { 0.0 };
    }
    out
}
