//! Small fully connected networks.

use dash_kernels::mlp::{MlpLayout, mlp, reference};

use super::{
    Bench, Errors, Measurement, Op, Pass, Target, generator, gradient, time, to_f64, uniform,
    values,
};
use crate::Error;
use crate::numbers::standard_normal;

/// The decoder of the 4D field with its heads, as `quick` has it.
const WIDTHS: [usize; 4] = [16, 64, 64, 10];

pub(super) fn measure(bench: &mut Bench, target: Target, n: usize) -> Result<(), Error> {
    let layout = MlpLayout::new(&WIDTHS)?;
    let mut rng = generator(13);
    let input: Vec<f32> = (0..n * layout.n_inputs())
        .map(|_| standard_normal::<f32>(&mut rng))
        .collect();
    let parameters: Vec<f32> = (0..layout.n_parameters())
        .map(|_| 0.2 * standard_normal::<f32>(&mut rng))
        .collect();
    let cotangent = uniform(&mut rng, n * layout.n_outputs(), -1.0, 1.0);
    let wide = [&input, &parameters, &cotangent].map(|values| to_f64(values));
    let (input_shape, output_shape) = ([n, layout.n_inputs()], [n, layout.n_outputs()]);

    let expected = reference::mlp(&wide[0], &wide[1], &layout);
    let rows = target.tensor(&input, input_shape);
    let weights = target.tensor(&parameters, [parameters.len()]);
    let got = values(mlp(rows.clone(), weights.clone(), &layout)?)?;
    let timing = time(Some(target.device), || {
        drop(mlp(rows.clone(), weights.clone(), &layout)?);
        Ok(())
    })?;
    bench.add(Measurement {
        error: Errors::of(&got, &expected),
        time: Some(timing),
        ..target.measurement(Op::Mlp, "f32", Pass::Forward, n)
    });

    let (v_input, v_parameters) = reference::mlp_vjp(&wide[0], &wide[1], &wide[2], &layout);
    let cotangent = target.constant(&cotangent, output_shape);
    let rows = target.leaf(&input, input_shape);
    let weights = target.leaf(&parameters, [parameters.len()]);
    let both = || {
        let out = mlp(rows.clone(), weights.clone(), &layout)?;
        Ok::<_, Error>((out * cotangent.clone()).sum().backward())
    };
    let gradients = both()?;
    let mut errors = Errors::default();
    errors.add(&gradient(&rows, &gradients)?, &v_input);
    errors.add(&gradient(&weights, &gradients)?, &v_parameters);
    let timing = time(Some(target.device), || both().map(drop))?;
    bench.add(Measurement {
        error: errors.stats(),
        time: Some(timing),
        ..target.measurement(Op::Mlp, "f32", Pass::Gradient, n)
    });
    Ok(())
}
