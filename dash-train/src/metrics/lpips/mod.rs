//! LPIPS, the learned perceptual image patch similarity: distances between the features of two pictures in a
//! network for image recognition.
//!
//! # Source
//! Zhang et al., "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric", CVPR
//! 2018; version 0.1 of the weights, which are the user's to bring (see [`Lpips::load`]).
//!
//! # Map
//! - `architecture`: both networks as tables, and the tensors they need.
//! - `features`: their layers as Burn modules.
//! - `weights`: weight files, read without executing anything in them.
//! - this file: the distance.

mod architecture;
mod features;
#[cfg(test)]
mod reference;
#[cfg(test)]
mod tests;
mod weights;

pub use architecture::{ExpectedTensor, LayerTable, Network};

use std::collections::BTreeMap;
use std::path::PathBuf;

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, TensorData};
use dash_model::parameters::HostTensor;

use super::CHANNELS;
use crate::Error;
use architecture::{bias_name, linear_name, weight_name};
use features::{FeatureLayer, parameter};

/// Added to the length of a pixel's features before they are divided by it.
const LENGTH_EPSILON: f64 = 1e-10;
/// Subtracted from red, green and blue in [-1, 1].
const SHIFT: [f32; CHANNELS] = [-0.030, -0.088, -0.188];
/// What red, green and blue are divided by after that.
const SCALE: [f32; CHANNELS] = [0.458, 0.448, 0.450];

/// How LPIPS is taken, for `metric_settings`.
pub const LPIPS_RULE: &str = "version 0.1 with its linear weights; sRGB in [0, 1], rounded to 8 bits, \
     scaled to [-1, 1], at the views' own size; pixels that don't count are black in both pictures; \
     the mean over views is null if one has none";

/// LPIPS with one network and its weights.
///
/// It measures and does not train: the derivative of a length is NaN where all features are zero.
#[derive(Module, Debug)]
pub struct Lpips {
    layers: Vec<FeatureLayer>,
    /// Of each compared layer the weight of each channel, `[1, C, 1, 1]`.
    linear: Vec<Param<Tensor<4>>>,
    #[module(skip)]
    network: Network,
}

impl Lpips {
    /// Reads the weights from the files, which together must hold every tensor of
    /// [`Network::expected_tensors`] once. What else they hold, such as torchvision's
    /// `classifier`, is not read.
    ///
    /// Safetensors and PyTorch's files are understood, the latter as the zip archive that it
    /// writes since version 1.6 and as the older pickle stream: torchvision's `vgg16-397923af.pth` and LPIPS's own
    /// `weights/v0.1/*.pth` are such streams. The names may be
    /// torchvision's (`features.0.weight`) and LPIPS's (`lin0.model.1.weight`), or those of a whole
    /// saved LPIPS (`net.slice1.0.weight`, `lins.0.model.1.weight`).
    ///
    /// # Errors
    /// [`Error`] with the file and tensor, what was expected and what was found.
    pub fn load(network: Network, files: &[PathBuf], device: &Device) -> Result<Self, Error> {
        Ok(Self::new(network, weights::read(network, files)?, device))
    }

    /// Looks whether [`Lpips::load`] would find every tensor in the right shape, without reading a
    /// value.
    ///
    /// # Errors
    /// As [`Lpips::load`].
    pub fn check(network: Network, files: &[PathBuf]) -> Result<(), Error> {
        weights::check(network, files)
    }

    /// LPIPS with these tensors, which must be those of [`Network::expected_tensors`].
    fn new(network: Network, mut tensors: BTreeMap<String, HostTensor>, device: &Device) -> Self {
        let mut take = |name: String| {
            tensors
                .remove(&name)
                .unwrap_or_else(|| panic!("lpips: no tensor `{name}`"))
        };
        let layers = network.layers().iter().map(|table| {
            let weight = take(weight_name(table.index));
            FeatureLayer::new(table, weight, take(bias_name(table.index)), device)
        });
        let layers = layers.collect();
        let linear = (0..network.compared_channels().count())
            .map(|index| parameter(take(linear_name(index)), device))
            .collect();
        Self {
            layers,
            linear,
            network,
        }
    }

    /// The network whose features are compared.
    pub fn network(&self) -> Network {
        self.network
    }

    /// The distance of two pictures: 0 for the same, growing with what an observer would see.
    ///
    /// # Shapes
    /// `a, b [H, W, 3]`, sRGB values in [0, 1].
    ///
    /// # Errors
    /// When the pictures are smaller than [`Network::min_side_px`], or the device fails.
    ///
    /// # Panics
    /// When their sizes are not `width x height`.
    pub fn distance(
        &self,
        a: &[f32],
        b: &[f32],
        width: usize,
        height: usize,
    ) -> Result<f64, Error> {
        for picture in [a, b] {
            assert_eq!(
                picture.len(),
                width * height * CHANNELS,
                "lpips: a picture is not {width} x {height}"
            );
        }
        let min = self.network.min_side_px();
        if width < min || height < min {
            return Err(Error::PictureTooSmall {
                network: self.network,
                min,
                width,
                height,
            });
        }
        let device = self.linear[0].val().device();
        let mut features = [a, b].map(|picture| to_input(picture, [height, width], &device));
        let mut linear = self.linear.iter();
        let mut distance = 0.0;
        for layer in &self.layers {
            features = features.map(|features| layer.forward(features));
            if layer.compared {
                let weights = linear.next().expect("one for each compared layer");
                let [a, b] = features.clone().map(unit_length);
                let difference = a - b;
                let per_pixel = (difference.clone() * difference * weights.val()).sum_dim(1);
                distance += mean(per_pixel)?;
            }
        }
        Ok(distance)
    }
}

/// A picture as the networks take it: `[H, W, 3]` in [0, 1] -> `[1, 3, H, W]`, scaled as LPIPS does.
fn to_input(picture: &[f32], [height, width]: [usize; 2], device: &Device) -> Tensor<4> {
    let channel = |index: usize| {
        let values = picture.iter().skip(index).step_by(CHANNELS);
        values.map(move |v| (2.0 * v - 1.0 - SHIFT[index]) / SCALE[index])
    };
    let values: Vec<f32> = (0..CHANNELS).flat_map(channel).collect();
    Tensor::from_data(
        TensorData::new(values, [1, CHANNELS, height, width]),
        device,
    )
}

/// Every pixel's features `[1, C, H, W]` divided by their length.
fn unit_length(features: Tensor<4>) -> Tensor<4> {
    let length = (features.clone() * features.clone()).sum_dim(1).sqrt();
    features / (length + LENGTH_EPSILON)
}

/// The mean over the pixels, kept in f64 on the host.
fn mean(per_pixel: Tensor<4>) -> Result<f64, Error> {
    let values = per_pixel
        .into_data()
        .try_into_vec::<f32>()
        .map_err(|e| Error::DeviceFault(format!("{e:?}")))?;
    let sum: f64 = values.iter().map(|&v| f64::from(v)).sum();
    Ok(sum / values.len() as f64)
}
