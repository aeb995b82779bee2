use burn::tensor::Tensor;

use super::FiniteFlags;
use crate::testing::{devices, normals, poison, rng, tensor, to_f32};

/// On both sides of a vector's, a unit's and a piece's length.
const LENGTHS: [usize; 7] = [1, 15, 17, 4097, 65_536, 65_537, 200_003];

#[test]
fn only_what_is_not_finite_raises_a_flag_and_only_its_own() {
    for device in devices() {
        let mut flags = FiniteFlags::new(100, &device);
        let mut expected = Vec::new();
        for (seed, n) in LENGTHS.into_iter().enumerate() {
            let good = to_f32(&normals(&mut rng(seed as u64), n));
            for (place, value) in
                [0, n / 2, n - 1]
                    .into_iter()
                    .zip([f32::NAN, f32::INFINITY, f32::NEG_INFINITY])
            {
                let mut bad = good.clone();
                bad[place] = value;
                flags
                    .watch(tensor(&bad, [n, 1], &device))
                    .expect("there is room");
                flags
                    .watch(tensor(&good, [n], &device))
                    .expect("there is room");
                expected.extend([false, true]);
            }
        }
        assert_eq!(flags.read(), expected, "{device:?}");
    }
}

/// Sums of these overflow, their products with zero are NaN on some compilers: neither matters.
#[test]
fn huge_and_denormal_values_are_finite() {
    for device in devices() {
        for value in poison().into_iter().chain([f32::MAX; 2]) {
            let mut flags = FiniteFlags::new(1, &device);
            flags
                .watch(tensor(&[value; 300], [300], &device))
                .expect("there is room");
            assert_eq!(flags.read(), [value.is_finite()], "{device:?}: {value}");
        }
    }
}

#[test]
fn empty_and_strided_tensors_are_looked_through() {
    for device in devices() {
        let mut flags = FiniteFlags::new(2, &device);
        let strided = tensor(&[0.0, 1.0, f32::NAN, 3.0, 4.0, 5.0], [2, 3], &device).transpose();
        flags
            .watch(Tensor::<2>::zeros([0, 3], &device))
            .expect("there is room");
        flags.watch(strided.clone()).expect("there is room");
        assert!(flags.watch(strided).is_err(), "a third");
        assert_eq!(flags.read(), [true, false], "{device:?}");
    }
}
