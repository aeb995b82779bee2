//! Three forms of a needle's exponent, as plain functions on the host.
//!
//! - plain: `a dx^2 / 2 + b dx dy + c dy^2 / 2` from the centre, whose terms cancel far from it;
//! - per tile: the squares of the distances across and along, from the axis' point next to the tile's middle. The
//!   kernels draw needles so;
//! - two floats: the plain form with every number and every operation in two floats.
//!
//! What is judged is `exp(-exponent)`, the splat's alpha for an opacity of 1.

use dash_kernels::splats::LOW_PASS_PX2;
use rand::Rng;
use rand_pcg::Pcg64;

use super::{Bench, ErrorStats, Errors, generator, host};

const OP: &str = "needle";
/// Alpha at a pixel.
type Form = fn(&Pixel) -> f32;
const FORMS: [(&str, Form); 3] = [
    ("plain", plain),
    ("per tile", per_tile),
    ("two floats", two_floats),
];
/// The picture, pixels.
const SIZE: [f64; 2] = [1352.0, 1014.0];
/// The kernels' tiles.
const TILE_PX: f32 = 16.0;
/// Needles of a few hundred pixels for the times.
const LENGTH_PX: f64 = 300.0;

/// A number of about 48 bits.
#[derive(Clone, Copy)]
struct Two(f32, f32);

impl Two {
    fn of(value: f64) -> Self {
        let hi = value as f32;
        Self(hi, (value - f64::from(hi)) as f32)
    }

    fn plus(self, other: Self) -> Self {
        let sum = self.0 + other.0;
        let from_other = sum - self.0;
        let rest = (self.0 - (sum - from_other)) + (other.0 - from_other);
        Self::of_sum(sum, rest + self.1 + other.1)
    }

    fn times(self, other: Self) -> Self {
        let product = self.0 * other.0;
        let rest = self.0.mul_add(other.0, -product);
        Self::of_sum(product, rest + self.0 * other.1 + self.1 * other.0)
    }

    fn of_sum(large: f32, small: f32) -> Self {
        let sum = large + small;
        Self(sum, small - (sum - large))
    }
}

/// A needle at a pixel, in the numbers of each form.
struct Pixel {
    place: [f32; 2],
    middle: [f32; 2],
    mean: [Two; 2],
    conic: [Two; 3],
    normal: [f32; 2],
    offset: f32,
    /// Inverse variances across and along.
    precisions: [f32; 2],
    expected: f64,
}

impl Pixel {
    /// Near a needle of about `length_px`, whose centre is up to twice as far away.
    fn random(rng: &mut Pcg64, length_px: f64) -> Self {
        let length = length_px * rng.random_range(0.7..1.0);
        let (ny, nx) = rng.random_range(0.0..std::f64::consts::TAU).sin_cos();
        let away = length * rng.random_range(-2.0..2.0);
        let foot = SIZE.map(|side| rng.random_range(0.0..side));
        let place = foot.map(|x: f64| (x + rng.random_range(-1.5..1.5)).floor() + 0.5);
        let [across, along] = [1.0 / LOW_PASS_PX2, 1.0 / (length * length + LOW_PASS_PX2)];
        let [dx, dy] = [0, 1].map(|k| foot[k] - place[k]);
        let (w, z) = (nx * dx + ny * dy, nx * dy - ny * dx + away);
        let conic = [
            across * nx * nx + along * ny * ny,
            (across - along) * nx * ny,
            across * ny * ny + along * nx * nx,
        ];
        Self {
            place: place.map(|x| x as f32),
            middle: place.map(|x| TILE_PX * (x as f32 / TILE_PX).floor() + 0.5 * TILE_PX),
            mean: [foot[0] - away * ny, foot[1] + away * nx].map(Two::of),
            conic: conic.map(Two::of),
            normal: [nx, ny].map(|x| x as f32),
            offset: (nx * foot[0] + ny * foot[1]) as f32,
            precisions: [across, along].map(|x| x as f32),
            expected: (-0.5 * (across * w * w + along * z * z)).exp(),
        }
    }
}

fn plain(pixel: &Pixel) -> f32 {
    let [dx, dy] = [0, 1].map(|k| pixel.mean[k].0 - pixel.place[k]);
    let [a, b, c] = pixel.conic.map(|entry| entry.0);
    let exponent = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy;
    // As renderers take it for an error.
    if exponent < 0.0 {
        0.0
    } else {
        (-exponent).exp()
    }
}

fn per_tile(pixel: &Pixel) -> f32 {
    let ([nx, ny], [mid_x, mid_y]) = (pixel.normal, pixel.middle);
    let distance = pixel.offset - (nx * mid_x + ny * mid_y);
    let far = nx * (pixel.mean[1].0 - mid_y) - ny * (pixel.mean[0].0 - mid_x);
    let dx = mid_x - pixel.place[0] + distance * nx;
    let dy = mid_y - pixel.place[1] + distance * ny;
    let (w, z) = (nx * dx + ny * dy, nx * dy - ny * dx + far);
    let [across, along] = pixel.precisions;
    (-0.5 * (across * w * w + along * z * z)).exp()
}

fn two_floats(pixel: &Pixel) -> f32 {
    let [dx, dy] = [0, 1].map(|k| pixel.mean[k].plus(Two(-pixel.place[k], 0.0)));
    let [a, b, c] = pixel.conic;
    let squares = a.times(dx).times(dx).plus(c.times(dy).times(dy));
    let mixed = b.times(dx).times(dy);
    let sum = squares.times(Two(0.5, 0.0)).plus(mixed);
    (-(sum.0 + sum.1)).exp()
}

fn pixels(rng: &mut Pcg64, n: usize, length_px: f64) -> Vec<Pixel> {
    (0..n).map(|_| Pixel::random(rng, length_px)).collect()
}

fn errors(pixels: &[Pixel], form: Form) -> ErrorStats {
    let got: Vec<f32> = pixels.iter().map(form).collect();
    let expected: Vec<f64> = pixels.iter().map(|pixel| pixel.expected).collect();
    Errors::of(&got, &expected)
}

/// Needles of a few hundred pixels.
pub(super) fn measure(bench: &mut Bench, n: usize) {
    let pixels = pixels(&mut generator(17), n, LENGTH_PX);
    for (variant, form) in FORMS {
        let error = errors(&pixels, form);
        host::measure(bench, &host::Form { op: OP, variant }, &pixels, form, error);
    }
}

/// The forms for needles of one length.
pub(super) fn stiff(bench: &mut Bench, sweep: &str, length_px: f64, n: usize) {
    let pixels = pixels(&mut generator(18), n, length_px);
    for (variant, form) in FORMS {
        let error = errors(&pixels, form);
        host::stiff(
            bench,
            &host::Form { op: OP, variant },
            sweep,
            length_px,
            error,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest difference of alpha.
    fn worst(length_px: f64, form: Form) -> f64 {
        let pixels = pixels(&mut generator(0), 2000, length_px);
        let off = pixels
            .iter()
            .map(|pixel| (f64::from(form(pixel)) - pixel.expected).abs());
        off.fold(0.0, f64::max)
    }

    #[test]
    fn all_forms_are_the_exponent() {
        for (name, form) in FORMS {
            let off = worst(10.0, form);
            assert!(off < 1e-3, "{name}: {off}");
        }
    }

    #[test]
    fn only_the_plain_form_fails_on_long_needles() {
        assert!(worst(65e3, plain) > 0.5);
        for form in [per_tile, two_floats] {
            let off = worst(65e3, form);
            assert!(off < 2e-3, "{off}");
        }
    }
}
