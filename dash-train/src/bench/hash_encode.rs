//! Hash encoding: linear and smoothstep weights, full and half tables.

use burn::tensor::f16;
use dash_kernels::hash_encode::{
    HashGridConfig, HashGridLayout, Interpolation, LevelSizing, hash_encode, reference,
};
use dash_kernels::set_deterministic;

use super::{
    Bench, Errors, Measurement, Op, Pass, Target, generator, gradient, time, to_f64, uniform,
    values,
};
use crate::Error;

const WEIGHTS: [(&str, Interpolation); 2] = [
    ("linear", Interpolation::Linear),
    ("smoothstep", Interpolation::Smoothstep),
];
/// Name of the variant with a table of half precision.
pub(super) const HALF_TABLE: &str = "linear, f16 table";
const HALF_NOTE: &str = "the error is that of storing the table in f16; the lookup reads it as f32 again, \
                         and so does its time";

/// A 4D grid of eight levels, from 8 to 1,024 cells a side, of at most 2^16 entries.
fn layout(interpolation: Interpolation) -> Result<HashGridLayout, Error> {
    Ok(HashGridLayout::new(&HashGridConfig {
        n_levels: 8,
        n_features_per_level: 2,
        log2_hashmap_size: 16,
        base_resolution: vec![8, 8, 8, 4],
        finest_resolution: vec![1024, 1024, 1024, 25],
        interpolation,
        sizing: LevelSizing::Paper,
    })?)
}

/// What a table is after it has been stored in f16.
pub(super) fn through_half(table: &[f32]) -> Vec<f32> {
    table.iter().map(|&v| f16::from_f32(v).to_f32()).collect()
}

pub(super) fn measure(bench: &mut Bench, target: Target, n: usize) -> Result<(), Error> {
    for (name, interpolation) in WEIGHTS {
        let layout = layout(interpolation)?;
        let mut rng = generator(1);
        let positions = uniform(&mut rng, n * 4, 0.0, 1.0);
        // As large as trained features are.
        let table = uniform(&mut rng, layout.n_entries() * 2, -0.1, 0.1);
        let expected = reference::hash_encode(&to_f64(&positions), &to_f64(&table), &layout);
        let forward = |table: &[f32]| {
            let positions = target.tensor(&positions, [n, 4]);
            let table = target.tensor(table, [layout.n_entries(), 2]);
            let got = values(hash_encode(positions.clone(), table.clone(), &layout)?)?;
            let timing = time(Some(target.device), || {
                drop(hash_encode(positions.clone(), table.clone(), &layout)?);
                Ok(())
            })?;
            Ok::<_, Error>((Errors::of(&got, &expected), Some(timing)))
        };
        let (error, time) = forward(&table)?;
        bench.add(Measurement {
            error,
            time,
            ..target.measurement(Op::HashEncode, name, Pass::Forward, n)
        });
        if interpolation == Interpolation::Linear {
            let (error, time) = forward(&through_half(&table))?;
            bench.add(Measurement {
                error,
                time,
                note: Some(HALF_NOTE.into()),
                ..target.measurement(Op::HashEncode, HALF_TABLE, Pass::Forward, n)
            });
        }
        measure_gradient(bench, target, name, &positions, &table, &layout)?;
    }
    Ok(())
}

fn measure_gradient(
    bench: &mut Bench,
    target: Target,
    name: &str,
    positions: &[f32],
    table: &[f32],
    layout: &HashGridLayout,
) -> Result<(), Error> {
    let n = positions.len() / layout.dims();
    let width = layout.n_features();
    let cotangent = uniform(&mut generator(2), n * width, -1.0, 1.0);
    let (v_positions, v_table) = reference::hash_encode_vjp(
        &to_f64(positions),
        &to_f64(table),
        &to_f64(&cotangent),
        layout,
    );
    let cotangent = target.constant(&cotangent, [n, width]);
    let positions = target.leaf(positions, [n, layout.dims()]);
    let table = target.leaf(table, [layout.n_entries(), 2]);
    let both = || {
        let out = hash_encode(positions.clone(), table.clone(), layout)?;
        Ok::<_, Error>((out * cotangent.clone()).sum().backward())
    };
    for (way, deterministic) in target.gradient_variants() {
        set_deterministic(deterministic);
        let gradients = both()?;
        let mut errors = Errors::default();
        errors.add(&gradient(&positions, &gradients)?, &v_positions);
        errors.add(&gradient(&table, &gradients)?, &v_table);
        let timing = time(Some(target.device), || both().map(drop))?;
        bench.add(Measurement {
            error: errors.stats(),
            time: Some(timing),
            ..target.measurement(Op::HashEncode, &format!("{name}{way}"), Pass::Gradient, n)
        });
    }
    set_deterministic(false);
    Ok(())
}
