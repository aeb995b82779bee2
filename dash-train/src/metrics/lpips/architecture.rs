//! The two feature networks as tables: which convolutions and poolings they have, where LPIPS
//! looks at them, and the tensors that a weight file must hold for them.

use std::fmt;

/// Values of one convolution of a feature network, with the pooling in front of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LayerTable {
    /// Its index among torchvision's `features`, which its tensors are named by.
    pub index: usize,
    /// Max pooling in front of it: window and stride in pixels.
    pub pool: Option<[usize; 2]>,
    /// Channels in.
    pub channels_in: usize,
    /// Channels out.
    pub channels_out: usize,
    /// Side of the square kernel in pixels.
    pub kernel: usize,
    /// Stride in pixels.
    pub stride: usize,
    /// Zeros around the picture, in pixels.
    pub padding: usize,
    /// Whether LPIPS compares what comes out of the ReLU behind it.
    pub compared: bool,
}

/// A network whose features LPIPS compares.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Network {
    /// torchvision's `vgg16`, compared after relu1_2, relu2_2, relu3_3, relu4_3 and relu5_3.
    Vgg16,
    /// torchvision's `alexnet`, compared after relu1 to relu5.
    AlexNet,
}

/// A tensor that a weight file must hold.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExpectedTensor {
    /// Its name: torchvision's for the features, that of LPIPS's own weight files for the others.
    pub name: String,
    /// Its sizes, outermost first.
    pub shape: Vec<usize>,
}

impl Network {
    /// The convolutions, first to last, each with a ReLU behind it.
    pub fn layers(self) -> &'static [LayerTable] {
        match self {
            Self::Vgg16 => &VGG16,
            Self::AlexNet => &ALEXNET,
        }
    }

    /// Channels of the features that are compared, first to last.
    pub fn compared_channels(self) -> impl Iterator<Item = usize> {
        let layers = self.layers().iter();
        layers
            .filter(|layer| layer.compared)
            .map(|layer| layer.channels_out)
    }

    /// The smallest width and height in pixels of which every layer is left with a pixel.
    ///
    /// # Source
    /// From the last layer back: a window of `k` pixels with stride `s` and padding `p` makes `n`
    /// pixels of `(n - 1) s + k - 2 p`.
    pub fn min_side_px(self) -> usize {
        self.layers().iter().rev().fold(1, |needed, layer| {
            let conv = ((needed - 1) * layer.stride + layer.kernel)
                .saturating_sub(2 * layer.padding)
                .max(1);
            match layer.pool {
                Some([window, stride]) => (conv - 1) * stride + window,
                None => conv,
            }
        })
    }

    /// Every tensor that a set of weight files must hold: the features', then LPIPS's own.
    pub fn expected_tensors(self) -> Vec<ExpectedTensor> {
        let features = self.layers().iter().flat_map(|layer| {
            let LayerTable {
                index,
                channels_in,
                channels_out,
                kernel,
                ..
            } = *layer;
            [
                ExpectedTensor {
                    name: weight_name(index),
                    shape: vec![channels_out, channels_in, kernel, kernel],
                },
                ExpectedTensor {
                    name: bias_name(index),
                    shape: vec![channels_out],
                },
            ]
        });
        let linear = self.compared_channels().enumerate();
        let linear = linear.map(|(index, channels)| ExpectedTensor {
            name: linear_name(index),
            shape: vec![1, channels, 1, 1],
        });
        features.chain(linear).collect()
    }
}

impl fmt::Display for Network {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Vgg16 => "VGG16",
            Self::AlexNet => "AlexNet",
        })
    }
}

/// Name of the kernel of the convolution at `index` of `features`.
pub(super) fn weight_name(index: usize) -> String {
    format!("features.{index}.weight")
}

/// Name of the bias of the convolution at `index` of `features`.
pub(super) fn bias_name(index: usize) -> String {
    format!("features.{index}.bias")
}

/// Name of the weights of the `index`th compared layer's channels.
pub(super) fn linear_name(index: usize) -> String {
    format!("lin{index}.model.1.weight")
}

/// A convolution of VGG16: 3x3 pixels, one pixel of padding.
const fn vgg(index: usize, channels_in: usize, channels_out: usize) -> LayerTable {
    LayerTable {
        index,
        pool: None,
        channels_in,
        channels_out,
        kernel: 3,
        stride: 1,
        padding: 1,
        compared: false,
    }
}

const fn pooled(pool: [usize; 2], layer: LayerTable) -> LayerTable {
    LayerTable {
        pool: Some(pool),
        ..layer
    }
}

const fn compared(layer: LayerTable) -> LayerTable {
    LayerTable {
        compared: true,
        ..layer
    }
}

/// Simonyan and Zisserman 2014, configuration D; the pooling at its end is left out.
const VGG16: [LayerTable; 13] = [
    vgg(0, 3, 64),
    compared(vgg(2, 64, 64)),
    pooled([2, 2], vgg(5, 64, 128)),
    compared(vgg(7, 128, 128)),
    pooled([2, 2], vgg(10, 128, 256)),
    vgg(12, 256, 256),
    compared(vgg(14, 256, 256)),
    pooled([2, 2], vgg(17, 256, 512)),
    vgg(19, 512, 512),
    compared(vgg(21, 512, 512)),
    pooled([2, 2], vgg(24, 512, 512)),
    vgg(26, 512, 512),
    compared(vgg(28, 512, 512)),
];

/// Krizhevsky 2014, as torchvision has it; the pooling at its end is left out.
const ALEXNET: [LayerTable; 5] = [
    compared(LayerTable {
        kernel: 11,
        stride: 4,
        padding: 2,
        ..vgg(0, 3, 64)
    }),
    compared(pooled(
        [3, 2],
        LayerTable {
            kernel: 5,
            padding: 2,
            ..vgg(3, 64, 192)
        },
    )),
    compared(pooled([3, 2], vgg(6, 192, 384))),
    compared(vgg(8, 384, 256)),
    compared(vgg(10, 256, 256)),
];
