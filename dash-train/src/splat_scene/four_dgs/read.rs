//! Reading clips.

use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;

use burn::tensor::Device;
use dash_kernels::splats::NEAR_PLANE;
use dash_model::{DynamicScene, GaussianRows, SH_C0, logit};
use fourdgs::quantization::sh_coefficient;
use fourdgs::{GaussianSet, ReadOptions};

use super::key;
use crate::Error;
use crate::splat_scene::at_rest;

/// Frames per second of a clip that says nothing about it.
const FRAME_RATE: f64 = 30.0;
/// The only model of time that is understood.
const MODEL: &str = "gaussian-birth";

/// A clip of Gaussians that move along lines within windows of time.
#[derive(Debug, Clone)]
pub struct Motions {
    set: GaussianSet,
    cutoff: f64,
    n_frames: usize,
    frame_rate: f64,
    /// World units.
    near_plane: f64,
}

impl Motions {
    /// Reads a `.4dgs`.
    ///
    /// Sound is left out. What changes pictures and is not understood is refused: tracks of objects, other models of time.
    ///
    /// # Errors
    /// When the file can't be read, is damaged, or holds what is not understood.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let file = std::fs::File::open(path).map_err(|e| Error::io(path, "read", e))?;
        let options = ReadOptions {
            recover_truncated: false,
            ..Default::default()
        };
        let refused = |expected: &str, found: String| {
            Error::invalid(
                path,
                expected,
                found,
                "name another file, or export it anew",
            )
        };
        let scene = fourdgs::read_from(std::io::BufReader::new(file), &options)
            .map_err(|error| refused("a .4dgs", error.to_string()))?;
        if scene.header.temporal_model != MODEL {
            let found = format!("`{}`", scene.header.temporal_model);
            return Err(refused("the model of time `gaussian-birth`", found));
        }
        if !scene.objects.tracks.is_empty() {
            let found = scene.objects.tracks.len();
            return Err(refused(
                "Gaussians that move by themselves",
                format!("{found} tracks that move objects"),
            ));
        }
        let of_header = |key| value(&scene.header.attributes, key);
        let frame_rate = of_header(key::FRAME_RATE).filter(|rate| *rate > 0.0);
        let frame_rate = frame_rate.unwrap_or(FRAME_RATE);
        let counted = of_header(key::FRAMES).filter(|n| *n >= 1.0);
        let n_frames = counted.unwrap_or((scene.duration_sec * frame_rate).round());
        let found = n_frames.to_string();
        if !(n_frames.is_finite() && n_frames < 1e7) {
            return Err(refused("a clip of less than 10,000,000 frames", found));
        }
        Ok(Self {
            set: scene.gaussians,
            cutoff: scene.header.cutoff,
            n_frames: (n_frames as usize).max(1),
            frame_rate,
            near_plane: of_header(key::NEAR_PLANE).unwrap_or(NEAR_PLANE),
        })
    }

    /// Frames of the clip.
    pub fn n_frames(&self) -> usize {
        self.n_frames
    }

    /// Frames per second.
    pub fn frame_rate(&self) -> f64 {
        self.frame_rate
    }

    /// Gaussians in the file: one that moves has many, one for each window.
    pub fn n_stored(&self) -> usize {
        self.set.count()
    }

    /// The Gaussians at `time`, in [0, 1] over the clip.
    pub fn rows_at(&self, time: f32) -> GaussianRows {
        let last = (self.n_frames - 1) as f64 / self.frame_rate;
        let state = self.set.state_at(f64::from(time) * last, self.cutoff);
        let n_coefficients = match &self.set.sh {
            Some(_) => self.set.sh_coefficients,
            None => 0,
        };
        let mut rows = GaussianRows {
            sh_rest_width: 3 * n_coefficients,
            ..Default::default()
        };
        for (k, &index) in state.indices.iter().enumerate() {
            let index = index as usize;
            let three = |values: &[f32], row: usize| -> [f32; 3] {
                std::array::from_fn(|axis| values[3 * row + axis])
            };
            rows.means.push(three(&state.centers, k));
            let [x, y, z, w] = std::array::from_fn(|part| state.orientations[4 * k + part]);
            rows.quats.push([w, x, y, z]);
            rows.log_scales
                .push(three(&self.set.scales, index).map(f32::ln));
            rows.opacity_logits.push(logit(state.opacity[k]));
            let color: [f32; 3] =
                std::array::from_fn(|channel| self.set.colors[4 * index + channel]);
            rows.sh_dc.push(color.map(|value| (value - 0.5) / SH_C0));
            if let Some(sh) = &self.set.sh {
                let own = &sh[3 * n_coefficients * index..][..3 * n_coefficients];
                for coefficient in 0..n_coefficients {
                    let of = |channel| own[channel * n_coefficients + coefficient];
                    let values = [0, 1, 2].map(|channel| sh_coefficient(of(channel)) as f32);
                    rows.sh_rest.extend(values);
                }
            }
        }
        rows
    }

    /// The scene at `time`, in [0, 1] over the clip, over black.
    pub fn scene_at(&self, time: f32, device: &Device) -> DynamicScene {
        at_rest(&self.rows_at(time), self.near_plane, device)
    }
}

/// A finite number of a header, where it is one.
fn value(attributes: &BTreeMap<String, String>, key: &str) -> Option<f64> {
    let text = attributes.get(key)?;
    f64::from_str(text).ok().filter(|value| value.is_finite())
}
