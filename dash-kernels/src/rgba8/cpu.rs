//! Pictures in 8 bits a channel on the CPU: one pass at the speed of memory.

use rayon::prelude::*;

use crate::isa::{Kernel, dispatch, finite_or_zero};

/// Pixels per parallel piece, roughly; a smaller picture is not worth waking threads for.
const PIECE: usize = 1 << 15;
/// The byte that says opaque.
const OPAQUE: u32 = 0xff00_0000;
/// One gray in three bytes.
const GRAY: u32 = 0x01_0101;

/// `[H, W, C]` to `[H, pitch]`.
pub(super) fn rgba8(values: &[f32], shape: [usize; 3], pitch: usize) -> Vec<i32> {
    let [height, width, channels] = shape;
    let mut pixels = vec![0; height * pitch];
    if width == 0 || height == 0 {
        return pixels;
    }
    let rows = PIECE.div_ceil(pitch);
    let pieces = pixels
        .par_chunks_mut(rows * pitch)
        .zip(values.par_chunks(rows * width * channels));
    pieces.for_each(|(pixels, values)| {
        dispatch(Rows {
            pixels,
            values,
            width,
            channels,
            pitch,
        });
    });
    pixels
}

struct Rows<'a> {
    pixels: &'a mut [i32],
    values: &'a [f32],
    width: usize,
    channels: usize,
    pitch: usize,
}

impl Kernel for Rows<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let pixels = self.pixels.chunks_mut(self.pitch);
        let rows = pixels.zip(self.values.chunks(self.width * self.channels));
        for (pixels, values) in rows {
            let pixels = &mut pixels[..self.width];
            match self.channels {
                // The rasterizer's, and a picture's: a length that the compiler knows.
                5 => colors(pixels, values.as_chunks::<5>().0.iter()),
                3 => colors(pixels, values.as_chunks::<3>().0.iter()),
                1 | 2 => {
                    for (pixel, value) in pixels.iter_mut().zip(values.chunks(self.channels)) {
                        *pixel = ((level(value[0]) * GRAY) | OPAQUE).cast_signed();
                    }
                }
                n => colors(pixels, values.chunks(n)),
            }
        }
    }
}

#[inline(always)]
fn colors(pixels: &mut [i32], values: impl Iterator<Item = impl AsRef<[f32]>>) {
    for (pixel, value) in pixels.iter_mut().zip(values) {
        let value = value.as_ref();
        let [red, green, blue] = [level(value[0]), level(value[1]), level(value[2])];
        *pixel = (red | (green << 8) | (blue << 16) | OPAQUE).cast_signed();
    }
}

/// The nearest of 256 levels of [0, 1].
#[inline(always)]
fn level(value: f32) -> u32 {
    (finite_or_zero(value).clamp(0.0, 1.0) * 255.0 + 0.5) as u32
}
