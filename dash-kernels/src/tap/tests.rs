use burn::tensor::Tensor;

use super::tap;
use crate::counts;
use crate::testing::{devices, tensor, values};

#[test]
fn a_leaf_has_the_gradient_of_what_it_taps_and_nothing_changes() {
    for device in devices() {
        let device = device.autodiff();
        for is_tracked in [true, false] {
            let start = tensor(&[1.0, -2.0, 3.0, 0.5], [2, 2], &device);
            let start = start.set_require_grad(is_tracked);
            let leaf = Tensor::<2>::empty([1, 1], &device).require_grad();
            let middle = start.clone() * 2.0;
            let (tapped, asked) = counts::of(|| tap(middle, leaf.clone()));
            assert_eq!((asked.launches(), asked.reads), (0, 0));
            let doubled = tapped.clone().powi_scalar(2) + tapped.clone();
            let gradients = doubled.sum().backward();
            assert_eq!(values(tapped.inner()), [2.0, -4.0, 6.0, 1.0]);
            let of_leaf = leaf.grad(&gradients).expect("tracked");
            assert_eq!(of_leaf.dims(), [2, 2]);
            assert_eq!(values(of_leaf), [5.0, -7.0, 13.0, 3.0]);
            let of_start = start.grad(&gradients).map(values);
            let expected = is_tracked.then(|| vec![10.0, -14.0, 26.0, 6.0]);
            assert_eq!(of_start, expected, "{device:?}");
        }
    }
}
