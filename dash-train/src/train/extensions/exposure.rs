//! A gain and an offset per camera and channel: cameras of a rig differ in exposure and white balance.
//!
//! Without it, the scene has to explain what the cameras do: with colours that depend on direction, and with veils before
//! each camera. What the cameras have in common stays in the scene: gains are 1 and offsets 0 on average, and a
//! held-out camera is drawn without any. Cameras that turn out to be alike have none from then on. A camera with one picture, of a time that no other camera shows, has none: its
//! exposure and the scene's colours at that time are ambiguous. Source: Dynamic 3D Gaussians (Luiten et al. 2024).

use std::collections::BTreeMap;

use burn::tensor::{Device, Gradients, Tensor, TensorData};
use dash_kernels::splats::{N_COLUMNS, RED};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::dataset::View;
use crate::train::core::optimizer::Moments;
use crate::train::core::{Extension, Rate, Run, Saved, to_host};

/// Channels of a colour.
const CHANNELS: usize = 3;
/// Gains and offsets of a camera.
const VALUES: usize = 2 * CHANNELS;

/// Share of the run after which it is decided whether cameras differ.
const DECIDED: f32 = 0.4;
/// Steps of a camera from which on its values are known well enough for that, as a mean over cameras.
const KNOWN: u64 = 20;
/// Cameras that change a medium gray by less than one level of 8 bits, root mean square, do not differ.
const LEAST: f32 = 1.0 / 255.0;

/// `[extensions.exposure]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExposureConfig {
    /// Learning rate of gains and offsets. Source: ours.
    pub rate: f32,
}

/// What a camera does to the colours of the scene: gains beyond 1, then offsets.
struct Response {
    values: Vec<f32>,
    moments: Moments,
}

impl Response {
    /// Of a camera that does nothing.
    fn none(device: &Device) -> Self {
        Self {
            values: vec![0.0; VALUES],
            moments: Moments::of(&tensor(vec![0.0; VALUES], device)),
        }
    }
}

fn tensor(values: Vec<f32>, device: &Device) -> Tensor<1> {
    Tensor::from_data(TensorData::new(values, [VALUES]), device)
}

/// See [`ExposureConfig`].
pub struct Exposure {
    config: ExposureConfig,
    cameras: BTreeMap<usize, Response>,
    /// The camera of the step, and its gains and offsets as a leaf `[2, C]` of the graph.
    present: Option<(usize, Tensor<2>)>,
}

impl Exposure {
    /// From its section.
    pub fn new(config: ExposureConfig) -> Self {
        Self {
            config,
            cameras: BTreeMap::new(),
            present: None,
        }
    }

    /// One step of Adam on a camera, given its gradient `[2, C]`; then all are moved so that their means are zero.
    fn update(&mut self, camera: usize, gradient: Tensor<2>) {
        let Some(response) = self.cameras.remove(&camera) else {
            return;
        };
        let value = tensor(response.values, &gradient.device());
        let rate = Rate::plain(self.config.rate);
        let (value, moments) = response
            .moments
            .step(value, gradient.reshape([VALUES]), rate);
        let values = to_host(value);
        self.cameras.insert(camera, Response { values, moments });
        let n = self.cameras.len() as f32;
        for k in 0..VALUES {
            let mean = self.cameras.values().map(|r| r.values[k]).sum::<f32>() / n;
            self.cameras.values_mut().for_each(|r| r.values[k] -= mean);
        }
    }
}

impl Exposure {
    /// Whether all cameras are known to be alike: what they seem to do then is what the scene does not fit yet.
    fn are_alike(&self) -> bool {
        let cameras = || self.cameras.values();
        let n = self.cameras.len();
        let steps: u64 = cameras().map(|r| r.moments.steps).sum();
        let gray = |r: &Response, channel| 0.5 * r.values[channel] + r.values[CHANNELS + channel];
        let squares = cameras().flat_map(|r| (0..CHANNELS).map(|c| gray(r, c).powi(2)));
        let mean = squares.sum::<f32>() / (n * CHANNELS) as f32;
        n > 0 && steps >= KNOWN * n as u64 && mean.sqrt() < LEAST
    }
}

