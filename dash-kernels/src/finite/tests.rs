use burn::tensor::{Device, Tensor};

use super::{RAISED, Searched, all_finite, raise_flags};
use crate::testing::{devices, normals, poison, rng, tensor, to_f32, values};

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
        for n in [0, 1, 5, 6, 7, 23, 24, 25, tensors.len()] {
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

/// Flags outlive a step: a second look adds to what the first has found.
#[test]
fn rows_are_marked_and_flags_stay_raised() {
    const MARKS: usize = 12;
    const ROWS: usize = 1_000;
    for device in devices() {
        let search = |broken: &[(usize, usize)]| -> Vec<Searched> {
            (0..8)
                .map(|k| {
                    let width = k + 1;
                    let mut rows = vec![0.5; ROWS * width];
                    for &(_, row) in broken.iter().filter(|(tensor, _)| *tensor == k) {
                        rows[row * width + k / 2] = f32::NAN;
                    }
                    Searched {
                        values: tensor(&rows, [ROWS * width], &device),
                        flag: 2 + k,
                        // The fourth has no marks.
                        marks: (k != 3).then_some((MARKS, width)),
                        copy: None,
                    }
                })
                .collect()
        };
        let flags = Tensor::<1>::zeros([MARKS + ROWS], &device);
        let found = raise_flags(flags, &search(&[]), 0).expect("fits");
        assert!(values(found.clone()).iter().all(|&flag| flag == 0.0));
        let first = search(&[(0, 0), (7, 999), (3, 500)]);
        let found = raise_flags(found, &first, 0).expect("fits");
        let found = raise_flags(found, &search(&[(2, 17)]), 1).expect("fits");
        let found = values(found);
        let raised: Vec<usize> = (0..found.len()).filter(|&k| found[k] == RAISED).collect();
        // Two steps; tensors 0, 2, 3 and 7; rows 0, 17 and 999.
        let expected = [0, 1, 2, 4, 5, 9, MARKS, MARKS + 17, MARKS + 999];
        assert_eq!(raised, expected, "{device:?}");
    }
}

#[test]
fn first_values_are_copied_beside_the_flags() {
    for device in devices() {
        // More tensors than a launch takes.
        let searched: Vec<Searched> = (0..30)
            .map(|k| Searched {
                values: tensor(&[k as f32 + 0.5, 1.0], [2], &device),
                flag: 1,
                marks: None,
                copy: (k % 2 == 0).then_some(2 + k),
            })
            .collect();
        let found = raise_flags(Tensor::zeros([40], &device), &searched, 0).expect("fits");
        let expected: Vec<f32> = (0..40)
            .map(|place| match place {
                2..32 if place % 2 == 0 => place as f32 - 1.5,
                _ => 0.0,
            })
            .collect();
        assert_eq!(values(found), expected, "{device:?}");
        let lost = Searched {
            values: tensor(&[f32::INFINITY], [1], &device),
            flag: 0,
            marks: None,
            copy: Some(1),
        };
        let found = raise_flags(Tensor::zeros([2], &device), &[lost], 0).expect("fits");
        assert_eq!(values(found), [RAISED, f32::INFINITY], "{device:?}");
    }
}

#[test]
fn flags_and_marks_that_are_not_there_are_refused() {
    for device in devices() {
        let zeros = |n: usize| Tensor::<1>::zeros([n], &device);
        let raise_with = |n: usize, marks, any: usize, flag: usize, copy: Option<usize>| {
            let values = zeros(6);
            let searched = [Searched {
                values,
                flag,
                marks,
                copy,
            }];
            raise_flags(zeros(n), &searched, any).is_ok()
        };
        let raise = |n, marks, any, flag| raise_with(n, marks, any, flag, None);
        assert!(raise_with(4, None, 0, 1, Some(3)) && !raise_with(3, None, 0, 1, Some(3)));
        assert!(raise(2, None, 0, 1) && !raise(1, None, 0, 1) && !raise(2, None, 2, 0));
        assert!(raise(5, Some((2, 2)), 0, 1) && !raise(4, Some((2, 2)), 0, 1));
    }
}
