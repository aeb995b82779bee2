//! A streaming separable blur: rows go in from top to bottom, blurred rows come out.

use super::window::{RADIUS, TAPS, window};

/// Values summed together: one AVX-512 register of `f64`.
const LANES: usize = 8;

/// Blurs a tile of `M` maps of the same size.
///
/// Rows are pushed one by one, starting `RADIUS` rows above the first that is wanted; rows
/// outside the image are pushed as [`push_zeros`](Self::push_zeros). From the `TAPS`-th push on,
/// each yields the blurred row that lies `RADIUS` rows above the pushed one.
pub(super) struct Blur<const M: usize> {
    channels: usize,
    /// Values in an input row: the tile's and the window's overhang on both sides.
    input_length: usize,
    /// Values in a blurred row, rounded up to whole registers.
    length: usize,
    weights: [f64; RADIUS + 1],
    input: [Vec<f64>; M],
    /// Per map, the last `TAPS` rows blurred along the row; a row's place is its number modulo
    /// `TAPS`.
    ring: [Vec<f64>; M],
    output: [Vec<f64>; M],
    pushed: usize,
}

impl<const M: usize> Blur<M> {
    pub fn new(columns: usize, channels: usize) -> Self {
        let overhang = 2 * RADIUS * channels;
        let length = (columns * channels).next_multiple_of(LANES);
        let taps = window();
        Self {
            channels,
            input_length: columns * channels + overhang,
            length,
            weights: std::array::from_fn(|distance| taps[RADIUS + distance]),
            input: std::array::from_fn(|_| vec![0.0; length + overhang]),
            ring: std::array::from_fn(|_| vec![0.0; TAPS * length]),
            output: std::array::from_fn(|_| vec![0.0; length]),
            pushed: 0,
        }
    }

    /// Where to write the next row of each map, from `RADIUS` columns left of the tile to
    /// `RADIUS` columns right of it, before [`push`](Self::push).
    #[inline(always)]
    pub fn input(&mut self) -> [&mut [f64]; M] {
        let length = self.input_length;
        self.input.each_mut().map(|row| &mut row[..length])
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
    // Spelled out, because a loop over taps keeps the loop over values from being vectorised.
    let [a5, a4, a3, a2, a1, centre, b1, b2, b3, b4, b5] = taps.map(|tap| &tap[..out.len()]);
    let [w0, w1, w2, w3, w4, w5] = *weights;
    for i in 0..out.len() {
        out[i] = w0 * centre[i]
            + w1 * (a1[i] + b1[i])
            + w2 * (a2[i] + b2[i])
            + w3 * (a3[i] + b3[i])
            + w4 * (a4[i] + b4[i])
            + w5 * (a5[i] + b5[i]);
    }
}
