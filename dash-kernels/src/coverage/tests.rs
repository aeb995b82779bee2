use burn::tensor::{Device, Tensor};
use rand::Rng;

use super::{FloaterWeights, PictureSize, cpu, floater_cost, reference, visible_motion};
use crate::Camera;
use crate::splats::*;
use crate::testing::{
    DIFFERENCES_RELATIVE, assert_agrees, assert_close, assert_same_for_any_thread_count,
    central_differences, devices, normals, poison, rng, tensor, to_f32, to_f64, uniform, values,
};

const FAR: f32 = 0.05;
const NEARNESS: FloaterWeights = FloaterWeights {
    opacity: 0.0,
    nearness: 1.0,
};
/// Nearness alone, opacity alone, both.
const WEIGHTS: [FloaterWeights; 3] = [
    NEARNESS,
    FloaterWeights {
        opacity: 0.7,
        nearness: 0.0,
    },
    FloaterWeights {
        opacity: 0.3,
        nearness: 2.0,
    },
];

fn camera() -> Camera {
    Camera::from_fov_x(1.2, 160, 90)
}

/// Splats at and beside the picture, some not drawn; a tenth of them ten times as near as the others.
fn splats(seed: u64, n: usize) -> Vec<f32> {
    let mut rng = rng(seed);
    let mut rows = Vec::new();
    for k in 0..n {
        let mut row = [0.0f32; N_COLUMNS];
        let variance = [0, 1].map(|_| rng.random_range(0.5f32..400.0));
        let mix = rng.random_range(-0.9f32..0.9);
        let b = mix * (variance[0] * variance[1]).sqrt();
        let det = variance[0] * variance[1] - b * b;
        row[MEAN_X] = rng.random_range(-20.0..180.0);
        row[MEAN_Y] = rng.random_range(-20.0..110.0);
        row[CONIC_A] = variance[1] / det;
        row[CONIC_B] = -b / det;
        row[CONIC_C] = variance[0] / det;
        row[OPACITY] = rng.random_range(0.01..0.99);
        row[DEPTH] = rng.random_range(2.0..6.0) * if k % 10 == 3 { 0.1 } else { 1.0 };
        row[RADIUS_X] = 3.0 * variance[0].sqrt();
        row[RADIUS_Y] = 3.0 * variance[1].sqrt();
        match k % 17 {
            5 => row[RADIUS_X] = 0.0,
            7 => row[DEPTH] = -1.0,
            _ => {}
        }
        rows.extend(row);
    }
    rows
}

fn motions(seed: u64, n: usize) -> Vec<f32> {
    let mut rng = rng(seed);
    let still = |k: usize, v: f32| if k.is_multiple_of(3) { 0.0 } else { v };
    let values = uniform(&mut rng, n, 0.0, 2.0);
    values
        .into_iter()
        .enumerate()
        .map(|(k, v)| still(k, v))
        .collect()
}

/// A cost and its gradient on a device.
fn on_device(
    leaf: &[f32],
    device: &Device,
    cost: impl Fn(Tensor<1>, &Device) -> Tensor<1>,
) -> (f32, Vec<f32>) {
    let device = device.clone().autodiff();
    let leaf = tensor(leaf, [leaf.len()], &device).require_grad();
    let cost = cost(leaf.clone(), &device);
    let grads = (cost.clone() * 2.0).backward();
    let gradient = values(leaf.grad(&grads).expect("tracked"));
    let halved = gradient.iter().map(|v| 0.5 * v).collect();
    (values(cost.inner())[0], halved)
}

#[test]
fn reference_gradients_match_central_differences() {
    let picture = PictureSize::of(&camera());
    let (n, splats) = (24, to_f64(&splats(1, 24)));
    let extents = to_f64(&uniform(&mut rng(2), n, 0.1, 2.0));
    let far = f64::from(FAR);
    let (_, gradient) = reference::visible_motion(&extents, &splats, picture, far);
    let expected = central_differences(&extents, 1e-6, |extents| {
        reference::visible_motion(extents, &splats, picture, far).0
    });
    assert_close("extents", &gradient, &expected, 1e-9, DIFFERENCES_RELATIVE);
    let (logits, motion) = (normals(&mut rng(3), n), to_f64(&motions(4, n)));
    for weights in WEIGHTS {
        let (cost, gradient) = reference::floater_cost(&logits, &splats, &motion, picture, weights);
        let expected = central_differences(&logits, 1e-5, |logits| {
            reference::floater_cost(logits, &splats, &motion, picture, weights).0
        });
        assert!(cost > 0.0);
        assert_close("logits", &gradient, &expected, 1e-9, DIFFERENCES_RELATIVE);
    }
}

