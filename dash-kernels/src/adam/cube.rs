//! Adam on CubeCL devices.
//!
//! A unit owns one element and writes it in place or to new memory. No shared memory, no atomics;
//! deterministic.

use burn::backend::ops::FloatTensorOps;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{arg, contiguous, is_finite, own_memory, uninitialised, units};

use super::{AdamStep, AdamUpdate, MAX_GRADIENT};

impl AdamUpdate for CubeBackend {
    fn adam_step(
        param: CubeTensor,
        grad: CubeTensor,
        first_moment: CubeTensor,
        second_moment: CubeTensor,
        settings: AdamStep,
    ) -> (CubeTensor, CubeTensor, CubeTensor) {
        launch([param, first_moment, second_moment], grad, None, &settings)
    }

    fn adam_step_unless(
        param: CubeTensor,
        grad: CubeTensor,
        first_moment: CubeTensor,
        second_moment: CubeTensor,
        flags: CubeTensor,
        damping: CubeTensor,
        settings: AdamStep,
        stop: usize,
    ) -> (CubeTensor, CubeTensor, CubeTensor) {
        let [flags, damping] = [flags, damping].map(contiguous);
        let conditions = Some((flags, damping, stop));
        launch(
            [param, first_moment, second_moment],
            grad,
            conditions,
            &settings,
        )
    }

    fn typical_gradient(squares: CubeTensor, correction: f64) -> CubeTensor {
        let squares = contiguous(squares);
        let n = squares.meta.num_elements();
        let (count, dim) = units(&squares.client, n);
        let counted = uninitialised(&squares, [n, 2]);
        count_kernel::launch(
            &squares.client,
            count,
            dim,
            arg(&squares),
            arg(&counted),
            n as u32,
        );
        let sums = contiguous(CubeBackend::float_sum_dim(counted, 0));
        let found = uninitialised(&squares, [1]);
        let (count, dim) = units(&squares.client, 1);
        let correction = correction as f32;
        root_kernel::launch(
            &squares.client,
            count,
            dim,
            arg(&sums),
            arg(&found),
            correction,
        );
        found
    }
}

/// What is positive, and 1 beside it.
#[cube(launch)]
fn count_kernel(
    squares: &[f32],     // [n]
    counted: &mut [f32], // [n, 2]
    n: u32,
) {
    if ABSOLUTE_POS >= n as usize {
        terminate!();
    }
    let square = squares[ABSOLUTE_POS];
    let counts = square > 0.0f32;
    counted[2 * ABSOLUTE_POS] = select(counts, square, 0.0f32);
    counted[2 * ABSOLUTE_POS + 1] = select(counts, 1.0f32, 0.0f32);
}

#[cube(launch)]
fn root_kernel(
    sums: &[f32],      // [2]
    found: &mut [f32], // [1]
    correction: f32,
) {
    if ABSOLUTE_POS == 0 {
        found[0] = (sums[0] / f32::max(sums[1], 1.0f32) / correction).sqrt();
    }
}

/// Steps the parameter and its moments, under conditions where there are any: flags, a damping, and the flag that stops
/// the step.
fn launch(
    state: [CubeTensor; 3],
    grad: CubeTensor,
    conditions: Option<(CubeTensor, CubeTensor, usize)>,
    settings: &AdamStep,
) -> (CubeTensor, CubeTensor, CubeTensor) {
    let grad = contiguous(grad);
    let [param, first_moment, second_moment] = state.map(own_memory);
    let n = param.meta.num_elements();
    let client = param.client.clone();
    let (count, dim) = units(&client, n);
    let is_conditional = conditions.is_some();
    // Without conditions the kernel does not look at what is bound in their place.
    let (flags, damping, stop) = conditions.unwrap_or_else(|| (grad.clone(), grad.clone(), 0));
    adam_kernel::launch(
        &client,
        count,
        dim,
        arg(&param),
        arg(&grad),
        arg(&first_moment),
        arg(&second_moment),
        arg(&flags),
        arg(&damping),
        constants(settings),
        n as u32,
        stop as u32,
        settings.skip_zero_grad,
        is_conditional,
    );
    (param, first_moment, second_moment)
}

#[derive(CubeType, CubeLaunch, Clone, Copy)]
struct Constants {
    beta1: f32,
    one_minus_beta1: f32,
    beta2: f32,
    one_minus_beta2: f32,
    /// Learning rate over the first moment's bias correction.
    rate: f32,
    /// One over the second moment's bias correction.
    inverse_correction2: f32,
    epsilon: f32,
}

fn constants(settings: &AdamStep) -> ConstantsLaunch {
    let correction = |beta: f64| 1.0 - beta.powf(settings.step as f64);
    ConstantsLaunch::new(
        settings.beta1 as f32,
        (1.0 - settings.beta1) as f32,
        settings.beta2 as f32,
        (1.0 - settings.beta2) as f32,
        (settings.learning_rate / correction(settings.beta1)) as f32,
        (1.0 / correction(settings.beta2)) as f32,
        settings.epsilon as f32,
    )
}

#[cube(launch)]
fn adam_kernel(
    param: &mut [f32],         // [n]
    grad: &[f32],              // [n]
    first_moment: &mut [f32],  // [n]
    second_moment: &mut [f32], // [n]
    flags: &[f32],             // [F]
    damping: &[f32],           // [1]
    constants: Constants,
    n: u32,
    stop: u32,
    #[comptime] skip_zero_grad: bool,
    #[comptime] is_conditional: bool,
) {
    let i = ABSOLUTE_POS;
    if i >= n as usize {
        terminate!();
    }
    let g = grad[i];
    let mut stepped = is_finite(g);
    let mut epsilon = constants.epsilon;
    if comptime!(is_conditional) {
        stepped = stepped && flags[stop as usize] == 0.0f32;
        let damping = damping[0];
        let sound = is_finite(damping) && damping > 0.0f32;
        epsilon += select(sound, damping, 0.0f32);
    }
    if comptime!(skip_zero_grad) {
        stepped = stepped && g != 0.0f32;
    }
    if stepped {
        let g = f32::clamp(g, -MAX_GRADIENT, MAX_GRADIENT);
        let (old_m, old_v) = (first_moment[i], second_moment[i]);
        let sound = is_finite(old_m) && is_finite(old_v) && old_v >= 0.0f32;
        let m = constants.beta1 * select(sound, old_m, 0.0f32) + constants.one_minus_beta1 * g;
        let v = constants.beta2 * select(sound, old_v, 0.0f32) + constants.one_minus_beta2 * g * g;
        let denominator = (v * constants.inverse_correction2).sqrt() + epsilon;
        // Zero moments and epsilon 0 ask for no step.
        let step = select(m == 0.0f32, 0.0f32, constants.rate * m / denominator);
        let new = param[i] - step;
        if is_finite(new) && is_finite(v) {
            param[i] = new;
            first_moment[i] = m;
            second_moment[i] = v;
        }
    }
}
