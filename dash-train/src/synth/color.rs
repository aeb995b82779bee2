//! Colours in linear light and in sRGB.

use glam::DVec3;

/// An sRGB hex colour in linear RGB.
pub fn rgb(hex: u32) -> DVec3 {
    let channel = |shift: u32| srgb_to_linear(f64::from((hex >> shift) & 0xff) / 255.0);
    DVec3::new(channel(16), channel(8), channel(0))
}

/// sRGB in [0, 1] to linear light.
pub fn srgb_to_linear(value: f64) -> f64 {
    if value <= 0.040_45 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }
}

/// Linear light to 8-bit sRGB.
pub fn linear_to_srgb8(value: f64) -> u8 {
    let value = value.clamp(0.0, 1.0);
    let encoded = if value <= 0.003_130_8 {
        12.92 * value
    } else {
        1.055 * value.powf(1.0 / 2.4) - 0.055
    };
    (255.0 * encoded).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_round_trips_through_linear() {
        for byte in 0..=255u8 {
            let linear = srgb_to_linear(f64::from(byte) / 255.0);
            assert_eq!(linear_to_srgb8(linear), byte);
        }
    }
}
