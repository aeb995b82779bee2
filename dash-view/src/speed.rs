//! Gaussians by their speed.

use burn::tensor::{Tensor, TensorData};
use dash_kernels::Camera;
use dash_kernels::project::ShCoeffs;
use dash_kernels::rows::join_rows;
use dash_kernels::splats;
use dash_model::{DynamicScene, ModelError, Rendering, SH_C0, to_host};

use crate::draw::device_of;

/// How bright static Gaussians are beside coloured ones.
const STATIC_BRIGHTNESS: f32 = 0.5;
/// Parts of red, green and blue in brightness (Rec. 601).
const LUMA: [f32; 3] = [0.299, 0.587, 0.114];

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

    /// The colour of a speed, sRGB in [0, 1].
    pub fn color(&self, speed: f32) -> [f32; 3] {
        /// Violet, magenta, orange, yellow.
        const STOPS: [[f32; 3]; 4] = [
            [0.25, 0.10, 0.55],
            [0.75, 0.15, 0.50],
            [0.98, 0.55, 0.20],
            [1.00, 0.95, 0.45],
        ];
        let last = STOPS.len() - 1;
        let place = (speed / self.fastest).clamp(0.0, 1.0) * last as f32;
        let from = (place as usize).min(last - 1);
        let share = place - from as f32;
        std::array::from_fn(|k| STOPS[from][k] + (STOPS[from + 1][k] - STOPS[from][k]) * share)
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
    let dc: Vec<f32> = to_host(moved)?
        .into_iter()
        .flat_map(|distance| colors.color(distance / (to - from)))
        .map(|value| (value - 0.5) / SH_C0)
        .collect();
    let n = dc.len() / 3;
    let mut deformed = dynamic.deform(settings, time)?;
    deformed.sh_coeffs = ShCoeffs {
        dc: Tensor::from_data(TensorData::new(dc, [n, 1, 3]), &device_of(scene)),
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
    use super::*;

    #[test]
    fn faster_is_brighter() {
        let colors = SpeedColors::new(2.0, 11);
        assert_eq!(colors.half_interval, 0.05);
        let brightness = |speed| {
            let color = colors.color(speed);
            color.iter().zip(LUMA).map(|(c, w)| c * w).sum::<f32>()
        };
        let speeds = [0.0, 0.4, 0.8, 1.2, 1.6, 2.0];
        for pair in speeds.windows(2) {
            assert!(brightness(pair[0]) < brightness(pair[1]), "{pair:?}");
        }
        assert_eq!(colors.color(9.0), colors.color(2.0));
        // A scene in which nothing moves has no fastest.
        let still = SpeedColors::new(0.0, 1);
        assert_eq!(still.color(0.0), colors.color(0.0));
    }
}
