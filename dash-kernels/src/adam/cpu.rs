//! Adam on the CPU: elements are independent, so any number of threads gives the same bits.

use rayon::prelude::*;

use super::{AdamStep, MAX_GRADIENT};
use crate::isa::{Kernel, dispatch};

/// Elements per parallel piece: four arrays of it stay within a level-2 cache.
const PIECE: usize = 1 << 15;
/// Elements whose gradients are looked at together before anything else is read.
const GROUP: usize = 16;

/// One step on every element, in place.
pub(super) fn adam_step(
    param: &mut [f32],
    grad: &[f32],
    first_moment: &mut [f32],
    second_moment: &mut [f32],
    settings: &AdamStep,
) {
    let constants = Constants::new(settings);
    param
        .par_chunks_mut(PIECE)
        .zip(grad.par_chunks(PIECE))
        .zip(first_moment.par_chunks_mut(PIECE))
        .zip(second_moment.par_chunks_mut(PIECE))
        .for_each(|(((param, grad), first_moment), second_moment)| {
            dispatch(Piece {
                param,
                grad,
                first_moment,
                second_moment,
                constants,
            });
        });
}

/// The root mean square of what is positive, over a correction of its bias; in one order.
pub(super) fn typical_gradient(squares: &[f32], correction: f64) -> f32 {
    let positive = || squares.iter().filter(|square| **square > 0.0);
    let sum: f64 = positive().map(|&square| f64::from(square)).sum();
    (sum / positive().count().max(1) as f64 / correction).sqrt() as f32
}

#[derive(Clone, Copy)]
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
    skip_zero_grad: bool,
}

impl Constants {
    fn new(settings: &AdamStep) -> Self {
        let correction = |beta: f64| 1.0 - beta.powf(settings.step as f64);
        Self {
            beta1: settings.beta1 as f32,
            one_minus_beta1: (1.0 - settings.beta1) as f32,
            beta2: settings.beta2 as f32,
            one_minus_beta2: (1.0 - settings.beta2) as f32,
            rate: (settings.learning_rate / correction(settings.beta1)) as f32,
            inverse_correction2: (1.0 / correction(settings.beta2)) as f32,
            epsilon: settings.epsilon as f32,
            skip_zero_grad: settings.skip_zero_grad,
        }
    }
}

struct Piece<'a> {
    param: &'a mut [f32],
    grad: &'a [f32],
    first_moment: &'a mut [f32],
    second_moment: &'a mut [f32],
    constants: Constants,
}

impl Kernel for Piece<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let (param, param_rest) = self.param.as_chunks_mut::<GROUP>();
        let (grad, grad_rest) = self.grad.as_chunks::<GROUP>();
        let (first, first_rest) = self.first_moment.as_chunks_mut::<GROUP>();
        let (second, second_rest) = self.second_moment.as_chunks_mut::<GROUP>();
        let groups = param.iter_mut().zip(grad).zip(first).zip(second);
        for (((param, grad), first), second) in groups {
            if self.constants.skip_zero_grad && grad.iter().all(|&g| g == 0.0) {
                continue;
            }
            for i in 0..GROUP {
                (param[i], first[i], second[i]) =
                    element(param[i], grad[i], first[i], second[i], &self.constants);
            }
        }
        for (i, &g) in grad_rest.iter().enumerate() {
            (param_rest[i], first_rest[i], second_rest[i]) = element(
                param_rest[i],
                g,
                first_rest[i],
                second_rest[i],
                &self.constants,
            );
        }
    }
}

/// The moments, or zeros where the optimiser can't have made them.
#[inline(always)]
fn sound_moments(first: f32, second: f32) -> (f32, f32) {
    if first.is_finite() & second.is_finite() & (second >= 0.0) {
        (first, second)
    } else {
        (0.0, 0.0)
    }
}

/// Branch-free, so that a group becomes vector instructions.
#[inline(always)]
fn element(
    param: f32,
    grad: f32,
    first: f32,
    second: f32,
    constants: &Constants,
) -> (f32, f32, f32) {
    let g = grad.clamp(-MAX_GRADIENT, MAX_GRADIENT);
    let (old_m, old_v) = sound_moments(first, second);
    let m = constants.beta1 * old_m + constants.one_minus_beta1 * g;
    let v = constants.beta2 * old_v + constants.one_minus_beta2 * g * g;
    let root = (v * constants.inverse_correction2).sqrt() + constants.epsilon;
    // A zero first moment asks for no step even where the root is zero too.
    let step = if m == 0.0 {
        0.0
    } else {
        constants.rate * m / root
    };
    let new = param - step;
    let keep = !grad.is_finite()
        | !new.is_finite()
        | !v.is_finite()
        | (constants.skip_zero_grad & (grad == 0.0));
    if keep {
        (param, first, second)
    } else {
        (new, m, v)
    }
}
