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
    pub(crate) fn of(drawn: &Frame, captured: Vec<u8>) -> Self {
        let pairs = || drawn.rgb.iter().zip(&captured);
        let squares: f64 = pairs()
            .map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2))
            .sum();
        let mean = squares / drawn.rgb.len().max(1) as f64;
        let frame = |rgb| Frame {
            width: drawn.width,
            height: drawn.height,
            rgb,
        };
        Self {
            psnr: 10.0 * (255.0 * 255.0 / mean).log10(),
            difference: frame(pairs().map(|(a, b)| a.abs_diff(*b)).collect()),
            captured: frame(captured),
        }
    }
}
