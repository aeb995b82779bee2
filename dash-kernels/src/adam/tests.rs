use burn::tensor::Tensor;

use super::{AdamStep, Parameter, Stop, adam_step, adam_steps, cpu, reference, typical_gradient};
use crate::testing::*;

/// No multiple of a group, and more than a parallel piece.
const N: usize = (1 << 15) + 37;

struct State {
    param: Vec<f32>,
    first: Vec<f32>,
    second: Vec<f32>,
}

impl State {
    fn zero(param: Vec<f32>) -> Self {
        let zeros = vec![0.0; param.len()];
        Self {
            first: zeros.clone(),
            second: zeros,
            param,
        }
    }

    fn step(&mut self, grad: &[f32], settings: &AdamStep) {
        cpu::adam_step(
            &mut self.param,
            grad,
            &mut self.first,
            &mut self.second,
            settings,
        );
    }
}

#[test]
fn two_steps_by_hand() {
    let mut settings = AdamStep {
        learning_rate: 0.1,
        beta1: 0.5,
        beta2: 0.75,
        epsilon: 0.5,
        ..AdamStep::default()
    };
    let mut state = State::zero(vec![1.0]);
    // m = 1, v = 1, unbiased 2 and 4: the step is 0.1 * 2 / 2.5.
    state.step(&[2.0], &settings);
    assert_close("param", &to_f64(&state.param), &[0.92], 0.0, 1e-6);
    assert_close("first moment", &to_f64(&state.first), &[1.0], 0.0, 1e-6);
    assert_close("second moment", &to_f64(&state.second), &[1.0], 0.0, 1e-6);
    // m = 0.5 - 0.5, v = 0.75 + 0.25.
    settings.step = 2;
    state.step(&[-1.0], &settings);
    assert_close("param", &to_f64(&state.param), &[0.92], 0.0, 1e-6);
    assert_close("first moment", &to_f64(&state.first), &[0.0], 1e-7, 0.0);
    assert_close("second moment", &to_f64(&state.second), &[1.0], 0.0, 1e-6);
}

#[test]
fn backends_match_the_reference() {
    for device in devices() {
        let mut rng = rng(1);
        let start = uniform(&mut rng, N, -1.0, 1.0);
        let tensor = |values: &[f32]| tensor(values, [N], &device);
        let (mut param, mut first, mut second) =
            (tensor(&start), tensor(&vec![0.0; N]), tensor(&vec![0.0; N]));
        let (mut param64, mut first64, mut second64) = (to_f64(&start), vec![0.0; N], vec![0.0; N]);
        for step in 1..=5 {
            let settings = AdamStep {
                step,
                learning_rate: 0.01,
                ..AdamStep::default()
            };
            let grad = uniform(&mut rng, N, -1.0, 1.0);
            (param, first, second) =
                adam_step(param, tensor(&grad), first, second, &settings).expect("equal shapes");
            let grad = to_f64(&grad);
            reference::adam_step(&mut param64, &grad, &mut first64, &mut second64, &settings);
        }
        assert_agrees("param", &values(param), &param64);
        assert_agrees("first moment", &values(first), &first64);
        assert_agrees("second moment", &values(second), &second64);
    }
}

#[test]
fn tensors_that_others_hold_are_not_written_to() {
    for device in devices() {
        let param = tensor(&[1.0, 2.0, 3.0], [3], &device);
        let zeros = Tensor::<1>::zeros([3], &device);
        let grad = tensor(&[1.0, -1.0, 0.5], [3], &device);
        let (new, first, _) = adam_step(
            param.clone(),
            grad.clone(),
            zeros.clone(),
            zeros.clone(),
            &AdamStep::default(),
        )
        .expect("equal shapes");
        assert_eq!(values(param), [1.0, 2.0, 3.0]);
        assert_eq!(values(zeros), [0.0; 3]);
        assert!((values(new)[0] - 0.999).abs() < 1e-6);
        assert!((values(first)[1] + 0.1).abs() < 1e-6);
    }
}

#[test]
fn a_first_step_has_the_learning_rate_whatever_the_gradient() {
    let settings = AdamStep {
        learning_rate: 0.25,
        ..AdamStep::default()
    };
    for exponent in -38..=38 {
        let g = 10f32.powi(exponent);
        let mut state = State::zero(vec![0.0]);
        state.step(&[g], &settings);
        let got = -f64::from(state.param[0]);
        // Epsilon damps gradients near and below it; from there on squares underflow unseen.
        let expected = 0.25 * f64::from(g) / (f64::from(g) + 1e-15);
        assert_close("step", &[got], &[expected], 0.25e-3, 1e-3);
        assert!(state.second[0].is_finite());
    }
}

