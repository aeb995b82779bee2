//! The losses of Eqs. 6 and 12.

use burn::tensor::{Tensor, TensorData};

/// Image and target `[H, W, C]`, both black where `counted [H * W]` is zero: what is there changes
/// neither the loss nor any gradient.
pub(crate) fn where_counted(
    image: Tensor<3>,
    target: Tensor<3>,
    counted: Vec<f32>,
) -> (Tensor<3>, Tensor<3>) {
    let [height, width, _] = image.dims();
    let counted = TensorData::new(counted, [height, width, 1]);
    let counted = Tensor::<3>::from_data(counted, &image.device());
    (image * counted.clone(), target * counted)
}

/// Mean over all values of the absolute error of `image [H, W, C + E]` against `target [H, W, C]`, times `weights
/// [H * W]`.
pub(crate) fn weighted_error(image: Tensor<3>, target: Tensor<3>, weights: Vec<f32>) -> Tensor<1> {
    let [height, width, channels] = target.dims();
    let weights = TensorData::new(weights, [height, width, 1]);
    let weights = Tensor::<3>::from_data(weights, &image.device());
    ((image.narrow(2, 0, channels) - target).abs() * weights).mean()
}

/// Eq. 5: mean motion of the static Gaussians, in units of the space's diagonal.
/// `extents [N]`; zero when none is static.
pub(crate) fn static_motion(extents: Tensor<1>, is_static: &[bool], diagonal: f32) -> Tensor<1> {
    let count = is_static.iter().filter(|s| **s).count().max(1);
    let weight = 1.0 / (count as f32 * diagonal);
    let weights: Vec<f32> = is_static
        .iter()
        .map(|&s| if s { weight } else { 0.0 })
        .collect();
    let n = weights.len();
    let weights = Tensor::<1>::from_data(TensorData::new(weights, [n]), &extents.device());
    (extents * weights).sum()
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use dash_kernels::photometric::photometric;

    use super::*;
    use crate::train::core::to_host;

    #[test]
    fn weighted_errors_are_means_over_all_values() {
        let device = Device::flex().autodiff();
        let tensor = |values: &[f32], channels: usize| -> Tensor<3> {
            Tensor::from_data(TensorData::new(values.to_vec(), [1, 2, channels]), &device)
        };
        // The last channel is not looked at.
        let image = tensor(&[0.1, 0.2, 9.0, 0.3, 0.9, 9.0], 3).require_grad();
        let target = tensor(&[0.3, 0.2, 0.2, 0.4], 2);
        let error = weighted_error(image.clone(), target, vec![0.0, 2.0]);
        let gradient = image.grad(&error.backward()).expect("tracked");
        assert!((to_host(error)[0] - 2.0 * (0.1 + 0.5) / 4.0).abs() < 1e-6);
        assert_eq!(to_host(gradient), [0.0, 0.0, 0.0, 0.5, 0.5, 0.0]);
    }

    #[test]
    fn what_does_not_count_changes_neither_loss_nor_gradient() {
        const SIDE: usize = 16;
        let device = Device::flex().autodiff();
        let counted: Vec<f32> = (0..SIDE * SIDE)
            .map(|pixel| f32::from(u8::from(pixel % SIDE < 6)))
            .collect();
        let picture = |seed: usize, outside: f32| -> Tensor<3> {
            let values: Vec<f32> = (0..SIDE * SIDE * 3)
                .map(|i| match counted[i / 3] > 0.0 {
                    true => ((i * 37 + seed * 11) % 101) as f32 / 101.0,
                    false => outside,
                })
                .collect();
            Tensor::from_data(TensorData::new(values, [SIDE, SIDE, 3]), &device)
        };
        let judge = |outside: [f32; 2]| {
            let image = picture(1, outside[0]).require_grad();
            let (a, b) = where_counted(image.clone(), picture(2, outside[1]), counted.clone());
            let loss = photometric(a, b, 0.2).expect("equal sizes").loss;
            let gradient = image.grad(&loss.backward()).expect("tracked");
            (to_host(loss), to_host(gradient))
        };
        let (loss, gradient) = judge([0.2, 0.9]);
        assert!(loss[0] > 0.0);
        assert_eq!((loss, gradient.clone()), judge([0.7, 0.1]));
        for (i, v) in gradient.iter().enumerate() {
            assert_eq!(*v != 0.0, counted[i / 3] > 0.0, "value {i}: {v}");
        }
    }
}
