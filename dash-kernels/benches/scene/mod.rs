//! What both benchmarks share: devices, a clock, and random Gaussians.

#![allow(dead_code, reason = "each benchmark uses a part of it")]

pub mod clock;
pub mod gaussians;

use burn::tensor::Device;

/// Sizes of a whole frame.
pub const SIZES: [Size; 3] = [
    Size(10_000, 320, 240, 2.0),
    Size(50_000, 320, 240, 2.0),
    Size(100_000, 1352, 1014, 3.0),
];

/// Colour coefficients of a channel.
pub const N_COEFFS: usize = 16;

/// Gaussians, image width and height, and standard deviation in pixels.
#[derive(Debug, Clone, Copy)]
pub struct Size(pub usize, pub usize, pub usize, pub f32);

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} at {} x {}", self.0, self.1, self.2)
    }
}

#[cfg_attr(
    feature = "ndarray",
    expect(deprecated, reason = "supported while it exists")
)]
/// The backends of the build by name.
pub fn devices() -> Vec<(&'static str, Device)> {
    vec![
        #[cfg(feature = "ndarray")]
        ("ndarray", Device::ndarray()),
        #[cfg(feature = "flex")]
        ("flex", Device::flex()),
        #[cfg(feature = "wgpu")]
        (
            "wgpu",
            Device::wgpu(burn::tensor::DeviceKind::DefaultDevice),
        ),
        #[cfg(feature = "cuda")]
        ("cuda", Device::cuda(0)),
    ]
}
