use burn::tensor::{Device, Tensor};

use super::{Columns, Ellipsoids, Path, deform, reference};
use crate::displacement;
use crate::testing::{assert_agrees, devices, normals, rng, tensor, to_f32, to_f64, values};

const FACTOR: f32 = 0.3;
const BASIS: [f32; 2] = [0.5, -2.0];

/// Every arrangement of columns that fields have, and their width.
const ARRANGED: [(Columns, usize); 4] = [
    (columns(Some(3), Some(7)), 10),
    (columns(None, Some(3)), 6),
    (columns(Some(3), None), 7),
    // Others follow.
    (columns(None, None), 9),
];

const fn columns(quats: Option<usize>, scales: Option<usize>) -> Columns {
    Columns {
        mean_factor: FACTOR,
        quats,
        scales,
    }
}

/// Means, quaternions, scales, trajectories and offsets.
fn inputs(n: usize, width: usize) -> [Vec<f32>; 5] {
    let mut rng = rng(n as u64);
    [3, 4, 3, 3 * BASIS.len(), width].map(|size| to_f32(&normals(&mut rng, n * size)))
}

/// What comes out, and gradients of the inputs of a weighted sum of it.
fn on_device(
    inputs: &[Vec<f32>; 5],
    weights: &[Vec<f32>; 3],
    columns: Columns,
    has_path: bool,
    device: &Device,
) -> ([Vec<f32>; 3], [Option<Vec<f32>>; 5]) {
    let device = device.clone().autodiff();
    let n = inputs[0].len() / 3;
    let leaf = |values: &Vec<f32>| -> Tensor<2> {
        tensor(values, [n, values.len() / n], &device).require_grad()
    };
    let [means, quats, scales, path, offsets] = inputs.each_ref().map(leaf);
    let canonical = Ellipsoids {
        means: means.clone(),
        quats: quats.clone(),
        scales: scales.clone(),
    };
    let given = has_path.then(|| Path {
        coefficients: path.clone(),
        basis: BASIS.to_vec(),
    });
    let deformed = deform(canonical, given, offsets.clone(), columns).expect("fits");
    let outputs = [deformed.means, deformed.quats, deformed.scales];
    let weigh = |(output, weights): (&Tensor<2>, &Vec<f32>)| {
        let weights: Tensor<2> = tensor(weights, output.dims(), &device);
        (output.clone() * weights).sum()
    };
    let weighed = outputs.iter().zip(weights).map(weigh);
    let sum = weighed.reduce(|a, b| a + b).expect("three");
    let gradients = sum.backward();
    let leaves = [means, quats, scales, path, offsets];
    (
        outputs.map(|output| values(output.inner())),
        leaves.map(|leaf| leaf.grad(&gradients).map(values)),
    )
}

