//! A streaming separable blur: rows go in from top to bottom, blurred rows come out.

use super::window::{RADIUS, TAPS, window};

/// Blurs `M` maps of the same size together.
///
/// Rows are pushed one by one, starting `RADIUS` rows above the first that is wanted; rows
/// outside the image are pushed as [`push_zeros`](Self::push_zeros). From the `TAPS`-th push on,
/// each yields the blurred row that lies `RADIUS` rows above the pushed one.
pub(super) struct Blur<const M: usize> {
    /// Values in a row: width times channels.
    length: usize,
    channels: usize,
    weights: [f64; RADIUS + 1],
    /// Per map, the next row between zeros for the window's overhang.
    input: [Vec<f64>; M],
    /// Per map, the last `TAPS` rows blurred along the row; a row's place is its number modulo
    /// `TAPS`.
    ring: [Vec<f64>; M],
    output: [Vec<f64>; M],
    pushed: usize,
}

impl<const M: usize> Blur<M> {
    pub fn new(width: usize, channels: usize) -> Self {
        let length = width * channels;
        let taps = window();
        Self {
            length,
            channels,
            weights: std::array::from_fn(|distance| taps[RADIUS + distance]),
            input: std::array::from_fn(|_| vec![0.0; length + 2 * RADIUS * channels]),
            ring: std::array::from_fn(|_| vec![0.0; TAPS * length]),
            output: std::array::from_fn(|_| vec![0.0; length]),
            pushed: 0,
        }
    }

    /// Where to write the next row of each map before [`push`](Self::push).
    #[inline(always)]
    pub fn input(&mut self) -> [&mut [f64]; M] {
        let start = RADIUS * self.channels;
        let length = self.length;
        self.input.each_mut().map(|row| &mut row[start..][..length])
    }

    /// Takes the rows written to [`input`](Self::input).
    #[inline(always)]
    pub fn push(&mut self) -> Option<[&[f64]; M]> {
        let start = (self.pushed % TAPS) * self.length;
        for (input, ring) in self.input.iter().zip(&mut self.ring) {
            let taps = std::array::from_fn(|tap| &input[tap * self.channels..]);
            weighted_sum(&self.weights, taps, &mut ring[start..][..self.length]);
        }
        self.advance()
    }

    /// Takes a row of zeros.
    #[inline(always)]
    pub fn push_zeros(&mut self) -> Option<[&[f64]; M]> {
        let start = (self.pushed % TAPS) * self.length;
        for ring in &mut self.ring {
            ring[start..][..self.length].fill(0.0);
        }
        self.advance()
    }

    #[inline(always)]
    fn advance(&mut self) -> Option<[&[f64]; M]> {
        self.pushed += 1;
        if self.pushed < TAPS {
            return None;
        }
        for (ring, output) in self.ring.iter().zip(&mut self.output) {
            let oldest = self.pushed;
            let taps = std::array::from_fn(|tap| &ring[(oldest + tap) % TAPS * self.length..]);
            weighted_sum(&self.weights, taps, output);
        }
        Some(self.output.each_ref().map(Vec::as_slice))
    }
}

/// The window's weighted sum of rows; symmetric taps are added first, which halves the products.
#[inline(always)]
fn weighted_sum(weights: &[f64; RADIUS + 1], taps: [&[f64]; TAPS], out: &mut [f64]) {
    let taps = taps.map(|tap| &tap[..out.len()]);
    for i in 0..out.len() {
        let mut sum = weights[0] * taps[RADIUS][i];
        for distance in 1..=RADIUS {
            sum += weights[distance] * (taps[RADIUS - distance][i] + taps[RADIUS + distance][i]);
        }
        out[i] = sum;
    }
}
