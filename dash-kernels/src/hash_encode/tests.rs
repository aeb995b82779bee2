//! Layouts and random cases that the tests share.

mod edges;
mod layout;
mod values;

use super::{HashGridConfig, HashGridLayout, Interpolation, LevelSizing, cpu, reference};
use crate::testing::*;

fn small_layout(
    dims: usize,
    features: usize,
    change: impl FnOnce(&mut HashGridConfig),
) -> HashGridLayout {
    let mut config = HashGridConfig {
        n_levels: 6,
        n_features_per_level: features,
        log2_hashmap_size: 9,
        base_resolution: [3, 4, 5, 2][..dims].to_vec(),
        finest_resolution: [90, 64, 70, 11][..dims].to_vec(),
        interpolation: Interpolation::Linear,
        sizing: LevelSizing::Paper,
    };
    change(&mut config);
    HashGridLayout::new(&config).expect("a good configuration")
}

fn every_layout() -> Vec<HashGridLayout> {
    let mut layouts = Vec::new();
    for dims in 2..=4 {
        for features in [1, 2, 4, 8] {
            for interpolation in [Interpolation::Linear, Interpolation::Smoothstep] {
                for sizing in [LevelSizing::Paper, LevelSizing::Reference] {
                    layouts.push(small_layout(dims, features, |c| {
                        (c.interpolation, c.sizing) = (interpolation, sizing);
                    }));
                }
            }
        }
    }
    layouts
}

struct Case {
    layout: HashGridLayout,
    positions: Vec<f32>,
    table: Vec<f32>,
    v_out: Vec<f32>,
    n: usize,
}

impl Case {
    fn random(layout: HashGridLayout, n: usize, seed: u64) -> Self {
        let mut rng = rng(seed);
        let n_values = layout.n_entries() * layout.n_features_per_level();
        Self {
            positions: uniform(&mut rng, n * layout.dims(), 0.0, 1.0),
            table: uniform(&mut rng, n_values, -1.0, 1.0),
            v_out: uniform(&mut rng, n * layout.n_features(), -1.0, 1.0),
            layout,
            n,
        }
    }

    fn reference(&self) -> Vec<f64> {
        reference::hash_encode(&to_f64(&self.positions), &to_f64(&self.table), &self.layout)
    }

    fn reference_vjp(&self) -> (Vec<f64>, Vec<f64>) {
        reference::hash_encode_vjp(
            &to_f64(&self.positions),
            &to_f64(&self.table),
            &to_f64(&self.v_out),
            &self.layout,
        )
    }

    /// Value and both gradients of the fast kernels.
    fn cpu(&self) -> [Vec<f32>; 3] {
        [
            cpu::hash_encode(&self.positions, &self.table, &self.layout),
            cpu::positions_vjp(&self.positions, &self.table, &self.v_out, &self.layout),
            cpu::table_vjp(&self.positions, &self.v_out, &self.layout),
        ]
    }

    fn assert_cpu_agrees(&self) {
        let [out, v_positions, v_table] = self.cpu();
        let (expected_v_positions, expected_v_table) = self.reference_vjp();
        assert_agrees("features", &out, &self.reference());
        assert_agrees("v_positions", &v_positions, &expected_v_positions);
        assert_agrees("v_table", &v_table, &expected_v_table);
    }
}
