use burn::tensor::{Device, Tensor};

use super::{MlpLayout, cpu, mlp, reference};
use crate::testing::{
    assert_agrees, assert_close, assert_same_for_any_thread_count, central_differences, devices,
    random, tensor, to_f64, values,
};

/// One layer and several, widths on both sides of what is summed side by side.
const FORMS: [&[usize]; 6] = [
    &[1, 1],
    &[3, 16],
    &[17, 5, 1],
    &[16, 64, 64, 10],
    &[32, 33, 15, 48, 7],
    &[6, 130, 200],
];

fn layout(widths: &[usize]) -> MlpLayout {
    MlpLayout::new(widths).expect("good widths")
}

/// Input, parameters (as large as keeps sums near one) and the output's gradient.
fn example(widths: &[usize], n: usize) -> [Vec<f32>; 3] {
    let layout = layout(widths);
    let mut parameters = random(2, layout.n_parameters());
    for layer in layout.layers() {
        let share = (layer.n_inputs as f32).sqrt().recip();
        for weight in &mut parameters[layer.first..layer.first_bias()] {
            *weight *= share;
        }
    }
    [
        random(1, n * layout.n_inputs()),
        parameters,
        random(3, n * layout.n_outputs()),
    ]
}

/// The output and both gradients on a device.
fn on(
    device: &Device,
    [input, parameters, v_out]: &[Vec<f32>; 3],
    widths: &[usize],
) -> [Vec<f32>; 3] {
    let layout = layout(widths);
    let n = v_out.len() / layout.n_outputs();
    let device = device.clone().autodiff();
    let input = tensor(input, [n, layout.n_inputs()], &device).require_grad();
    let parameters = tensor(parameters, [parameters.len()], &device).require_grad();
    let out = mlp(input.clone(), parameters.clone(), &layout).expect("fits");
    let found = values(out.clone().inner());
    let v_out = tensor(v_out, [n, layout.n_outputs()], &device);
    let grads = (out * v_out).sum().backward();
    [
        found,
        values(input.grad(&grads).expect("tracked")),
        values(parameters.grad(&grads).expect("tracked")),
    ]
}

#[test]
fn by_hand() {
    // Two inputs, two hidden units of which the second is off, one output.
    let parameters = [1.0, 2.0, 3.0, -4.0, 0.5, 0.25, 10.0, 100.0, -1.0];
    let input = [0.5, 2.0];
    // 0.5 + 6 + 0.5 = 7; 1 - 8 + 0.25 < 0.
    let expected = [69.0];
    let v_input = [10.0, 30.0];
    let v_parameters = [5.0, 0.0, 20.0, 0.0, 10.0, 0.0, 7.0, 0.0, 1.0];
    let widths = [2, 2, 1];
    let (wide, layout) = (to_f64(&parameters), layout(&widths));
    assert_eq!(reference::mlp(&to_f64(&input), &wide, &layout), expected);
    let (v_x, v_p) = reference::mlp_vjp(&to_f64(&input), &wide, &[1.0], &layout);
    assert_eq!(
        (v_x.as_slice(), v_p.as_slice()),
        (
            &v_input.map(f64::from)[..],
            &v_parameters.map(f64::from)[..]
        )
    );
    for device in devices() {
        let all = [input.to_vec(), parameters.to_vec(), vec![1.0]];
        let [out, v_x, v_p] = on(&device, &all, &widths);
        let got = (out.as_slice(), v_x.as_slice(), v_p.as_slice());
        assert_eq!(
            got,
            (&[69.0][..], &v_input[..], &v_parameters[..]),
            "{device:?}"
        );
    }
}

#[test]
fn reference_vjp_matches_central_differences() {
    let widths = [3, 5, 4, 2];
    let layout = layout(&widths);
    let [input, parameters, v_out] = example(&widths, 3).map(|values| to_f64(&values));
    let loss = |input: &[f64], parameters: &[f64]| {
        let out = reference::mlp(input, parameters, &layout);
        out.iter().zip(&v_out).map(|(out, v)| out * v).sum()
    };
    let (v_input, v_parameters) = reference::mlp_vjp(&input, &parameters, &v_out, &layout);
    let expected = central_differences(&input, 1e-6, |at| loss(at, &parameters));
    assert_close("input", &v_input, &expected, 1e-8, 1e-7);
    let expected = central_differences(&parameters, 1e-6, |at| loss(&input, at));
    assert_close("parameters", &v_parameters, &expected, 1e-8, 1e-7);
}

