//! Forms of one formula on the host: their time, their error, and the error along a sweep.

use super::{Bench, ErrorStats, Measurement, Pass, StiffnessPoint, time};

const HOST: &str = "host";
const NOTE: &str = "a plain function on one thread of the host, not a kernel";

/// The names of a formula and of one of its forms.
pub(super) struct Form {
    pub op: &'static str,
    pub variant: &'static str,
}

/// Times `compute` for each of the inputs, and adds it with its error.
pub(super) fn measure<I>(
    bench: &mut Bench,
    form: &Form,
    inputs: &[I],
    compute: impl Fn(&I) -> f32,
    error: ErrorStats,
) {
    let mut out = vec![0.0; inputs.len()];
    let timing = time(None, || {
        for (out, input) in out.iter_mut().zip(inputs) {
            *out = compute(input);
        }
        std::hint::black_box(&out);
        Ok(())
    });
    bench.add(Measurement {
        op: form.op.into(),
        backend: HOST.into(),
        variant: form.variant.into(),
        pass: Pass::Forward,
        size: inputs.len(),
        error,
        time: timing.ok(),
        asked: None,
        note: Some(NOTE.into()),
    });
}

/// Adds the error at one length of a sweep.
pub(super) fn stiff(
    bench: &mut Bench,
    form: &Form,
    sweep: &str,
    length_px: f64,
    error: ErrorStats,
) {
    bench.found.stiffness.push(StiffnessPoint {
        sweep: sweep.into(),
        value: length_px,
        logarithmic: true,
        op: form.op.into(),
        backend: HOST.into(),
        variant: form.variant.into(),
        error,
    });
}
