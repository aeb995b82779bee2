//! A gain and an offset per camera and channel: cameras of a rig differ in exposure and white balance.
//!
//! Without it, the scene has to explain what the cameras do: with colours that depend on direction, and with veils before
//! each camera. What the cameras have in common stays in the scene: gains are 1 and offsets 0 on average, and a
//! held-out camera is drawn without any. Cameras that turn out to be alike have none from then on. A camera with one picture, of a time that no other camera shows, has none: its
//! exposure and the scene's colours at that time are ambiguous. Source: Dynamic 3D Gaussians (Luiten et al. 2024).

use std::collections::{BTreeMap, BTreeSet};

use burn::tensor::{Device, Gradients, Tensor, TensorData};
use dash_kernels::adam::Stop;
use dash_kernels::exposure::{CHANNELS, RESPONSE, expose};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::dataset::View;
use crate::train::core::optimizer::Moments;
use crate::train::core::{Extension, GradientVisit, Ranges, Rate, Run, Saved, Section, to_host};

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

impl Section for ExposureConfig {
    fn check(&self, ranges: &mut Ranges) {
        ranges.positive("rate", self.rate);
    }
}

/// What the cameras do to the colours of the scene, on the device: gains beyond 1, then offsets.
struct Responses {
    /// The row of each camera.
    rows: BTreeMap<usize, usize>,
    /// `[cameras, 2 C]`.
    values: Tensor<2>,
    /// Of each row.
    moments: Vec<Moments>,
}

impl Responses {
    /// Of cameras that do nothing.
    fn none(cameras: BTreeSet<usize>, device: &Device) -> Self {
        let n = cameras.len();
        let zeros = Tensor::zeros([RESPONSE], device);
        Self {
            rows: cameras.into_iter().zip(0..).collect(),
            values: Tensor::zeros([n, RESPONSE], device),
            moments: (0..n).map(|_| Moments::of(&zeros)).collect(),
        }
    }

    /// One step of Adam on a camera, given its gradient `[2, C]`; then all are moved so that their means are zero.
    fn update(&mut self, row: usize, gradient: Tensor<2>, rate: Rate, stop: Option<&Stop>) {
        let value = self.values.clone().narrow(0, row, 1).reshape([RESPONSE]);
        let moments = std::mem::replace(&mut self.moments[row], Moments::of(&value));
        let (value, moments) = moments.step(value, gradient.reshape([RESPONSE]), rate, stop);
        self.moments[row] = moments;
        let row = row..row + 1;
        // Nobody else holds the values: they change in place.
        let hollow = Tensor::empty([1, 1], &value.device());
        let values = std::mem::replace(&mut self.values, hollow);
        let values = values.slice_assign([row, 0..RESPONSE], value.reshape([1, RESPONSE]));
        self.values = values.clone() - values.mean_dim(0);
    }

    /// Whether all cameras are known to be alike: what they seem to do then is what the scene does not fit yet.
    fn are_alike(&self) -> bool {
        let n = self.moments.len();
        let steps: u64 = self.moments.iter().map(|moments| moments.steps).sum();
        if n == 0 || steps < KNOWN * n as u64 {
            return false;
        }
        let values = to_host(self.values.clone());
        let gray = |r: &[f32], channel: usize| 0.5 * r[channel] + r[CHANNELS + channel];
        let rows = values.chunks_exact(RESPONSE);
        let squares = rows.flat_map(|r| (0..CHANNELS).map(move |c| gray(r, c).powi(2)));
        let mean = squares.sum::<f32>() / (n * CHANNELS) as f32;
        mean.sqrt() < LEAST
    }
}

/// See [`ExposureConfig`].
pub struct Exposure {
    config: ExposureConfig,
    /// `None` where cameras have no exposure of their own.
    responses: Option<Responses>,
    /// Of each of the step's views the row of its camera, and its gains and offsets as a leaf `[2, C]` of the graph.
    present: Vec<(usize, Tensor<2>)>,
    /// Whether the last of them is of the view that is drawn.
    is_exposed: bool,
}