#[test]
fn backends_match_the_reference() {
    for device in devices() {
        for widths in FORMS {
            for n in [1, 7, 64, 1_500] {
                let name = format!("{device:?}, {widths:?}, {n} rows");
                let all = example(widths, n);
                let [input, parameters, v_out] = all.each_ref().map(|values| to_f64(values));
                let layout = layout(widths);
                let expected = reference::mlp(&input, &parameters, &layout);
                let (v_input, v_parameters) =
                    reference::mlp_vjp(&input, &parameters, &v_out, &layout);
                let found = on(&device, &all, widths);
                assert_close(&name, &to_f64(&found[0]), &expected, 3e-6, 3e-6);
                assert_agrees(&format!("{name}, input"), &found[1], &v_input);
                assert_agrees(&format!("{name}, parameters"), &found[2], &v_parameters);
            }
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let widths = [16, 64, 10];
    let layout = layout(&widths);
    let [input, parameters, v_out] = example(&widths, 40_000);
    assert_same_for_any_thread_count("output", || cpu::mlp(&input, &parameters, &layout));
    for index in 0..2 {
        assert_same_for_any_thread_count("gradient", || {
            let mut both = cpu::mlp_vjp(&input, &parameters, &v_out, &layout, [true; 2]);
            both[index].take().expect("asked for")
        });
    }
}

#[test]
fn only_what_is_asked_for_is_computed_and_has_the_same_bits() {
    let widths = [16, 33, 10];
    let layout = layout(&widths);
    let [input, parameters, v_out] = example(&widths, 700);
    let vjp = |needed| cpu::mlp_vjp(&input, &parameters, &v_out, &layout, needed);
    let [v_input, v_parameters] = vjp([true; 2]);
    assert_eq!(vjp([true, false]), [v_input, None]);
    assert_eq!(vjp([false, true]), [None, v_parameters]);
    assert_eq!(vjp([false; 2]), [None, None]);
}

#[test]
fn what_is_not_finite_counts_as_zero() {
    for device in devices() {
        // 1e30 * 1e30 is more than f32 holds: the hidden unit is off, the other goes on.
        let widths = [2, 2, 1];
        let parameters = vec![1e30, f32::NAN, 0.0, 2.0, 0.0, 1.0, 5.0, 3.0, f32::INFINITY];
        let all = [vec![1e30, 4.0], parameters, vec![1.0]];
        let [out, v_input, _] = on(&device, &all, &widths);
        assert_eq!((out, v_input), (vec![27.0], vec![0.0, 6.0]), "{device:?}");
        let lost = [vec![f32::NAN, 4.0], all[1].clone(), vec![f32::NEG_INFINITY]];
        let [out, v_input, v_parameters] = on(&device, &lost, &widths);
        assert_eq!((out, v_input), (vec![27.0], vec![0.0; 2]), "{device:?}");
        assert_eq!(v_parameters, vec![0.0; 9], "{device:?}");
    }
}

#[test]
fn strided_and_empty_tensors_are_read_and_other_shapes_refused() {
    let widths = [9, 4];
    let layout = layout(&widths);
    let [input, parameters, _] = example(&widths, 5);
    for device in devices() {
        let weights = tensor(&parameters, [parameters.len()], &device);
        let plain = tensor(&input, [5, 9], &device);
        let strided = tensor(&values(plain.clone().transpose()), [9, 5], &device).transpose();
        let network = |input| mlp(input, weights.clone(), &layout);
        let [plain, strided] = [plain, strided].map(|t| values(network(t).expect("nine wide")));
        assert_eq!(plain, strided);
        let empty = network(Tensor::zeros([0, 9], &device)).expect("nine wide");
        assert_eq!(empty.dims(), [0, 4]);
        assert!(network(Tensor::zeros([5, 8], &device)).is_err());
        let short = Tensor::zeros([parameters.len() - 1], &device);
        assert!(mlp(Tensor::zeros([5, 9], &device), short, &layout).is_err());
    }
    for widths in [&[][..], &[3], &[3, 0, 2]] {
        assert!(MlpLayout::new(widths).is_err(), "{widths:?}");
    }
}
