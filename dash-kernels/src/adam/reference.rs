//! Adam as plainly as it can be written: what the fast kernel is judged against.

use num_traits::Float;

use super::{AdamStep, MAX_GRADIENT};

/// One step on every element, in place. See [`adam_step`](super::adam_step).
pub fn adam_step<T: Float>(
    param: &mut [T],
    grad: &[T],
    first_moment: &mut [T],
    second_moment: &mut [T],
    settings: &AdamStep,
) {
    let constant = |x: f64| T::from(x).expect("a float type holds any f64, rounded");
    let power = |beta: f64| beta.powf(settings.step as f64);
    let (beta1, beta2) = (constant(settings.beta1), constant(settings.beta2));
    let max = constant(f64::from(MAX_GRADIENT));
    for i in 0..param.len() {
        let g = grad[i];
        if !g.is_finite() || settings.skip_zero_grad && g == T::zero() {
            continue;
        }
        let g = g.max(-max).min(max);
        let (m, v) = (first_moment[i], second_moment[i]);
        let (m, v) = if m.is_finite() && v.is_finite() && v >= T::zero() {
            (m, v)
        } else {
            (T::zero(), T::zero())
        };
        let m = beta1 * m + (T::one() - beta1) * g;
        let v = beta2 * v + (T::one() - beta2) * g * g;
        let m_unbiased = m / constant(1.0 - power(settings.beta1));
        let v_unbiased = v / constant(1.0 - power(settings.beta2));
        let step = constant(settings.learning_rate) * m_unbiased
            / (v_unbiased.sqrt() + constant(settings.epsilon));
        // Zero moments and epsilon 0 ask for no step.
        let new = if m == T::zero() {
            param[i]
        } else {
            param[i] - step
        };
        if new.is_finite() && v.is_finite() {
            (param[i], first_moment[i], second_moment[i]) = (new, m, v);
        }
    }
}

/// The root mean square of what is positive, over a correction. See [`typical_gradient`](super::typical_gradient).
pub fn typical_gradient<T: Float>(squares: &[T], correction: T) -> T {
    let (mut sum, mut n) = (T::zero(), T::zero());
    for &square in squares.iter().filter(|&&square| square > T::zero()) {
        sum = sum + square;
        n = n + T::one();
    }
    match n > T::zero() {
        true => (sum / n / correction).sqrt(),
        false => T::zero(),
    }
}
