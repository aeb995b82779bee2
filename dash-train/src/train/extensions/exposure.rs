//! A gain and an offset per camera and channel: cameras of a rig differ in exposure and white balance.
//!
//! Without it, the scene has to explain what the cameras do: with colours that depend on direction, and with veils before
//! each camera. What the cameras have in common stays in the scene: gains are 1 and offsets 0 on average, and a
//! held-out camera is drawn without any. Source: Dynamic 3D Gaussians (Luiten et al. 2024).

use std::collections::BTreeMap;

use burn::tensor::{Gradients, Tensor, TensorData};
use dash_kernels::splats::{N_COLUMNS, RED};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::dataset::View;
use crate::train::core::{Extension, Run, Saved, to_host};

/// Channels of a colour.
const CHANNELS: usize = 3;
/// Adam, as in 3DGS.
const BETAS: [f32; 2] = [0.9, 0.999];
const EPSILON: f32 = 1e-15;

/// `[extensions.exposure]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExposureConfig {
    /// Learning rate of gains and offsets. Source: ours.
    pub rate: f32,
}

/// What a camera does to the colours of the scene: gains beyond 1, then offsets.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Response {
    values: [f32; 2 * CHANNELS],
    first: [f32; 2 * CHANNELS],
    second: [f32; 2 * CHANNELS],
    steps: i32,
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

    /// One step of Adam on a camera, given its gradient; then all are moved so that their means are zero.
    fn update(&mut self, camera: usize, gradient: &[f32]) {
        let rate = self.config.rate;
        let response = self.cameras.entry(camera).or_default();
        response.steps += 1;
        let corrections = BETAS.map(|beta| 1.0 - beta.powi(response.steps));
        for (k, &g) in gradient.iter().enumerate() {
            response.first[k] += (1.0 - BETAS[0]) * (g - response.first[k]);
            response.second[k] += (1.0 - BETAS[1]) * (g * g - response.second[k]);
            let [first, second] = [response.first[k], response.second[k]];
            let scale = (second / corrections[1]).sqrt() + EPSILON;
            response.values[k] -= rate * first / corrections[0] / scale;
        }
        let n = self.cameras.len() as f32;
        for k in 0..2 * CHANNELS {
            let mean = self.cameras.values().map(|r| r.values[k]).sum::<f32>() / n;
            self.cameras.values_mut().for_each(|r| r.values[k] -= mean);
        }
    }
}

impl<M> Extension<M> for Exposure {
    fn name(&self) -> &'static str {
        "exposure"
    }

    fn init(&mut self, run: &mut Run<M>) {
        let views = run
            .train_views
            .iter()
            .map(|&index| &run.dataset.views[index]);
        self.cameras = views
            .map(|view| (view.camera_index, Response::default()))
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
        let values = TensorData::new(response.values.to_vec(), [2, CHANNELS]);
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
            self.update(camera, &to_host(gradient));
        }
    }

    fn save(&self) -> Saved {
        let mut saved = Saved::default();
        let numbers = self.cameras.values().flat_map(|response| {
            let all = [response.values, response.first, response.second].concat();
            all.into_iter().chain([response.steps as f32])
        });
        saved.insert("cameras", numbers.collect());
        saved
    }

    fn restore(&mut self, _run: &Run<M>, mut saved: Saved) -> Result<(), String> {
        const EACH: usize = 6 * CHANNELS + 1;
        let numbers = saved.take("cameras")?;
        if numbers.len() != EACH * self.cameras.len() {
            return Err(format!(
                "{} numbers of {} cameras, of {EACH} each",
                numbers.len(),
                self.cameras.len()
            ));
        }
        for (response, numbers) in self.cameras.values_mut().zip(numbers.chunks_exact(EACH)) {
            let (parts, steps) = numbers.split_at(6 * CHANNELS);
            let parts = [
                &mut response.values,
                &mut response.first,
                &mut response.second,
            ]
            .into_iter()
            .zip(parts.chunks_exact(2 * CHANNELS));
            parts.for_each(|(to, from)| to.copy_from_slice(from));
            response.steps = steps[0] as i32;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