#[test]
fn huge_gradients_neither_freeze_nor_poison() {
    let settings = AdamStep {
        learning_rate: 0.1,
        ..AdamStep::default()
    };
    let mut state = State::zero(vec![0.0]);
    for step in 1..=50 {
        state.step(&[f32::MAX], &AdamStep { step, ..settings });
    }
    assert_close("param", &to_f64(&state.param), &[-5.0], 0.0, 1e-3);
}

#[test]
fn non_finite_gradients_leave_their_elements_alone() {
    let grad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1.0];
    let mut state = State::zero(vec![7.0; 4]);
    state.step(&grad, &AdamStep::default());
    assert_eq!(state.param[..3], [7.0; 3]);
    assert_eq!(state.first[..3], [0.0; 3]);
    assert!(state.param[3] < 7.0);
}

#[test]
fn zero_gradients_drift_unless_skipped() {
    let mut settings = AdamStep {
        step: 3,
        ..AdamStep::default()
    };
    for skip in [false, true] {
        settings.skip_zero_grad = skip;
        // A whole group of zeros, a group with one other, and a remainder.
        for touched in [None, Some(3)] {
            let mut state = State::zero(vec![1.0; 21]);
            state.first.fill(0.5);
            state.second.fill(0.25);
            let mut grad = vec![0.0; 21];
            if let Some(i) = touched {
                grad[i] = 1.0;
            }
            state.step(&grad, &settings);
            for i in 0..21 {
                let moved = !skip || Some(i) == touched;
                assert_eq!(state.param[i] != 1.0, moved, "element {i}");
                assert_eq!(state.first[i] != 0.5, moved, "element {i}");
                assert_eq!(state.second[i] != 0.25, moved, "element {i}");
            }
        }
    }
}

#[test]
fn zero_everything_stays_zero_without_epsilon() {
    let settings = AdamStep {
        epsilon: 0.0,
        ..AdamStep::default()
    };
    let mut state = State::zero(vec![0.0; 3]);
    state.step(&[0.0; 3], &settings);
    assert_eq!(state.param, [0.0; 3]);
}

