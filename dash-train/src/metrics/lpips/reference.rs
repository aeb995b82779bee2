//! The oracle of the tests: LPIPS in f64 and plain loops, from the networks as torchvision lists them. It shares
//! neither tables nor code with the implementation.

use std::collections::BTreeMap;

use dash_model::parameters::HostTensor;

use super::Network;

/// One entry of torchvision's `features`.
#[derive(Clone, Copy)]
enum Step {
    /// Channels out, side of the kernel, stride, padding.
    Conv(usize, usize, usize, usize),
    Relu,
    /// Window, stride.
    MaxPool(usize, usize),
}

/// Values by channel, row and column.
#[derive(Clone)]
struct Planes {
    channels: usize,
    height: usize,
    width: usize,
    values: Vec<f64>,
}

/// The distance of two pictures `[H, W, 3]` in [0, 1].
pub fn lpips(
    network: Network,
    tensors: &BTreeMap<String, HostTensor>,
    pictures: [&[f32]; 2],
    [height, width]: [usize; 2],
) -> f64 {
    let [a, b] = pictures.map(|picture| {
        let scaled = scaled(picture, height, width);
        features(network, tensors, scaled)
    });
    let layers = a.iter().zip(&b).enumerate();
    layers
        .map(|(layer, (a, b))| {
            let weights = &tensors[&format!("lin{layer}.model.1.weight")].values;
            mean_difference(a, b, weights)
        })
        .sum()
}

fn scaled(picture: &[f32], height: usize, width: usize) -> Planes {
    let shift = [-0.030, -0.088, -0.188];
    let scale = [0.458, 0.448, 0.450];
    let mut values = Vec::new();
    for channel in 0..3 {
        for pixel in 0..height * width {
            let value = f64::from(picture[pixel * 3 + channel]);
            values.push((value * 2.0 - 1.0 - shift[channel]) / scale[channel]);
        }
    }
    Planes {
        channels: 3,
        height,
        width,
        values,
    }
}

/// Where LPIPS looks, as indices of `features`, and the steps up to the last of them.
fn steps(network: Network) -> (Vec<Step>, [usize; 5]) {
    use Step::{Conv, MaxPool, Relu};
    match network {
        Network::Vgg16 => {
            let mut steps = Vec::new();
            for (block, (channels, convs)) in [(64, 2), (128, 2), (256, 3), (512, 3), (512, 3)]
                .into_iter()
                .enumerate()
            {
                if block > 0 {
                    steps.push(MaxPool(2, 2));
                }
                for _ in 0..convs {
                    steps.extend([Conv(channels, 3, 1, 1), Relu]);
                }
            }
            (steps, [3, 8, 15, 22, 29])
        }
        Network::AlexNet => (
            vec![
                Conv(64, 11, 4, 2),
                Relu,
                MaxPool(3, 2),
                Conv(192, 5, 1, 2),
                Relu,
                MaxPool(3, 2),
                Conv(384, 3, 1, 1),
                Relu,
                Conv(256, 3, 1, 1),
                Relu,
                Conv(256, 3, 1, 1),
                Relu,
            ],
            [1, 4, 7, 9, 11],
        ),
    }
}

fn features(
    network: Network,
    tensors: &BTreeMap<String, HostTensor>,
    mut planes: Planes,
) -> Vec<Planes> {
    let (steps, looked_at) = steps(network);
    let mut found = Vec::new();
    for (index, step) in steps.into_iter().enumerate() {
        planes = match step {
            Step::Conv(channels, kernel, stride, padding) => {
                let weight = &tensors[&format!("features.{index}.weight")].values;
                let bias = &tensors[&format!("features.{index}.bias")].values;
                conv(&planes, weight, bias, [channels, kernel, stride, padding])
            }
            Step::Relu => {
                planes.values.iter_mut().for_each(|v| *v = v.max(0.0));
                planes
            }
            Step::MaxPool(window, stride) => max_pool(&planes, window, stride),
        };
        if looked_at.contains(&index) {
            found.push(planes.clone());
        }
    }
    found
}

fn conv(
    input: &Planes,
    weight: &[f32],
    bias: &[f32],
    [channels, kernel, stride, padding]: [usize; 4],
) -> Planes {
    let height = (input.height + 2 * padding - kernel) / stride + 1;
    let width = (input.width + 2 * padding - kernel) / stride + 1;
    let mut values = Vec::with_capacity(channels * height * width);
    for out in 0..channels {
        let mut plane = vec![f64::from(bias[out]); height * width];
        for channel in 0..input.channels {
            let source = &input.values[channel * input.height * input.width..];
            for (tap, y0, x0) in (0..kernel * kernel).map(|tap| (tap, tap / kernel, tap % kernel)) {
                let w = weight[(out * input.channels + channel) * kernel * kernel + tap];
                let w = f64::from(w);
                for y in 0..height {
                    let row = y * stride + y0;
                    if row < padding || row >= padding + input.height {
                        continue;
                    }
                    let row = &source[(row - padding) * input.width..][..input.width];
                    for x in 0..width {
                        let column = x * stride + x0;
                        if column >= padding && column < padding + input.width {
                            plane[y * width + x] += w * row[column - padding];
                        }
                    }
                }
            }
        }
        values.extend(plane);
    }
    Planes {
        channels,
        height,
        width,
        values,
    }
}

fn max_pool(input: &Planes, window: usize, stride: usize) -> Planes {
    let height = (input.height - window) / stride + 1;
    let width = (input.width - window) / stride + 1;
    let mut values = Vec::with_capacity(input.channels * height * width);
    for plane in input.values.chunks_exact(input.height * input.width) {
        for y in 0..height {
            for x in 0..width {
                let mut most = f64::NEG_INFINITY;
                for row in y * stride..y * stride + window {
                    for column in x * stride..x * stride + window {
                        most = most.max(plane[row * input.width + column]);
                    }
                }
                values.push(most);
            }
        }
    }
    Planes {
        channels: input.channels,
        height,
        width,
        values,
    }
}

fn mean_difference(a: &Planes, b: &Planes, weights: &[f32]) -> f64 {
    let n_pixels = a.height * a.width;
    let length = |planes: &Planes, pixel: usize| {
        let squares = (0..planes.channels).map(|c| planes.values[c * n_pixels + pixel].powi(2));
        squares.sum::<f64>().sqrt() + 1e-10
    };
    let mut sum = 0.0;
    for pixel in 0..n_pixels {
        let (length_a, length_b) = (length(a, pixel), length(b, pixel));
        for (channel, &weight) in weights.iter().enumerate() {
            let at = channel * n_pixels + pixel;
            let difference = a.values[at] / length_a - b.values[at] / length_b;
            sum += f64::from(weight) * difference * difference;
        }
    }
    sum / n_pixels as f64
}
