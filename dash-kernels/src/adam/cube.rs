//! Adam on CubeCL devices.
//!
//! A unit owns one element and writes it in place or to new memory. No shared memory, no atomics;
//! deterministic.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{arg, contiguous, is_finite, own_memory, units};

use super::{AdamStep, AdamUpdate, MAX_GRADIENT};

impl AdamUpdate for CubeBackend {
    fn adam_step(
        param: CubeTensor,
        grad: CubeTensor,
        first_moment: CubeTensor,
        second_moment: CubeTensor,
        settings: AdamStep,
    ) -> (CubeTensor, CubeTensor, CubeTensor) {
        let grad = contiguous(grad);
        let [param, first_moment, second_moment] =
            [param, first_moment, second_moment].map(own_memory);
        let n = param.meta.num_elements();
        let client = param.client.clone();
        let (count, dim) = units(&client, n);
        adam_kernel::launch(
            &client,
            count,
            dim,
            arg(&param),
            arg(&grad),
            arg(&first_moment),
            arg(&second_moment),
            constants(&settings),
            n as u32,
            settings.skip_zero_grad,
        );
        (param, first_moment, second_moment)
    }
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
    constants: Constants,
    n: u32,
    #[comptime] skip_zero_grad: bool,
) {
    let i = ABSOLUTE_POS;
    if i >= n as usize {
        terminate!();
    }
    let g = grad[i];
    let mut stepped = is_finite(g);
    if comptime!(skip_zero_grad) {
        stepped = stepped && g != 0.0f32;
    }
    if stepped {
        let g = f32::clamp(g, -MAX_GRADIENT, MAX_GRADIENT);
        let (old_m, old_v) = (first_moment[i], second_moment[i]);
        let sound = is_finite(old_m) && is_finite(old_v) && old_v >= 0.0f32;
        let m = constants.beta1 * select(sound, old_m, 0.0f32) + constants.one_minus_beta1 * g;
        let v = constants.beta2 * select(sound, old_v, 0.0f32) + constants.one_minus_beta2 * g * g;
        let denominator = (v * constants.inverse_correction2).sqrt() + constants.epsilon;
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