#[test]
fn backends_match_the_reference() {
    for (arranged, width) in ARRANGED {
        for (n, has_path) in [(1, true), (70, false), (1_000, true)] {
            let inputs = inputs(n, width);
            let [means, quats, scales, path, offsets] = inputs.each_ref().map(|v| to_f64(v));
            let path = match has_path {
                true => displacement::reference::displacement(&path, &BASIS.map(f64::from)),
                false => vec![0.0; 3 * n],
            };
            let canonical = [&*means, &*quats, &*scales];
            let expected = reference::deform(canonical, &path, &offsets, width, arranged);
            let mut rng = rng(3);
            let weights = [3, 4, 3].map(|size| to_f32(&normals(&mut rng, n * size)));
            for device in devices() {
                let name = format!("{device:?}, {arranged:?}, {n}");
                let (outputs, gradients) =
                    on_device(&inputs, &weights, arranged, has_path, &device);
                for (output, expected) in outputs.iter().zip(&expected) {
                    assert_agrees(&name, output, expected);
                }
                // The operation is linear: gradients follow from the weights.
                let [v_means, v_quats, v_scales, v_path, v_offsets] = gradients;
                assert_eq!(v_means.as_ref(), Some(&weights[0]), "{name}");
                assert_eq!(v_quats.as_ref(), Some(&weights[1]), "{name}");
                assert_eq!(v_scales.as_ref(), Some(&weights[2]), "{name}");
                let along = |v: &[f32]| BASIS.map(|b| v.iter().map(|v| b * v).collect::<Vec<_>>());
                let rows = weights[0].chunks(3).flat_map(along).flatten();
                assert_eq!(v_path, has_path.then(|| rows.collect()), "{name}");
                let mut expected = vec![0.0; n * width];
                for i in 0..n {
                    let row = &mut expected[i * width..(i + 1) * width];
                    for k in 0..3 {
                        row[k] = FACTOR * weights[0][3 * i + k];
                    }
                    if let Some(first) = arranged.quats {
                        row[first..first + 4].copy_from_slice(&weights[1][4 * i..][..4]);
                    }
                    if let Some(first) = arranged.scales {
                        row[first..first + 3].copy_from_slice(&weights[2][3 * i..][..3]);
                    }
                }
                assert_eq!(v_offsets.as_ref(), Some(&expected), "{name}");
            }
        }
    }
}

/// An output that the loss does not depend on has no gradient to give.
#[test]
fn outputs_may_be_left_unused() {
    for device in devices() {
        let device = device.autodiff();
        let leaf = |values: &[f32]| -> Tensor<2> {
            tensor(values, [1, values.len()], &device).require_grad()
        };
        let offsets = leaf(&[0.0; 10]);
        let canonical = Ellipsoids {
            means: leaf(&[1.0, 2.0, 3.0]),
            quats: leaf(&[1.0, 0.0, 0.0, 0.0]),
            scales: leaf(&[0.5; 3]),
        };
        let (arranged, _) = ARRANGED[0];
        let deformed = deform(canonical, None, offsets.clone(), arranged).expect("fits");
        let gradients = (deformed.scales * 2.0).sum().backward();
        let found = values(offsets.grad(&gradients).expect("tracked"));
        assert_eq!(
            found,
            [[0.0; 7].as_slice(), &[2.0; 3]].concat(),
            "{device:?}"
        );
    }
}

#[test]
fn nothing_is_tracked_without_need_and_nothing_is_deformed_of_nothing() {
    for device in devices() {
        for n in [0, 3] {
            let ones = |width: usize| Tensor::<2>::ones([n, width], &device);
            let canonical = Ellipsoids {
                means: ones(3),
                quats: ones(4),
                scales: ones(3),
            };
            let (arranged, width) = ARRANGED[0];
            let deformed = deform(canonical, None, ones(width), arranged).expect("fits");
            assert_eq!(values(deformed.means), vec![1.0 + FACTOR; 3 * n]);
            assert_eq!(values(deformed.quats), vec![2.0; 4 * n]);
            assert_eq!(values(deformed.scales), vec![2.0; 3 * n]);
        }
    }
}

#[test]
fn other_shapes_are_refused() {
    for device in devices() {
        let fits = |sizes: [[usize; 2]; 5]| {
            let [means, quats, scales, path, offsets] =
                sizes.map(|size| Tensor::<2>::zeros(size, &device));
            let canonical = Ellipsoids {
                means,
                quats,
                scales,
            };
            let path = Path {
                coefficients: path,
                basis: BASIS.to_vec(),
            };
            deform(canonical, Some(path), offsets, ARRANGED[0].0).is_ok()
        };
        let good = [[2, 3], [2, 4], [2, 3], [2, 6], [2, 10]];
        assert!(fits(good));
        for k in 0..5 {
            for by in [[1, 0], [0, 1]] {
                let mut bad = good;
                bad[k] = [bad[k][0] - by[0], bad[k][1] - by[1]];
                assert!(!fits(bad), "{bad:?}");
            }
        }
    }
}
