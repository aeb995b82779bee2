use burn::module::Param;

use super::*;

#[derive(Module, Debug)]
struct Weights {
    values: Param<Tensor<1>>,
}

/// Where three steps along the same gradient lead.
fn after_steps(gradient: [f32; 3], damping: f32) -> Vec<f32> {
    let device = Device::flex().autodiff();
    let mut module = Weights {
        values: Param::from_data(TensorData::new(vec![0.0f32; 3], [3]), &device),
    };
    let mut optimizer = Optimizer::default();
    for _ in 0..3 {
        let slope = Tensor::<1>::from_data(gradient, &device);
        let loss = (module.values.val() * slope).sum();
        let rate = Rate {
            damping,
            ..Rate::plain(0.1)
        };
        module = optimizer.step("", module, &mut loss.backward(), |_| rate);
    }
    to_host(module.values.val())
}

#[test]
fn a_step_of_a_mean_over_views_forgets_as_much_as_a_step_for_each() {
    let device = Device::flex();
    let of = |values: &[f32]| upload(values.to_vec(), &device);
    let gradient = || of(&[0.5, -2.0, 0.0]);
    let one = Rate::plain(0.1);
    let (mut value, mut moments) = (of(&[1.0; 3]), Moments::of(&of(&[0.0; 3])));
    for _ in 0..4 {
        (value, moments) = moments.step(value, gradient(), one, None);
    }
    let fresh = Moments::of(&value);
    let (at_once, of_four) = fresh.step(of(&[1.0; 3]), gradient(), one.of_views(4), None);
    for (a, b) in [
        (moments.first, of_four.first),
        (moments.second, of_four.second),
    ] {
        for (a, b) in to_host(a).into_iter().zip(to_host(b)) {
            assert!((a - b).abs() <= 1e-5 * a.abs(), "{a} {b}");
        }
    }
    // Twice the rate, against the sign.
    let steps: Vec<f32> = to_host(at_once).iter().map(|value| value - 1.0).collect();
    for (step, expected) in steps.into_iter().zip([-0.2, 0.2, 0.0]) {
        assert!((step - expected).abs() < 1e-5, "{step} {expected}");
    }
}

#[test]
fn rows_added_to_none_start_anew() {
    let device = Device::flex();
    let mut optimizer = Optimizer::default();
    for (name, n) in [("a.empty", 0), ("b.other", 3)] {
        let zeros = || upload(vec![0.0; n], &device);
        let moments = Moments {
            first: zeros(),
            second: zeros(),
            steps: 5,
        };
        optimizer.moments.insert(name.into(), moments);
    }
    optimizer.extend_rows("a.", 0, 4);
    optimizer.extend_rows("b.", 3, 4);
    assert!(!optimizer.moments.contains_key("a.empty"));
    assert_eq!(optimizer.moments["b.other"].first.dims(), [7]);
}

#[test]
fn damping_stills_what_hardly_matters_and_hardly_slows_the_rest() {
    let gradient = [1.0, 1e-4, 0.0];
    let plain = after_steps(gradient, 0.0);
    assert!(
        (plain[0] + 0.3).abs() < 1e-3 && (plain[1] + 0.3).abs() < 1e-3,
        "{plain:?}"
    );
    // The typical gradient, over the two that have one, is 0.707.
    let damped = after_steps(gradient, 1.0);
    assert!((damped[0] + 0.3 / 1.707).abs() < 1e-3, "{damped:?}");
    assert!((damped[1] + 0.3e-4 / 0.7072).abs() < 1e-6, "{damped:?}");
    assert_eq!((plain[2], damped[2]), (0.0, 0.0));
}

#[derive(Module, Debug)]
struct Pair {
    first: Param<Tensor<2>>,
    second: Param<Tensor<1>>,
}

/// Two modules, one of them with a parameter that has no gradient.
#[test]
fn what_is_taken_together_steps_as_each_by_itself() {
    let device = Device::flex().autodiff();
    let pair = |by: f32| Pair {
        first: Param::from_data(TensorData::new(vec![by; 6], [2, 3]), &device),
        second: Param::from_data(TensorData::new(vec![-by; 2], [2]), &device),
    };
    let loss = |a: &Pair, b: &Pair| {
        let of_first = (a.first.val() * b.first.val()).sum();
        of_first + b.second.val().powi_scalar(2).sum()
    };
    let values_of = |module: &Pair| {
        let first = to_host(module.first.val());
        [first, to_host(module.second.val())]
    };
    let rates = |name: &str| Rate {
        damping: if name.starts_with("b") { 0.5 } else { 0.0 },
        ..Rate::plain(if name.ends_with("first") { 0.1 } else { 0.2 })
    };
    let (mut a, mut b) = (pair(1.0), pair(2.0));
    let mut optimizer = Optimizer::default();
    let (mut c, mut d) = (a.clone(), b.clone());
    let mut other = Optimizer::default();
    for _ in 0..3 {
        let mut gradients = loss(&a, &b).backward();
        a = optimizer.take("a", a, &mut gradients, rates);
        b = optimizer.take("b", b, &mut gradients, rates);
        optimizer.step_taken();
        // In any order.
        b = optimizer.give_back(b);
        a = optimizer.give_back(a);
        let mut gradients = loss(&c, &d).backward();
        c = other.step("a", c, &mut gradients, rates);
        d = other.step("b", d, &mut gradients, rates);
    }
    assert_eq!(values_of(&a), values_of(&c));
    assert_eq!(values_of(&b), values_of(&d));
    // What has no gradient keeps its value, the others have moved.
    assert_eq!(values_of(&a)[1], [-1.0; 2]);
    assert!(values_of(&a)[0][0] < 1.0 && values_of(&b)[1][0] > -2.0);
    assert_eq!(a.first.dims(), [2, 3]);
}
