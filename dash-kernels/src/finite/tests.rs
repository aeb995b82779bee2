use burn::tensor::{Device, Tensor};

use super::all_finite;
use crate::testing::{devices, normals, poison, rng, tensor, to_f32};

/// On both sides of a vector's, a unit's and a piece's length.
const LENGTHS: [usize; 7] = [1, 15, 17, 4097, 65_536, 65_537, 200_003];

#[test]
fn only_what_is_not_finite_is_told_and_only_of_its_tensor() {
    for device in devices() {
        let (mut tensors, mut expected) = (Vec::new(), Vec::new());
        for (seed, n) in LENGTHS.into_iter().enumerate() {
            let good = to_f32(&normals(&mut rng(seed as u64), n));
            for (place, value) in
                [0, n / 2, n - 1]
                    .into_iter()
                    .zip([f32::NAN, f32::INFINITY, f32::NEG_INFINITY])
            {
                let mut bad = good.clone();
                bad[place] = value;
                tensors.push(tensor(&bad, [n], &device));
                tensors.push(tensor(&good, [n], &device));
                expected.extend([false, true]);
            }
        }
        // As many as a launch takes, and one more or less.
        for n in [0, 1, 5, 6, 7, 12, 13, tensors.len()] {
            let found = all_finite(&tensors[..n]);
            assert_eq!(found, expected[..n], "{device:?}, {n} tensors");
        }
    }
}

/// Sums of these overflow, their products with zero are NaN on some compilers: neither matters.
#[test]
fn huge_and_denormal_values_are_finite() {
    for device in devices() {
        let values: Vec<f32> = poison().into_iter().chain([f32::MAX; 2]).collect();
        let fill = |value: &f32| tensor(&[*value; 300], [300], &device);
        let tensors: Vec<_> = values.iter().map(fill).collect();
        let expected: Vec<bool> = values.iter().map(|value| value.is_finite()).collect();
        assert_eq!(all_finite(&tensors), expected, "{device:?}");
    }
}

#[test]
fn empty_and_strided_tensors_are_looked_through() {
    let empty = |device: &Device| Tensor::<1>::zeros([0], device);
    for device in devices() {
        let matrix = |values: [f32; 6]| tensor(&values, [2, 3], &device);
        // Its first column, of which row-major memory has the first and the fourth value.
        let column = |values| matrix(values).narrow(1, 0, 1).squeeze_dim::<1>(1);
        let tensors = [
            empty(&device),
            column([0.0, 1.0, 2.0, f32::NAN, 4.0, 5.0]),
            empty(&device),
            column([0.0, f32::NAN, 2.0, 3.0, 4.0, 5.0]),
        ];
        let found = all_finite(&tensors);
        assert_eq!(found, [true, false, true, true], "{device:?}");
        assert_eq!(all_finite(&tensors[..1]), [true], "{device:?}");
    }
}
