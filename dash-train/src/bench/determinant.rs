//! Two forms of the determinant of a splat's covariance, as plain functions on the host.
//!
//! With `M` the 2x3 matrix whose product `M M^T` is the covariance before the low-pass filter,
//! the textbook form is `a c - b^2` of the filtered covariance; the kernels' is
//! `|m0 x m1|^2 + low_pass tr(M M^T) + low_pass^2`, in which nothing cancels.

use dash_kernels::splats::LOW_PASS_PX2;
use num_traits::Float;
use rand::Rng;
use rand_pcg::Pcg64;

use super::host::{self, Form};
use super::{Bench, ErrorStats, Errors, generator};
use crate::numbers::standard_normal;

const OP: &str = "determinant";
/// Names of the two forms.
const FORMS: [&str; 2] = ["cross product", "a c − b²"];

type Rows<T> = [[T; 3]; 2];

fn dot<T: Float>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The form in which nothing cancels.
fn by_cross_product<T: Float>(m: Rows<T>, low_pass: T) -> T {
    let [u, v] = m;
    let cross = [
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    ];
    dot(cross, cross) + low_pass * (dot(u, u) + dot(v, v)) + low_pass * low_pass
}

/// The textbook's form.
fn by_difference<T: Float>(m: Rows<T>, low_pass: T) -> T {
    let [u, v] = m;
    let (a, b, c) = (dot(u, u) + low_pass, dot(u, v), dot(v, v) + low_pass);
    a * c - b * b
}

fn forms() -> [fn(Rows<f32>, f32) -> f32; 2] {
    [by_cross_product, by_difference]
}

/// Covariances with one axis of about `length_px` and two of `across_px`.
fn needles(rng: &mut Pcg64, n: usize, length_px: f32, across_px: f32) -> Vec<Rows<f32>> {
    (0..n)
        .map(|_| {
            let angle = rng.random_range(0.0..std::f32::consts::TAU);
            let (sin, cos) = angle.sin_cos();
            let length = length_px * rng.random_range(0.7f32..1.0);
            let mut m = [[length * cos, 0.0, 0.0], [length * sin, 0.0, 0.0]];
            for row in &mut m {
                row[1] = across_px * standard_normal::<f32>(rng);
                row[2] = across_px * standard_normal::<f32>(rng);
            }
            m
        })
        .collect()
}

fn errors(needles: &[Rows<f32>], form: fn(Rows<f32>, f32) -> f32) -> ErrorStats {
    let low_pass = LOW_PASS_PX2 as f32;
    let got: Vec<f32> = needles.iter().map(|&m| form(m, low_pass)).collect();
    let expected: Vec<f64> = needles
        .iter()
        .map(|m| by_cross_product(m.map(|row| row.map(f64::from)), f64::from(low_pass)))
        .collect();
    Errors::of(&got, &expected)
}

/// Splats of a few pixels.
pub(super) fn measure(bench: &mut Bench, n: usize) {
    let needles = needles(&mut generator(5), n, 8.0, 1.0);
    for (variant, form) in FORMS.into_iter().zip(forms()) {
        let error = errors(&needles, form);
        let compute = |&m: &Rows<f32>| form(m, LOW_PASS_PX2 as f32);
        host::measure(bench, &Form { op: OP, variant }, &needles, compute, error);
    }
}

/// Both forms for needles of one length, of axis ratio 1e8.
pub(super) fn stiff(bench: &mut Bench, sweep: &str, length_px: f64, n: usize) {
    let across = (length_px * 1e-8) as f32;
    let needles = needles(&mut generator(6), n, length_px as f32, across);
    for (variant, form) in FORMS.into_iter().zip(forms()) {
        let error = errors(&needles, form);
        host::stiff(bench, &Form { op: OP, variant }, sweep, length_px, error);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_forms_are_the_determinant() {
        let m = [[1.0, 2.0, 3.0], [-1.0, 0.5, 2.0]];
        // Covariance [[14.3, 6], [6, 5.55]].
        let expected = 14.3 * 5.55 - 36.0;
        for form in [by_cross_product::<f64>, by_difference::<f64>] {
            assert!((form(m, 0.3) - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn only_the_cross_product_survives_long_needles() {
        let needles = needles(&mut generator(0), 2000, 10_000.0, 1e-4);
        let worst = |form| errors(&needles, form).relative.max.unwrap_or(f64::INFINITY);
        let [cross, difference] = forms().map(worst);
        assert!(cross < 1e-5, "{cross}");
        assert!(difference > 0.1, "{difference}");
    }
}
