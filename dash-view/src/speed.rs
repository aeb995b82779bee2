//! Gaussians by their speed.

use burn::tensor::Tensor;
use dash_kernels::Camera;
use dash_kernels::project::ShCoeffs;
use dash_kernels::rows::join_rows;
use dash_kernels::splats;
use dash_model::{DynamicScene, ModelError, Rendering, SH_C0};

/// How bright static Gaussians are beside coloured ones.
const STATIC_BRIGHTNESS: f32 = 0.5;
/// Parts of red, green and blue in brightness (Rec. 601).
const LUMA: [f32; 3] = [0.299, 0.587, 0.114];

/// Colours from the slowest to the fastest: violet, magenta, orange, yellow.
const STOPS: [[f32; 3]; 4] = [
    [0.25, 0.10, 0.55],
    [0.75, 0.15, 0.50],
    [0.98, 0.55, 0.20],
    [1.00, 0.95, 0.45],
];

/// Which speeds have which colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedColors {
    /// The speed that is yellow, world units over the whole clip; slower ones go down to violet.
    pub fastest: f32,
    /// Half of the time over which a speed is measured, of the clip.
    pub half_interval: f32,
}

impl SpeedColors {
    /// For a clip of so many frames.
    pub fn new(fastest: f32, n_frames: usize) -> Self {
        Self {
            fastest: fastest.max(f32::MIN_POSITIVE),
            half_interval: 0.5 / n_frames.saturating_sub(1).max(1) as f32,
        }
    }

    /// The same within a part of the clip that has times of its own, in [0, 1] over it; `duration` is its share of the clip.
    pub fn within(self, duration: f32) -> Self {
        Self {
            fastest: (self.fastest * duration).max(f32::MIN_POSITIVE),
            half_interval: self.half_interval / duration,
        }
    }

    /// The colours of speeds `[N, 1]` as `[N, 3]`, sRGB in [0, 1].
    pub fn colors(&self, speeds: Tensor<2>) -> Tensor<2> {
        let device = speeds.device();
        // Divided first: a tiny fastest speed has no finite inverse.
        let places = (speeds / self.fastest).clamp(0.0, 1.0) * (STOPS.len() - 1) as f32;
        let row = |color: [f32; 3]| Tensor::<2>::from_floats([color], &device);
        let ramp = STOPS.windows(2).enumerate().map(|(from, stops)| {
            let step = std::array::from_fn(|k| stops[1][k] - stops[0][k]);
            (places.clone() - from as f32).clamp(0.0, 1.0) * row(step)
        });
        ramp.fold(row(STOPS[0]), |colors, part| colors + part)
    }
}

/// The scene with its dynamic Gaussians coloured by their speed.
pub(crate) fn render_speed(
    scene: &DynamicScene,
    camera: &Camera,
    time: f32,
    colors: &SpeedColors,
) -> Result<Rendering, ModelError> {
    let static_splats = in_gray(scene.static_splats(camera)?);
    let Some(dynamic) = scene.dynamic.as_ref().filter(|d| !d.gaussians.is_empty()) else {
        return scene.rasterize(static_splats, camera);
    };
    let settings = &scene.settings;
    let [from, to] = [-1.0, 1.0].map(|sign| (time + sign * colors.half_interval).clamp(0.0, 1.0));
    let means = |time| Ok::<_, ModelError>(dynamic.deform(settings, time)?.means);
    let moved = (means(to)? - means(from)?).powi_scalar(2).sum_dim(1).sqrt();
    let dc = (colors.colors(moved / (to - from)) - 0.5) / SH_C0;
    let n = dc.dims()[0];
    let mut deformed = dynamic.deform(settings, time)?;
    deformed.sh_coeffs = ShCoeffs {
        dc: dc.reshape([n, 1, 3]),
        rest: deformed.sh_coeffs.rest.zeros_like(),
    };
    let splats = join_rows(static_splats, scene.deformed_splats(deformed, camera)?)?;
    scene.rasterize(splats, camera)
}

/// The same splats, darker and without colour.
fn in_gray(packed: Tensor<2>) -> Tensor<2> {
    let weights = Tensor::<2>::from_floats([LUMA], &packed.device()) * STATIC_BRIGHTNESS;
    let rgb = packed.clone().narrow(1, splats::RED, 3);
    let gray = (rgb * weights).sum_dim(1).repeat_dim(1, 3);
    let before = packed.clone().narrow(1, 0, splats::RED);
    let behind = packed.narrow(1, splats::DEPTH, splats::N_COLUMNS - splats::DEPTH);
    Tensor::cat(vec![before, gray, behind], 1)
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use dash_model::to_host;

    use super::*;

    #[test]
    fn faster_is_brighter() {
        let colors = SpeedColors::new(2.0, 11);
        assert_eq!(colors.half_interval, 0.05);
        let color = |colors: &SpeedColors, speed: f32| {
            let speeds = Tensor::<2>::from_floats([[speed]], &Device::flex());
            to_host(colors.colors(speeds)).expect("three values")
        };
        let brightness = |speed| {
            let color = color(&colors, speed);
            color.iter().zip(LUMA).map(|(c, w)| c * w).sum::<f32>()
        };
        let speeds = [0.0, 0.4, 0.8, 1.2, 1.6, 2.0];
        for pair in speeds.windows(2) {
            assert!(brightness(pair[0]) < brightness(pair[1]), "{pair:?}");
        }
        assert_eq!(color(&colors, 9.0), color(&colors, 2.0));
        // Within a quarter of the clip, speeds are a quarter, and frames four times as far apart.
        let quarter = colors.within(0.25);
        assert_eq!((quarter.fastest, quarter.half_interval), (0.5, 0.2));
        // A scene in which nothing moves has no fastest.
        let still = SpeedColors::new(0.0, 1);
        assert_eq!(color(&still, 0.0), color(&colors, 0.0));
    }
}
