//! Lists that are hard to select from: percentiles and nearest neighbours. They run on the host.

use burn::tensor::Device;
use dash_model::GaussianRows;
use dash_model::decomposition::{percentile_threshold, select_dynamic};
use rand::seq::SliceRandom;

use super::Case;
use super::inputs::{rng, uniform};
use super::measured::Measured;
use crate::Error;

const FAMILY: &str = "selection";

pub(super) const CASES: &[Case] = &[
    Case {
        family: FAMILY,
        name: "percentiles",
        extreme: "no values, one, ties, NaN and infinities",
        measure: percentiles,
    },
    Case {
        family: FAMILY,
        name: "long percentile",
        extreme: "2^24 + 1 values",
        measure: long_percentile,
    },
    Case {
        family: FAMILY,
        name: "neighbours",
        extreme: "0 to 4 points, 10,000 coincident ones, lines, extents of 1e-15 to 1e15",
        measure: neighbours,
    },
];

fn percentiles(_: &Device) -> Result<Measured, Error> {
    const NAN: f32 = f32::NAN;
    const INFINITY: f32 = f32::INFINITY;
    let mut measured = Measured::default();
    let marked = |motion: &[f32], quantile, floor| -> Vec<usize> {
        let mask = select_dynamic(motion, quantile, floor);
        (0..mask.len()).filter(|&i| mask[i]).collect()
    };
    let expectations: [(&str, Vec<usize>, Vec<usize>); 7] = [
        ("none", marked(&[], 0.8, 0.0), vec![]),
        ("one", marked(&[3.0], 0.8, 0.0), vec![]),
        ("ties", marked(&[1.0; 7], 0.8, 0.0), vec![]),
        (
            "NaN",
            marked(&[0.0, NAN, 0.0, 5.0, NAN, 5.0], 0.5, 0.0),
            vec![3, 5],
        ),
        ("all NaN", marked(&[NAN; 5], 0.8, 0.0), vec![]),
        (
            "infinite",
            marked(&[0.0, INFINITY, 2.0, -INFINITY], 0.0, 0.0),
            vec![2],
        ),
        ("floor", marked(&[0.1, 0.2, 0.3], 0.0, 0.25), vec![2]),
    ];
    for (name, got, expected) in expectations {
        measured.none(
            format!("{name}: wrongly marked"),
            usize::from(got != expected),
        );
    }
    Ok(measured)
}

fn long_percentile(_: &Device) -> Result<Measured, Error> {
    const N: usize = (1 << 24) + 1;
    const QUANTILE: f32 = 0.8;
    // Every multiple of 2^-24 in [0, 1], which single precision holds exactly.
    let mut motion: Vec<f32> = (0..N).map(|i| i as f32 / (1 << 24) as f32).collect();
    motion.shuffle(&mut rng(61));
    let got = f64::from(percentile_threshold(&motion, QUANTILE)) * (N - 1) as f64;
    let expected = (f64::from(QUANTILE) * (N - 1) as f64).floor();
    let mut measured = Measured::default();
    // The rank is a product in single precision, which near 2^24 is rounded to a whole number.
    measured.judge("rank", (got - expected).abs(), 1.0);
    let n_marked = select_dynamic(&motion, QUANTILE, 0.0)
        .iter()
        .filter(|m| **m)
        .count();
    let off = (n_marked as f64 - ((N - 1) as f64 - expected)).abs();
    measured.judge("marked", off, 1.0);
    Ok(measured)
}

fn neighbours(_: &Device) -> Result<Measured, Error> {
    const FALLBACK: f32 = 0.25;
    let mut measured = Measured::default();
    let mut rows = |positions: &[[f32; 3]]| {
        let colors = vec![[0.5; 3]; positions.len()];
        let rows = GaussianRows::from_points(positions, &colors, 0, FALLBACK);
        measured.saw(rows.log_scales.as_flattened());
        rows.log_scales
    };
    let is_fallback = |scale: &[f32; 3]| (scale[0].exp() - FALLBACK).abs() < 1e-6;
    let mut wrong = 0;
    for n in 0..=4 {
        wrong += rows(&vec![[1.0, 2.0, 3.0]; n])
            .iter()
            .filter(|s| !is_fallback(s))
            .count();
        let line: Vec<[f32; 3]> = (0..n).map(|i| [i as f32, 0.0, 0.0]).collect();
        let apart = rows(&line)
            .iter()
            .filter(|s| is_fallback(s) != (n < 2))
            .count();
        wrong += apart;
    }
    wrong += rows(&[[4.0, -5.0, 6.0]; 10_000])
        .iter()
        .filter(|s| !is_fallback(s))
        .count();
    let line: Vec<[f32; 3]> = (0..10_000).map(|i| [i as f32, 0.0, 0.0]).collect();
    let expected = ((1.0 + 1.0 + 4.0) / 3.0f32).sqrt().ln();
    let inner = rows(&line)[3..9_997].to_vec();
    wrong += inner
        .iter()
        .filter(|s| (s[0] - expected).abs() > 1e-5)
        .count();
    for extent in [1e-15, 1e-4, 1e4, 1e15f32] {
        let values = uniform(&mut rng(62), 3 * 500, -extent, extent);
        let (points, _) = values.as_chunks::<3>();
        let scales = rows(points);
        // Too near each other for squares of single precision: the fallback.
        wrong += match extent < 1e-7 {
            true => scales.iter().filter(|s| !is_fallback(s)).count(),
            false => scales.iter().filter(|s| s[0].exp() > extent).count(),
        };
    }
    measured.none("wrong scales", wrong);
    Ok(measured)
}
