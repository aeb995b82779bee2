//! Adam on CubeCL devices.
//!
//! A launch steps up to [`AT_ONCE`] parameters. A unit owns an element of each and writes it in place. No shared memory, no
//! atomics; deterministic.

use burn::backend::ops::FloatTensorOps;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{arg, at_once, contiguous, is_finite, own_memory, uninitialised, units};
use crate::tensor_list::TensorList;

use super::{AdamStep, AdamUpdate, MAX_GRADIENT, OneOf, Steps, sorted};

/// Most parameters of a launch.
const AT_ONCE: usize = 8;

impl AdamUpdate for CubeBackend {
    fn adam_steps(TensorList(tensors): TensorList<Self>, steps: Steps) -> Vec<CubeTensor> {
        let (flags, each) = sorted(tensors, &steps);
        let flags = flags.map(contiguous);
        let mut parameters: Vec<Prepared> = each
            .into_iter()
            .zip(&steps.each)
            .map(|(one, (settings, _))| Prepared::of(one, settings))
            .collect();
        let client = parameters[0].state[0].client.clone();
        let is_conditional = flags.is_some();
        let n = at_once(&client, 5, 1, AT_ONCE);
        for group in parameters.chunks_mut(n) {
            let longest = group.iter().map(Prepared::len).fold(0, usize::max);
            let (count, dim) = units(&client, longest);
            // Where there are no flags the kernel does not look at what is bound in their place.
            let flags = flags.as_ref().unwrap_or(&group[0].grad);
            adam_kernel::launch(
                &client,
                count,
                dim,
                group.iter().map(Prepared::launched).collect(),
                arg(flags),
                steps.stop.unwrap_or(0) as u32,
                is_conditional,
            );
        }
        parameters.into_iter().flat_map(|one| one.state).collect()
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

/// A parameter whose memory may be written to.
struct Prepared {
    state: [CubeTensor; 3],
    grad: CubeTensor,
    damping: Option<CubeTensor>,
    settings: AdamStep,
}

impl Prepared {
    fn of(one: OneOf<CubeTensor>, settings: &AdamStep) -> Self {
        Self {
            state: one.state.map(own_memory),
            grad: contiguous(one.grad),
            damping: one.damping.map(contiguous),
            settings: *settings,
        }
    }

    fn len(&self) -> usize {
        self.grad.meta.num_elements()
    }

    fn launched(&self) -> SteppedLaunch {
        let [param, first, second] = self.state.each_ref().map(arg);
        // Without a damping the kernel does not look at what is bound in its place.
        let damping = self.damping.as_ref().unwrap_or(&self.grad);
        SteppedLaunch::new(
            param,
            arg(&self.grad),
            first,
            second,
            arg(damping),
            constants(&self.settings),
            self.len() as u32,
            u32::from(self.damping.is_some()),
            u32::from(self.settings.skip_zero_grad),
        )
    }
}

/// A parameter, and how it is stepped.
#[derive(CubeType, CubeLaunch)]
struct Stepped {
    param: Box<[f32]>,         // [n]
    grad: Box<[f32]>,          // [n]
    first_moment: Box<[f32]>,  // [n]
    second_moment: Box<[f32]>, // [n]
    damping: Box<[f32]>,       // [1]
    constants: Constants,
    n: u32,
    is_damped: u32,
    skips_zeros: u32,
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
    mut parameters: Sequence<Stepped>,
    flags: &[f32], // [F]
    stop: u32,
    #[comptime] is_conditional: bool,
) {
    if comptime!(is_conditional) && flags[stop as usize] != 0.0f32 {
        terminate!();
    }
    #[unroll]
    for k in 0..parameters.len() {
        step_element(parameters.index_mut(k), ABSOLUTE_POS);
    }
}

#[cube]
fn step_element(parameter: &mut Stepped, i: usize) {
    if i < parameter.n as usize {
        let g = parameter.grad[i];
        let skipped = parameter.skips_zeros > 0u32 && g == 0.0f32;
        let mut epsilon = parameter.constants.epsilon;
        if parameter.is_damped > 0u32 {
            let damping = parameter.damping[0usize];
            let sound = is_finite(damping) && damping > 0.0f32;
            epsilon += select(sound, damping, 0.0f32);
        }
        if is_finite(g) && !skipped {
            let g = f32::clamp(g, -MAX_GRADIENT, MAX_GRADIENT);
            let (old_m, old_v) = (parameter.first_moment[i], parameter.second_moment[i]);
            let sound = is_finite(old_m) && is_finite(old_v) && old_v >= 0.0f32;
            let m = parameter.constants.beta1 * select(sound, old_m, 0.0f32)
                + parameter.constants.one_minus_beta1 * g;
            let v = parameter.constants.beta2 * select(sound, old_v, 0.0f32)
                + parameter.constants.one_minus_beta2 * g * g;
            let denominator = (v * parameter.constants.inverse_correction2).sqrt() + epsilon;
            // Zero moments and epsilon 0 ask for no step.
            let step = select(
                m == 0.0f32,
                0.0f32,
                parameter.constants.rate * m / denominator,
            );
            let new = parameter.param[i] - step;
            if is_finite(new) && is_finite(v) {
                parameter.param[i] = new;
                parameter.first_moment[i] = m;
                parameter.second_moment[i] = v;
            }
        }
    }
}