#[test]
fn no_elements() {
    for device in devices() {
        let empty = || Tensor::<2>::zeros([0, 3], &device);
        let (param, ..) = adam_step(empty(), empty(), empty(), empty(), &AdamStep::default())
            .expect("equal shapes");
        assert_eq!(param.dims(), [0, 3]);
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let mut rng = rng(4);
    let start = uniform(&mut rng, N, -1.0, 1.0);
    let grad = uniform(&mut rng, N, -1.0, 1.0);
    let run = || {
        let mut state = State::zero(start.clone());
        state.step(&grad, &AdamStep::default());
        bits(&state.param)
    };
    let one = with_threads(1, run);
    assert_eq!(one, with_threads(2, run));
    assert_eq!(one, with_threads(8, run));
}

#[test]
fn wrong_shapes_and_settings_are_refused() {
    for device in devices() {
        let zeros = |n| Tensor::<1>::zeros([n], &device);
        let step = |grad, settings: AdamStep| {
            adam_step(zeros(3), zeros(grad), zeros(3), zeros(3), &settings)
        };
        let good = AdamStep::default();
        assert!(step(3, good).is_ok());
        assert!(step(2, good).is_err());
        for bad in [
            AdamStep {
                learning_rate: f64::NAN,
                ..good
            },
            AdamStep {
                learning_rate: -1.0,
                ..good
            },
            AdamStep { beta1: 1.0, ..good },
            AdamStep {
                beta2: -0.1,
                ..good
            },
            AdamStep {
                epsilon: f64::INFINITY,
                ..good
            },
            AdamStep { step: 0, ..good },
        ] {
            assert!(step(3, bad).is_err(), "{bad:?}");
        }
    }
}

#[test]
fn a_raised_flag_stops_the_step_and_damping_is_added_to_epsilon() {
    let settings = AdamStep {
        learning_rate: 0.1,
        epsilon: 0.25,
        step: 3,
        ..AdamStep::default()
    };
    for device in devices() {
        let mut rng = rng(11);
        let [start, grad, first] = [(); 3].map(|()| uniform(&mut rng, 100, -1.0, 1.0));
        let second = uniform(&mut rng, 100, 0.0, 1.0);
        let step = |at: usize, damping: f32| {
            let stop = Stop {
                flags: tensor(&[1.0, 0.0, 0.5], [3], &device),
                at,
            };
            let [start, grad, first, second] =
                [&start, &grad, &first, &second].map(|v| tensor(v, [100], &device));
            let parameter = Parameter {
                param: start,
                grad,
                first_moment: first,
                second_moment: second,
                settings,
                damping: Some(tensor(&[damping], [1], &device)),
            };
            let stepped = adam_steps(vec![parameter], Some(&stop)).expect("fits");
            let (param, first, second) = stepped.into_iter().next().expect("one");
            [values(param), values(first), values(second)]
        };
        let before = [start.clone(), first.clone(), second.clone()];
        assert_eq!(step(0, 0.5), before);
        assert_eq!(step(2, 0.5), before);
        for (damping, epsilon) in [(0.0, 0.25), (0.5, 0.75), (f32::NAN, 0.25), (-1.0, 0.25)] {
            let mut expected = before.each_ref().map(|values| to_f64(values));
            let [param, first, second] = &mut expected;
            let settings = AdamStep {
                epsilon,
                ..settings
            };
            reference::adam_step(param, &to_f64(&grad), first, second, &settings);
            for (found, expected) in step(1, damping).iter().zip(&expected) {
                assert_agrees(&format!("{device:?}, damping {damping}"), found, expected);
            }
        }
    }
}

/// More than a launch takes, of other lengths, rates and ages, some with a damping.
#[test]
fn many_parameters_are_stepped_like_each_by_itself() {
    for device in devices() {
        let mut rng = rng(21);
        let (mut parameters, mut expected) = (Vec::new(), Vec::new());
        for k in 0..19usize {
            let n = [1, 3, 64, 65, 1000][k % 5];
            let mut draw = |low| uniform(&mut rng, n, low, 1.0);
            let [param, grad, first] = [(); 3].map(|()| draw(-1.0));
            let second = draw(0.0);
            let damping = k.is_multiple_of(3).then_some(0.1 * k as f32);
            let settings = AdamStep {
                learning_rate: 0.01 * (k + 1) as f64,
                step: k as u64 + 1,
                ..AdamStep::default()
            };
            let mut state = [&param, &first, &second].map(|values| to_f64(values));
            let [p, f, s] = &mut state;
            let with_damping = AdamStep {
                epsilon: settings.epsilon + f64::from(damping.unwrap_or(0.0)),
                ..settings
            };
            reference::adam_step(p, &to_f64(&grad), f, s, &with_damping);
            expected.push(state);
            let place = |values: &[f32]| tensor(values, [n], &device);
            parameters.push(Parameter {
                param: place(&param),
                grad: place(&grad),
                first_moment: place(&first),
                second_moment: place(&second),
                settings,
                damping: damping.map(|damping| tensor(&[damping], [1], &device)),
            });
        }
        let found = adam_steps(parameters, None).expect("fits");
        assert_eq!(found.len(), expected.len());
        for (k, ((param, first, second), expected)) in found.into_iter().zip(expected).enumerate() {
            for (found, expected) in [param, first, second].into_iter().zip(&expected) {
                assert_agrees(&format!("{device:?}, {k}"), &values(found), expected);
            }
        }
        assert!(adam_steps(Vec::new(), None).expect("nothing").is_empty());
    }
}

#[test]
fn conditions_of_other_shapes_are_refused() {
    for device in devices() {
        let zeros = |n: usize| Tensor::<1>::zeros([n], &device);
        let fits = |n_flags: usize, at: usize, n_damping: usize| {
            let stop = Stop {
                flags: zeros(n_flags),
                at,
            };
            let parameter = Parameter {
                param: zeros(2),
                grad: zeros(2),
                first_moment: zeros(2),
                second_moment: zeros(2),
                settings: AdamStep::default(),
                damping: Some(zeros(n_damping)),
            };
            adam_steps(vec![parameter], Some(&stop)).is_ok()
        };
        assert!(fits(2, 1, 1) && !fits(1, 1, 1) && !fits(2, 1, 2) && !fits(2, 1, 0));
    }
}

#[test]
fn the_typical_gradient_is_that_of_elements_that_have_one() {
    for device in devices() {
        for n in [1, 50, N] {
            let mut squares = uniform(&mut rng(12), n, 0.0, 1e-6);
            squares.iter_mut().step_by(3).for_each(|v| *v = 0.0);
            let found = typical_gradient(tensor(&squares, [n], &device), 0.02);
            let expected = reference::typical_gradient(&to_f64(&squares), 0.02);
            let found = to_f64(&values(found));
            assert_close(&format!("{device:?}, {n}"), &found, &[expected], 0.0, 1e-5);
        }
        let nothing = typical_gradient(Tensor::zeros([0], &device), 1.0);
        assert_eq!(values(nothing), [0.0]);
    }
}