impl Exposure {
    /// From its section.
    pub fn new(config: ExposureConfig) -> Self {
        Self {
            config,
            responses: None,
            present: Vec::new(),
            is_exposed: false,
        }
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
        let cameras = views().filter(told_apart).map(|view| view.camera_index);
        let cameras: BTreeSet<usize> = cameras.collect();
        self.responses = (!cameras.is_empty()).then(|| Responses::none(cameras, &device));
    }

    fn before_step(&mut self, _run: &mut Run<M>) -> Result<(), Error> {
        self.present.clear();
        Ok(())
    }

    fn before_forward(&mut self, _run: &mut Run<M>, view: &View) -> Result<(), Error> {
        self.is_exposed = false;
        // One camera alone is what all have in common.
        let responses = self.responses.as_ref().filter(|r| r.rows.len() > 1);
        let row = responses.and_then(|r| r.rows.get(&view.camera_index));
        if let (Some(responses), Some(&row)) = (responses, row) {
            let values = responses.values.clone().narrow(0, row, 1);
            let leaf = Tensor::from_inner(values.reshape([2, CHANNELS])).require_grad();
            self.present.push((row, leaf));
            self.is_exposed = true;
        }
        Ok(())
    }

    fn splats(&mut self, _run: &Run<M>, splats: Tensor<2>) -> Tensor<2> {
        let Some((_, leaf)) = self.present.last().filter(|_| self.is_exposed) else {
            return splats;
        };
        expose(splats, leaf.clone()).expect("a response is two rows of three")
    }

    fn gradients(&self, visit: &mut GradientVisit<'_>) {
        for (_, leaf) in &self.present {
            visit.leaf(leaf);
        }
    }

    fn after_backward(&mut self, run: &mut Run<M>, gradients: &mut Gradients) {
        for (row, leaf) in std::mem::take(&mut self.present) {
            if let Some(gradient) = leaf.grad_remove(gradients)
                && let Some(responses) = &mut self.responses
            {
                let rate = Rate::plain(self.config.rate);
                responses.update(row, gradient, rate, run.optimizer.stop.as_ref());
            }
        }
    }

    fn after_step(&mut self, run: &mut Run<M>) -> Result<(), Error> {
        let decides = run.step == (DECIDED * run.config.iterations as f32).round() as usize;
        if decides && self.responses.as_ref().is_some_and(Responses::are_alike) {
            tracing::info!("all cameras have the same exposure");
            self.responses = None;
        }
        Ok(())
    }

    fn save(&self) -> Saved {
        let mut saved = Saved::default();
        let mut numbers = Vec::new();
        if let Some(responses) = &self.responses {
            let values = to_host(responses.values.clone());
            for (values, moments) in values.chunks_exact(RESPONSE).zip(&responses.moments) {
                numbers.extend_from_slice(values);
                for moment in [&moments.first, &moments.second] {
                    numbers.extend(to_host(moment.clone()));
                }
                numbers.push(moments.steps as f32);
            }
        }
        saved.insert("cameras", numbers);
        saved
    }

    fn restore(&mut self, run: &Run<M>, mut saved: Saved) -> Result<(), String> {
        const EACH: usize = 3 * RESPONSE + 1;
        let numbers = saved.take("cameras")?;
        let Some(responses) = self.responses.as_mut().filter(|_| !numbers.is_empty()) else {
            self.responses = None;
            return Ok(());
        };
        let n = responses.rows.len();
        if numbers.len() != EACH * n {
            return Err(format!(
                "{} numbers of {n} cameras, of {EACH} each",
                numbers.len()
            ));
        }
        let device = run.device.clone().inner();
        let part = |row: &[f32], k: usize| row[k * RESPONSE..(k + 1) * RESPONSE].to_vec();
        let upload = |values| Tensor::from_data(TensorData::new(values, [RESPONSE]), &device);
        let rows = || numbers.chunks_exact(EACH);
        let values: Vec<f32> = rows().flat_map(|row| part(row, 0)).collect();
        responses.values = Tensor::from_data(TensorData::new(values, [n, RESPONSE]), &device);
        responses.moments = rows()
            .map(|row| Moments {
                first: upload(part(row, 1)),
                second: upload(part(row, 2)),
                steps: row[3 * RESPONSE] as u64,
            })
            .collect();
        Ok(())
    }
}

#[cfg(test)]
mod tests;
