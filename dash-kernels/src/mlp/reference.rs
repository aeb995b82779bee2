//! Fully connected networks in f64, row by row.

use super::MlpLayout;

/// The inputs of all layers and the output, for one row.
fn activations(row: &[f64], parameters: &[f64], layout: &MlpLayout) -> Vec<Vec<f64>> {
    let mut all = vec![row.to_vec()];
    for (index, layer) in layout.layers().iter().enumerate() {
        let weights = &parameters[layer.first..];
        let biases = &parameters[layer.first_bias()..];
        let input = &all[index];
        let output = (0..layer.n_outputs).map(|j| {
            let products = input.iter().enumerate();
            let sum: f64 = products
                .map(|(k, x)| x * weights[k * layer.n_outputs + j])
                .sum();
            let value = sum + biases[j];
            let is_last = index + 1 == layout.layers().len();
            if is_last { value } else { value.max(0.0) }
        });
        all.push(output.collect());
    }
    all
}

/// `input [N, n_inputs], parameters [P] -> [N, n_outputs]`.
pub fn mlp(input: &[f64], parameters: &[f64], layout: &MlpLayout) -> Vec<f64> {
    let rows = input.chunks_exact(layout.n_inputs());
    rows.flat_map(|row| activations(row, parameters, layout).pop())
        .flatten()
        .collect()
}

/// `input, parameters, v_out [N, n_outputs] -> (v_input, v_parameters)`.
pub fn mlp_vjp(
    input: &[f64],
    parameters: &[f64],
    v_out: &[f64],
    layout: &MlpLayout,
) -> (Vec<f64>, Vec<f64>) {
    let mut v_input = Vec::with_capacity(input.len());
    let mut v_parameters = vec![0.0; parameters.len()];
    let rows = input.chunks_exact(layout.n_inputs());
    for (row, v_row) in rows.zip(v_out.chunks_exact(layout.n_outputs())) {
        let all = activations(row, parameters, layout);
        let mut v = v_row.to_vec();
        for (index, layer) in layout.layers().iter().enumerate().rev() {
            let n_outputs = layer.n_outputs;
            let mut v_before = vec![0.0; layer.n_inputs];
            for (k, x) in all[index].iter().enumerate() {
                for (j, v) in v.iter().enumerate() {
                    v_parameters[layer.first + k * n_outputs + j] += x * v;
                    v_before[k] += parameters[layer.first + k * n_outputs + j] * v;
                }
                if index > 0 && *x <= 0.0 {
                    v_before[k] = 0.0;
                }
            }
            for (j, v) in v.iter().enumerate() {
                v_parameters[layer.first_bias() + j] += v;
            }
            v = v_before;
        }
        v_input.extend(v);
    }
    (v_input, v_parameters)
}
