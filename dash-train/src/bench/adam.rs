//! One step of Adam.

use std::cell::Cell;

use dash_kernels::adam::{AdamStep, adam_step, reference};

use super::{
    Bench, Errors, Measurement, Op, Pass, Target, generator, time, to_f64, uniform, values,
};
use crate::Error;

const NOTE: &str = "parameter and both moments after one step from moments that are not zero";

pub(super) fn measure(bench: &mut Bench, target: Target, n: usize) -> Result<(), Error> {
    let mut rng = generator(8);
    let param = uniform(&mut rng, n, -1.0, 1.0);
    let grad = uniform(&mut rng, n, -1e-2, 1e-2);
    let first = uniform(&mut rng, n, -1e-2, 1e-2);
    let second = uniform(&mut rng, n, 0.0, 1e-4);
    let settings = AdamStep {
        step: 100,
        ..AdamStep::default()
    };
    let [mut param64, mut first64, mut second64] = [&param, &first, &second].map(|v| to_f64(v));
    reference::adam_step(
        &mut param64,
        &to_f64(&grad),
        &mut first64,
        &mut second64,
        &settings,
    );
    let start = || [&param, &first, &second].map(|values| target.tensor(values, [n]));
    let grad = target.tensor(&grad, [n]);
    let [p, m, v] = start();
    let (p, m, v) = adam_step(p, grad.clone(), m, v, &settings)?;
    let mut errors = Errors::default();
    errors.add(&values(p)?, &param64);
    errors.add(&values(m)?, &first64);
    errors.add(&values(v)?, &second64);
    let [p, m, v] = start();
    // Steps in place, as the optimiser takes them.
    let state = Cell::new(Some((p, m, v)));
    let timing = time(Some(target.device), || {
        let (p, m, v) = state.take().unwrap_or_else(|| {
            let [p, m, v] = start();
            (p, m, v)
        });
        state.set(Some(adam_step(p, grad.clone(), m, v, &settings)?));
        Ok(())
    })?;
    bench.add(Measurement {
        error: errors.stats(),
        time: Some(timing),
        note: Some(NOTE.into()),
        ..target.measurement(Op::Adam, "f32", Pass::Forward, n)
    });
    Ok(())
}