impl<M> Extension<M> for Exposure {
    fn name(&self) -> &'static str {
        "exposure"
    }

    fn init(&mut self, run: &mut Run<M>) {
        let device = run.device.clone().inner();
        let (dataset, train_views) = (&run.dataset, &run.train_views);
        let views = || train_views.iter().map(|&index| &dataset.views[index]);
        let (mut of_camera, mut of_time) = (BTreeMap::new(), BTreeMap::new());
        for view in views() {
            *of_camera.entry(view.camera_index).or_insert(0) += 1;
            *of_time.entry(view.frame).or_insert(0) += 1;
        }
        let told_apart =
            |view: &&View| of_camera[&view.camera_index] > 1 || of_time[&view.frame] > 1;
        self.cameras = views()
            .filter(told_apart)
            .map(|view| (view.camera_index, Response::none(&device)))
            .collect();
    }

    fn before_forward(&mut self, run: &mut Run<M>, view: &View) {
        self.present = None;
        // One camera alone is what all have in common.
        if self.cameras.len() < 2 {
            return;
        }
        let Some(response) = self.cameras.get(&view.camera_index) else {
            return;
        };
        let values = TensorData::new(response.values.clone(), [2, CHANNELS]);
        let leaf = Tensor::<2>::from_data(values, &run.device).require_grad();
        self.present = Some((view.camera_index, leaf));
    }

    fn splats(&mut self, _run: &Run<M>, splats: Tensor<2>) -> Tensor<2> {
        let Some((_, leaf)) = &self.present else {
            return splats;
        };
        let (before, after) = (RED, N_COLUMNS - RED - CHANNELS);
        let device = splats.device();
        let zeros = |columns: usize| Tensor::<2>::zeros([2, columns], &device);
        let row = Tensor::cat(vec![zeros(before), leaf.clone(), zeros(after)], 1);
        let gains = row.clone().narrow(0, 0, 1) + 1.0;
        splats * gains + row.narrow(0, 1, 1)
    }

    fn after_backward(&mut self, _run: &mut Run<M>, gradients: &mut Gradients) {
        if let Some((camera, leaf)) = self.present.take()
            && let Some(gradient) = leaf.grad_remove(gradients)
        {
            self.update(camera, gradient);
        }
    }

    fn after_step(&mut self, run: &mut Run<M>) -> Result<(), Error> {
        if run.step == (DECIDED * run.config.iterations as f32).round() as usize && self.are_alike()
        {
            tracing::info!("all cameras have the same exposure");
            self.cameras.clear();
        }
        Ok(())
    }

    fn save(&self) -> Saved {
        let mut saved = Saved::default();
        let numbers = self
            .cameras
            .values()
            .flat_map(|Response { values, moments }| {
                let moments_of = |tensor: &Tensor<1>| to_host(tensor.clone());
                let [first, second] = [&moments.first, &moments.second].map(moments_of);
                [values.clone(), first, second, vec![moments.steps as f32]].concat()
            });
        saved.insert("cameras", numbers.collect());
        saved
    }

    fn restore(&mut self, run: &Run<M>, mut saved: Saved) -> Result<(), String> {
        const EACH: usize = 3 * VALUES + 1;
        let numbers = saved.take("cameras")?;
        if numbers.is_empty() {
            self.cameras.clear();
        }
        if numbers.len() != EACH * self.cameras.len() {
            return Err(format!(
                "{} numbers of {} cameras, of {EACH} each",
                numbers.len(),
                self.cameras.len()
            ));
        }
        let device = run.device.clone().inner();
        for (response, numbers) in self.cameras.values_mut().zip(numbers.chunks_exact(EACH)) {
            let part = |k: usize| numbers[k * VALUES..(k + 1) * VALUES].to_vec();
            response.values = part(0);
            response.moments = Moments {
                first: tensor(part(1), &device),
                second: tensor(part(2), &device),
                steps: numbers[3 * VALUES] as u64,
            };
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
