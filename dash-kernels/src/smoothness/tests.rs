use burn::tensor::Tensor;

use super::{reference, smoothness};
use crate::testing::{
    DIFFERENCES_RELATIVE, assert_agrees, assert_close, central_differences, devices, normals, rng,
    tensor, to_f32, to_f64, values,
};

/// Points, points beside, further rows, features.
const SIZES: [[usize; 4]; 4] = [
    [1, 1, 0, 1],
    [9, 4, 0, 3],
    [50, 50, 7, 8],
    [900, 700, 40, 32],
];

/// Different rows in no order.
fn rows(n: usize, m: usize) -> Vec<u32> {
    let step = (1..n)
        .find(|step| !n.is_multiple_of(*step) || *step == 1)
        .unwrap_or(1);
    (0..m).map(|k| ((k * step + n / 2) % n) as u32).collect()
}

#[test]
fn backends_match_the_reference() {
    for [n, m, r, width] in SIZES {
        let features = to_f32(&normals(&mut rng(5), (n + m + r) * width));
        let rows = rows(n, m);
        let wide = to_f64(&features);
        let expected = reference::smoothness(&wide, width, n, &rows);
        let weights = to_f32(&normals(&mut rng(6), (n + r) * width));
        for device in devices() {
            let name = format!("{device:?}, {n} and {m} and {r} x {width}");
            let device = device.autodiff();
            let leaf = tensor(&features, [n + m + r, width], &device).require_grad();
            let found = smoothness(leaf.clone(), n, &rows).expect("fits");
            let cost = f64::from(values(found.cost.clone().inner())[0]);
            assert_close(&name, &[cost], &[expected], 0.0, 1e-5);
            assert_eq!(values(found.own.clone().inner()), features[..n * width]);
            assert_eq!(found.others.is_some(), r > 0);
            let weigh = |part: Tensor<2>, weights: &[f32]| {
                let weights: Tensor<2> = tensor(weights, part.dims(), &device);
                (part * weights).sum()
            };
            let mut sum = found.cost * 3.0 + weigh(found.own, &weights[..n * width]);
            if let Some(others) = found.others {
                let last = &features[(n + m) * width..];
                assert_eq!(values(others.clone().inner()), last);
                sum = sum + weigh(others, &weights[n * width..]);
            }
            let gradient = values(leaf.grad(&sum.backward()).expect("tracked"));
            let mut v = vec![0.0; wide.len()];
            for (k, weight) in weights.iter().enumerate() {
                let place = if k < n * width { k } else { k + m * width };
                v[place] = f64::from(*weight);
            }
            for (k, &row) in rows.iter().enumerate() {
                for column in 0..width {
                    let (own, beside) = (row as usize * width + column, (n + k) * width + column);
                    let slope = 6.0 / m as f64 * (wide[own] - wide[beside]);
                    v[own] += slope;
                    v[beside] -= slope;
                }
            }
            assert_agrees(&name, &gradient, &v);
        }
    }
}

#[test]
fn the_gradient_is_that_of_the_reference() {
    let ([n, m, _, width], device) = (SIZES[1], burn::tensor::Device::flex().autodiff());
    let (features, rows) = (normals(&mut rng(7), (n + m) * width), rows(n, m));
    let expected = central_differences(&features, 1e-5, |features| {
        reference::smoothness(features, width, n, &rows)
    });
    let leaf = tensor(&to_f32(&features), [n + m, width], &device).require_grad();
    let cost = smoothness(leaf.clone(), n, &rows).expect("fits").cost;
    let gradient = to_f64(&values(leaf.grad(&cost.backward()).expect("tracked")));
    assert_close("features", &gradient, &expected, 1e-6, DIFFERENCES_RELATIVE);
}

#[test]
fn rows_that_are_not_there_or_twice_are_refused() {
    for device in devices() {
        let features = || Tensor::<2>::zeros([5, 2], &device);
        let fits = |n, rows: &[u32]| smoothness(features(), n, rows).is_ok();
        assert!(fits(3, &[0, 2]) && fits(3, &[1]));
        assert!(!fits(3, &[0, 3]) && !fits(3, &[1, 1]) && !fits(3, &[]) && !fits(4, &[0, 1]));
    }
}