#[test]
fn backends_match_the_reference() {
    let picture = PictureSize::of(&camera());
    for device in devices() {
        // The last are more than all cubes have units.
        for (seed, n) in [(1, 1), (2, 40), (3, 5_000), (4, 20_000)] {
            let name = format!("{device:?}, {n} rows");
            let rows = splats(seed, n);
            let (extents, motion) = (motions(seed + 10, n), motions(seed + 20, n));
            let logits = to_f32(&normals(&mut rng(seed + 30), n));
            let wide = to_f64(&rows);

            let found = on_device(&extents, &device, |extents, device| {
                let splats = tensor(&rows, [n, N_COLUMNS], device);
                visible_motion(extents, splats, &camera(), FAR).expect("fits")
            });
            let expected =
                reference::visible_motion(&to_f64(&extents), &wide, picture, f64::from(FAR));
            assert_close(&name, &[f64::from(found.0)], &[expected.0], 1e-9, 1e-5);
            assert_agrees(&name, &found.1, &expected.1);

            for weights in WEIGHTS {
                let found = on_device(&logits, &device, |logits, device| {
                    let splats = tensor(&rows, [n, N_COLUMNS], device);
                    let motion = Some(tensor(&motion, [n], device));
                    floater_cost(logits, splats, motion, &camera(), weights).expect("fits")
                });
                let (logits, motion) = (to_f64(&logits), to_f64(&motion));
                let expected = reference::floater_cost(&logits, &wide, &motion, picture, weights);
                assert_close(&name, &[f64::from(found.0)], &[expected.0], 1e-9, 1e-5);
                assert_agrees(&name, &found.1, &expected.1);
            }
        }
    }
}

#[test]
fn what_moves_pays_less_for_being_near() {
    let (n, rows) = (200, splats(5, 200));
    for device in devices() {
        let splats = || tensor(&rows, [n, N_COLUMNS], &device);
        let cost = |motion: Option<f32>| {
            let motion = motion.map(|by| Tensor::full([n], by, &device));
            let logits = Tensor::zeros([n], &device);
            values(floater_cost(logits, splats(), motion, &camera(), NEARNESS).expect("fits"))[0]
        };
        let (resting, still, moving) = (cost(None), cost(Some(0.0)), cost(Some(0.1)));
        assert_eq!(resting, still);
        assert!(moving > 0.0 && moving < 0.2 * resting, "{moving} {resting}");
    }
}

/// One Gaussian at fault counts nothing, and takes nothing from the others.
#[test]
fn whatever_is_in_a_row_costs_and_slopes_are_finite() {
    let n = 60;
    for device in devices() {
        for column in 0..N_COLUMNS {
            for poison in poison() {
                let mut rows = splats(6, n);
                rows[7 * N_COLUMNS + column] = poison;
                let (mut extents, mut logits) = (motions(7, n), vec![0.3; n]);
                (extents[9], logits[9]) = (poison.abs(), poison);
                let splats = |device: &Device| tensor(&rows, [n, N_COLUMNS], device);
                let moved = on_device(&extents, &device, |extents, device| {
                    visible_motion(extents, splats(device), &camera(), FAR).expect("fits")
                });
                let near = on_device(&logits, &device, |logits, device| {
                    let motion = Some(tensor(&extents, [n], device));
                    let weights = WEIGHTS[2];
                    floater_cost(logits, splats(device), motion, &camera(), weights).expect("fits")
                });
                for (name, (cost, slopes)) in [("moved", moved), ("near", near)] {
                    let name = format!("{device:?}, {name}, column {column}, {poison}");
                    assert!(cost.is_finite(), "{name}: {cost}");
                    assert!(slopes.iter().all(|v| v.is_finite()), "{name}");
                }
            }
        }
    }
}

#[test]
fn nothing_drawn_costs_nothing() {
    for device in devices() {
        let splats = Tensor::zeros([3, N_COLUMNS], &device);
        let numbers = || Tensor::ones([3], &device);
        let near = floater_cost(numbers(), splats.clone(), None, &camera(), NEARNESS);
        let near = near.expect("fits");
        let moved = visible_motion(numbers(), splats, &camera(), FAR).expect("fits");
        assert_eq!([values(near), values(moved)], [[0.0], [0.0]]);
        let none = || Tensor::<1>::zeros([0], &device);
        let no_splats = Tensor::zeros([0, N_COLUMNS], &device);
        let near = floater_cost(none(), no_splats.clone(), None, &camera(), WEIGHTS[2]);
        let near = near.expect("fits");
        let moved = visible_motion(none(), no_splats, &camera(), FAR).expect("fits");
        assert_eq!([values(near), values(moved)], [[0.0], [0.0]]);
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let (n, picture) = (20_000, PictureSize::of(&camera()));
    let (rows, extents, logits) = (splats(8, n), motions(9, n), vec![0.1; n]);
    let all = |(cost, slopes): (f32, Vec<f32>)| [vec![cost], slopes].concat();
    assert_same_for_any_thread_count("moved", || {
        all(cpu::visible_motion(&extents, &rows, picture, FAR))
    });
    assert_same_for_any_thread_count("near", || {
        let motion = Some(&*extents);
        all(cpu::floater_cost(
            &logits, &rows, motion, picture, WEIGHTS[2],
        ))
    });
}

#[test]
fn other_shapes_and_distances_are_refused() {
    for device in devices() {
        let rows = |n: usize| Tensor::<2>::zeros([n, N_COLUMNS], &device);
        let numbers = |n: usize| Tensor::<1>::zeros([n], &device);
        let camera = camera();
        assert!(visible_motion(numbers(2), rows(3), &camera, FAR).is_err());
        let near = |n, motion| floater_cost(numbers(n), rows(3), motion, &camera, NEARNESS);
        assert!(near(2, None).is_err() && near(3, Some(numbers(2))).is_err());
        assert!(near(3, Some(numbers(3))).is_ok());
        for far in [0.0, -1.0, f32::NAN] {
            assert!(visible_motion(numbers(3), rows(3), &camera, far).is_err());
        }
    }
}
