//! The frame that is fitted.

use burn::tensor::{Tensor, TensorData};
use dash_model::HashEncoder;
use glam::Vec3;

use crate::train::core::Run;
use crate::train::paper::Dash;

/// See the module.
pub(super) struct Present {
    /// Its place among the training times.
    pub(super) place: usize,
    /// Its first step, and the step after its last.
    pub(super) steps: [usize; 2],
    /// Where the Gaussians were in the frame before.
    pub(super) from: Vec<Vec3>,
    /// Where they are expected, relative to their means.
    pub(super) expected: Vec<Vec3>,
    /// 1 for Gaussians that may move, 0 for those that stay where they were.
    pub(super) moves: Vec<f32>,
    /// The three on the device, where they were asked for since rows changed: `from` in the unit cube.
    pub(super) on_device: Option<[Tensor<2>; 3]>,
    pub(super) offsets: HashEncoder,
}

impl Present {
    /// `from [N, 3]` in the unit cube, `expected [N, 3]` and `moves [N, 1]`.
    pub(super) fn on_device(&mut self, run: &Run<Dash>) -> &[Tensor<2>; 3] {
        let n = self.from.len();
        let tensor = |values: Vec<f32>, width: usize| {
            Tensor::<2>::from_data(TensorData::new(values, [n, width]), &run.device)
        };
        let flat = |values: &[Vec3]| values.iter().flat_map(Vec3::to_array).collect();
        self.on_device.get_or_insert_with(|| {
            [
                run.region.normalize(tensor(flat(&self.from), 3)),
                tensor(flat(&self.expected), 3),
                tensor(self.moves.clone(), 1),
            ]
        })
    }
}
