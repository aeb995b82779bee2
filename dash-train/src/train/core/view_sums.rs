//! Sums over views, on the device: of one number for each Gaussian, and of the views that show it.

use burn::tensor::{Device, Int, Tensor, TensorData};
use dash_kernels::screen_gradients::{SUMS, add_screen_gradients};

use super::optimizer::to_host;
use crate::Error;

/// See the module.
#[derive(Debug, Clone, Default)]
pub struct ViewSums {
    /// Sums and numbers of views `[N, 2]`; `None` of no Gaussian.
    sums: Option<Tensor<2>>,
}

impl ViewSums {
    /// Nothing summed for `n` Gaussians.
    pub fn new(n: usize, device: &Device) -> Self {
        let device = device.clone().inner();
        Self {
            sums: (n > 0).then(|| Tensor::zeros([n, SUMS], &device)),
        }
    }

    /// Adds a view's numbers, and 1 beside each that counts: `[N, 2]`.
    pub fn add(&mut self, view: Tensor<2>) {
        if let Some(sums) = self.sums.take() {
            self.sums = Some(sums + view);
        }
    }

    /// Adds the sums of other views.
    pub fn merge(&mut self, more: Self) {
        if let Some(more) = more.sums {
            self.add(more);
        }
    }

    /// Adds the length of each visible Gaussian's gradient on the screen: of packed splats `[N, C]`, whose gradients begin at
    /// row `first` of `v_splats [M, C]`. `half_size` is half the image in pixels, which makes the gradient independent
    /// of it.
    ///
    /// # Errors
    /// When shapes differ.
    pub fn add_gradients(
        &mut self,
        v_splats: Tensor<2>,
        first: usize,
        splats: Tensor<2>,
        half_size: [f32; 2],
    ) -> Result<(), Error> {
        if let Some(sums) = self.sums.take() {
            self.sums = Some(add_screen_gradients(
                sums, v_splats, first, splats, half_size,
            )?);
        }
        Ok(())
    }

    /// The sums and the numbers of views, on the host.
    pub fn totals(&self) -> (Vec<f32>, Vec<f32>) {
        let sums = self.sums.clone().map(to_host).unwrap_or_default();
        let column = |k: usize| sums.iter().skip(k).step_by(SUMS).copied().collect();
        (column(0), column(1))
    }

    /// What [`ViewSums::totals`] gave.
    pub fn from_totals(sums: &[f32], views: &[f32], device: &Device) -> Self {
        let n = sums.len();
        let device = device.clone().inner();
        let rows = sums.iter().zip(views);
        let values: Vec<f32> = rows.flat_map(|(&sum, &views)| [sum, views]).collect();
        Self {
            sums: (n > 0).then(|| Tensor::from_data(TensorData::new(values, [n, SUMS]), &device)),
        }
    }

    /// Appends Gaussians of which nothing was summed.
    pub fn grow(&mut self, added: usize, device: &Device) {
        let more = Self::new(added, device).sums;
        self.sums = match (self.sums.take(), more) {
            (Some(sums), Some(more)) => Some(Tensor::cat(vec![sums, more], 0)),
            (sums, more) => sums.or(more),
        };
    }

    /// Follows a change of the rows.
    pub fn gather(&self, sources: &[usize]) -> Self {
        let rows: Vec<i64> = sources.iter().map(|&row| row as i64).collect();
        let n = rows.len();
        let sums = self.sums.clone().filter(|_| n > 0);
        Self {
            sums: sums.map(|sums| {
                let rows = Tensor::<1, Int>::from_data(TensorData::new(rows, [n]), &sums.device());
                sums.select(0, rows)
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_follow_the_rows() {
        for device in dash_kernels::testing::devices() {
            let view = |rows: [[f32; 2]; 3]| Tensor::from_floats(rows, &device);
            let mut sums = ViewSums::new(3, &device.clone().autodiff());
            sums.add(view([[0.5, 1.0], [0.0, 0.0], [2.0, 1.0]]));
            sums.add(view([[0.25, 1.0], [3.0, 1.0], [0.0, 0.0]]));
            assert_eq!(sums.totals(), (vec![0.75, 3.0, 2.0], vec![2.0, 1.0, 1.0]));
            let mut picked = sums.gather(&[2, 0, 0]);
            picked.grow(1, &device);
            let expected = (vec![2.0, 0.75, 0.75, 0.0], vec![1.0, 2.0, 2.0, 0.0]);
            assert_eq!(picked.totals(), expected);
            let again = ViewSums::from_totals(&expected.0, &expected.1, &device);
            assert_eq!(again.totals(), expected);
            let mut none = sums.gather(&[]);
            assert_eq!(none.totals(), (vec![], vec![]));
            none.grow(1, &device);
            assert_eq!(none.totals(), (vec![0.0], vec![0.0]));
        }
    }
}
