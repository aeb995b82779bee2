//! Precision on fine levels, the ways of adding up the table's gradient, poison.

use crate::cube::tests::{cube_tensor, cube_values};
use crate::hash_encode::{HashGridConfig, LevelSizing, reference};
use crate::testing::*;

use super::*;

/// Largest error of a feature, as a part of the largest feature.
const FEATURES: f64 = 1e-6;

/// The released preset's levels, with a smaller table.
fn fine_layout(sizing: LevelSizing, interpolation: Interpolation) -> HashGridLayout {
    HashGridLayout::new(&HashGridConfig {
        n_levels: 32,
        n_features_per_level: 2,
        log2_hashmap_size: 14,
        base_resolution: vec![8; 4],
        finest_resolution: vec![2048, 2048, 2048, 25],
        interpolation,
        sizing,
    })
    .expect("a good configuration")
}

struct Case {
    layout: HashGridLayout,
    n: usize,
    positions: Vec<f32>,
    table: Vec<f32>,
    v_out: Vec<f32>,
}

impl Case {
    /// Random points, some of them on borders of cells and of the box.
    fn new(layout: HashGridLayout, n: usize, seed: u64) -> Self {
        let mut rng = rng(seed);
        let mut positions = uniform(&mut rng, n * 4, 0.0, 1.0);
        for (i, x) in positions.iter_mut().enumerate() {
            match i % 11 {
                0 => *x = (*x * 2048.0).floor() / 2048.0,
                1 => *x = ((*x * 2047.0).floor() / 2047.0).next_up(),
                2 if i % 3 == 0 => *x = 1.0,
                2 => *x = 0.0,
                _ => {}
            }
        }
        let n_values = layout.n_entries() * 2;
        Self {
            n,
            positions,
            table: uniform(&mut rng, n_values, -1.0, 1.0),
            v_out: uniform(&mut rng, n * layout.n_features(), -1.0, 1.0),
            layout,
        }
    }

    fn positions(&self) -> CubeTensor {
        cube_tensor(&self.positions, [self.n, 4])
    }

    fn table(&self) -> CubeTensor {
        cube_tensor(&self.table, [self.layout.n_entries(), 2])
    }

    fn v_out(&self) -> CubeTensor {
        cube_tensor(&self.v_out, [self.n, self.layout.n_features()])
    }

    fn features(&self) -> Vec<f32> {
        let out = CubeBackend::hash_encode(self.positions(), self.table(), self.layout.clone());
        cube_values(&out)
    }

    /// Gradient to the table, the three ways.
    fn v_tables(&self) -> [Vec<f32>; 3] {
        let (positions, table, v_out) = (self.positions(), self.table(), self.v_out());
        let layout = &self.layout;
        let levels = level_words(&positions.client, layout);
        [
            table_vjp::<NativeAdd>(&positions, &table, &v_out, &levels, layout),
            table_vjp::<ExchangeAdd>(&positions, &table, &v_out, &levels, layout),
            deterministic::table_vjp(&positions, &table, &v_out, &levels, layout),
        ]
        .map(|v_table| cube_values(&v_table))
    }
}

#[test]
fn fine_levels_keep_their_fraction() {
    let mut worst = 0.0f64;
    for (seed, sizing) in [LevelSizing::Paper, LevelSizing::Reference]
        .into_iter()
        .enumerate()
    {
        for interpolation in [Interpolation::Linear, Interpolation::Smoothstep] {
            let case = Case::new(fine_layout(sizing, interpolation), 3000, seed as u64);
            let expected = reference::hash_encode(
                &to_f64(&case.positions),
                &to_f64(&case.table),
                &case.layout,
            );
            let got = case.features();
            let largest = expected.iter().fold(0.0f64, |most, v| most.max(v.abs()));
            for (i, (&got, expected)) in got.iter().zip(&expected).enumerate() {
                let error = (f64::from(got) - expected).abs() / largest;
                assert!(error <= FEATURES, "feature {i}: {got} != {expected}");
                worst = worst.max(error);
            }
        }
    }
    eprintln!("largest error of a feature: {worst:.1e}");
}

#[test]
fn every_way_of_adding_up_agrees_with_the_reference() {
    let layout = fine_layout(LevelSizing::Paper, Interpolation::Linear);
    let case = Case::new(layout, 1500, 9);
    let (_, expected) = reference::hash_encode_vjp(
        &to_f64(&case.positions),
        &to_f64(&case.table),
        &to_f64(&case.v_out),
        &case.layout,
    );
    let [native, exchanged, sorted] = case.v_tables();
    assert_agrees("native", &native, &expected);
    assert_agrees("exchanged", &exchanged, &expected);
    assert_agrees("sorted", &sorted, &expected);
    let [_, _, again] = case.v_tables();
    assert_eq!(bits(&sorted), bits(&again), "another run differs");
}

#[test]
fn poison_in_every_slot() {
    let layout = fine_layout(LevelSizing::Reference, Interpolation::Smoothstep);
    let mut case = Case::new(layout, 4 * 22, 10);
    for (i, value) in poison().into_iter().enumerate() {
        for axis in 0..4 {
            case.positions[(i * 4 + axis) * 4 + axis] = value;
        }
    }
    // WGSL lets a device take subnormal numbers for zero, which lies inside.
    let is_inside = |x: &f32| (0.0..=1.0).contains(x) || x.is_subnormal();
    let inside = |point: &[f32]| point.iter().all(is_inside);
    let features = case.features();
    let per_point = case.layout.n_features();
    for (point, features) in case
        .positions
        .chunks_exact(4)
        .zip(features.chunks_exact(per_point))
    {
        assert!(features.iter().all(|v| v.is_finite()), "{point:?}");
        assert!(
            inside(point) || features.iter().all(|&v| v == 0.0),
            "{point:?}"
        );
    }
    let needed = [true, true];
    let gradients = CubeBackend::hash_encode_vjp(
        case.positions(),
        case.table(),
        case.v_out(),
        &case.layout,
        needed,
    );
    for gradient in gradients.iter().flatten() {
        assert!(cube_values(gradient).iter().all(|v| v.is_finite()));
    }
}
