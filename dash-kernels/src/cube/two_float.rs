//! Numbers of about 48 bits, each the sum of two floats: shaders have no double precision.
//!
//! Drivers take `(a + b) - a` for `b` and fuse products into sums, which is right for real numbers and the end of
//! these. So every rounded result passes through bits, to which a zero is added that no compiler knows: `zero` is an
//! argument of the kernel, and always 0.
//!
//! # Source
//! Dekker 1971, Knuth 4.2.2; the names of Hida, Li and Bailey 2001.

use cubecl::prelude::*;

/// The first float's bits that a product takes first: 12 of the 24, so that products of them are exact.
const UPPER_BITS: u32 = 0xffff_f000;

/// The sum of two floats, the second no more than half a unit in the last place of the first.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct TwoFloat {
    pub hi: f32,
    pub lo: f32,
}

/// The value, as no compiler knows it.
#[cube]
fn opaque(value: f32, zero: u32) -> f32 {
    f32::reinterpret(u32::reinterpret(value) ^ zero)
}

#[cube]
fn upper(value: f32) -> f32 {
    f32::reinterpret(u32::reinterpret(value) & UPPER_BITS)
}

/// The sum of two floats of which the first is larger.
#[cube]
fn quick_two_sum(a: f32, b: f32, zero: u32) -> TwoFloat {
    let hi = opaque(a + b, zero);
    let lo = b - opaque(hi - a, zero);
    TwoFloat { hi, lo }
}

#[cube]
impl TwoFloat {
    pub fn new(hi: f32, lo: f32) -> TwoFloat {
        TwoFloat { hi, lo }
    }

    /// The exact sum of two floats.
    pub fn two_sum(a: f32, b: f32, zero: u32) -> TwoFloat {
        let hi = opaque(a + b, zero);
        let from_b = opaque(hi - a, zero);
        let from_a = opaque(hi - from_b, zero);
        let lo = (a - from_a) + (b - from_b);
        TwoFloat { hi, lo }
    }

    /// The exact product of two floats.
    pub fn two_product(a: f32, b: f32, zero: u32) -> TwoFloat {
        let hi = opaque(a * b, zero);
        let (a_upper, b_upper) = (upper(a), upper(b));
        let (a_lower, b_lower) = (a - a_upper, b - b_upper);
        let rest = opaque(a_upper * b_upper - hi, zero);
        let rest = opaque(rest + a_upper * b_lower, zero);
        let rest = opaque(rest + a_lower * b_upper, zero);
        let lo = rest + a_lower * b_lower;
        TwoFloat { hi, lo }
    }

    pub fn plus(&self, other: &TwoFloat, zero: u32) -> TwoFloat {
        let sum = TwoFloat::two_sum(self.hi, other.hi, zero);
        quick_two_sum(sum.hi, sum.lo + (self.lo + other.lo), zero)
    }

    pub fn minus(&self, other: &TwoFloat, zero: u32) -> TwoFloat {
        let negative = TwoFloat {
            hi: -other.hi,
            lo: -other.lo,
        };
        self.plus(&negative, zero)
    }

    pub fn times(&self, other: &TwoFloat, zero: u32) -> TwoFloat {
        let product = TwoFloat::two_product(self.hi, other.hi, zero);
        let mixed = self.hi * other.lo + self.lo * other.hi;
        quick_two_sum(product.hi, product.lo + mixed, zero)
    }

    pub fn times_float(&self, factor: f32, zero: u32) -> TwoFloat {
        let product = TwoFloat::two_product(self.hi, factor, zero);
        quick_two_sum(product.hi, product.lo + self.lo * factor, zero)
    }

    pub fn over(&self, divisor: &TwoFloat, zero: u32) -> TwoFloat {
        let first = opaque(self.hi / divisor.hi, zero);
        let rest = self.minus(&divisor.times_float(first, zero), zero);
        quick_two_sum(first, rest.hi / divisor.hi, zero)
    }
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::super::tests::{cube_tensor, cube_values};
    use super::super::{arg, uninitialised, units};
    use super::*;
    use crate::testing::{rng, uniform};

    /// `a b + c`, `a - b` and `a / b` of sums of a number and a small one.
    #[cube(launch)]
    fn operations(
        inputs: &[f32],      // [N, 6]
        results: &mut [f32], // [N, 6]
        n: u32,
        zero: u32,
    ) {
        let i = ABSOLUTE_POS;
        if i >= n as usize {
            terminate!();
        }
        let a = TwoFloat::new(inputs[6 * i], inputs[6 * i + 1]);
        let b = TwoFloat::new(inputs[6 * i + 2], inputs[6 * i + 3]);
        let c = TwoFloat::new(inputs[6 * i + 4], inputs[6 * i + 5]);
        let product = a.times(&b, zero).plus(&c, zero);
        let difference = a.minus(&b, zero);
        let ratio = a.over(&b, zero);
        results[6 * i] = product.hi;
        results[6 * i + 1] = product.lo;
        results[6 * i + 2] = difference.hi;
        results[6 * i + 3] = difference.lo;
        results[6 * i + 4] = ratio.hi;
        results[6 * i + 5] = ratio.lo;
    }

    #[test]
    fn operations_are_good_to_44_bits() {
        const N: usize = 500;
        let mut rng = rng(1);
        let mut inputs = uniform(&mut rng, 6 * N, -2.0, 2.0);
        for pair in inputs.chunks_exact_mut(2) {
            pair[0] += 3.0f32.copysign(pair[0]);
            pair[1] = pair[0] * rng.random_range(-0.5..0.5) * f32::EPSILON;
        }
        let device = cube_tensor(&inputs, [N, 6]);
        let results = uninitialised(&device, [N, 6]);
        let (count, dim) = units(&device.client, N);
        let client = device.client.clone();
        operations::launch(
            &client,
            count,
            dim,
            arg(&device),
            arg(&results),
            N as u32,
            0,
        );
        let sum = |pair: &[f32]| f64::from(pair[0]) + f64::from(pair[1]);
        let got = cube_values(&results);
        for (input, got) in inputs.chunks_exact(6).zip(got.chunks_exact(6)) {
            let [a, b, c] = [sum(&input[..2]), sum(&input[2..4]), sum(&input[4..])];
            let size = a.abs() * b.abs() + c.abs();
            for (k, expected) in [a * b + c, a - b, a / b].into_iter().enumerate() {
                let off = (sum(&got[2 * k..2 * k + 2]) - expected).abs();
                assert!(
                    off <= size * 2f64.powi(-44),
                    "{input:?}: {k} is off by {off:e}"
                );
            }
        }
    }
}
