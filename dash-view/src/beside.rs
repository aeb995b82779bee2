//! A captured picture beside a drawn one.

use crate::draw::Frame;

/// A captured picture beside a drawn one.
#[derive(Debug, Clone)]
pub struct Beside {
    /// The picture.
    pub captured: Frame,
    /// How far the drawn one is from it, black where they are alike.
    pub difference: Frame,
    /// Peak signal-to-noise ratio of all pixels, dB.
    pub psnr: f64,
}

impl Beside {
    /// A captured picture `[H * W * 3]` of the drawn one's size.
    pub(crate) fn of(drawn: &Frame, captured: &[u8]) -> Self {
        let rgb = drawn.rgb();
        let apart = rgb.iter().zip(captured).map(|(a, b)| a.abs_diff(*b));
        let difference: Vec<u8> = apart.collect();
        let squares: f64 = difference.iter().map(|&d| f64::from(d).powi(2)).sum();
        let mean = squares / rgb.len().max(1) as f64;
        let frame = |rgb: &[u8]| Frame::from_rgb(drawn.width, drawn.height, rgb);
        Self {
            psnr: 10.0 * (255.0 * 255.0 / mean).log10(),
            difference: frame(&difference),
            captured: frame(captured),
        }
    }
}
