//! The hash encoding at the released preset's 4D geometry: 32 levels of 2 features, 8^4 to
//! 2048^3 x 25, at most 2^19 entries per level.

use burn::tensor::{Device, Tensor, TensorData};
use dash_kernels::hash_encode::{
    HashGridConfig, HashGridLayout, Interpolation, LevelSizing, cpu, hash_encode,
};
use divan::{Bencher, black_box};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

const POINTS: [usize; 2] = [21_000, 100_000];

fn main() {
    divan::main();
}

struct Scene {
    layout: HashGridLayout,
    positions: Vec<f32>,
    table: Vec<f32>,
    v_out: Vec<f32>,
    n: usize,
}

impl Scene {
    fn new(n: usize) -> Self {
        let layout = HashGridLayout::new(&HashGridConfig {
            n_levels: 32,
            n_features_per_level: 2,
            log2_hashmap_size: 19,
            base_resolution: vec![8; 4],
            finest_resolution: vec![2048, 2048, 2048, 25],
            interpolation: Interpolation::Smoothstep,
            sizing: LevelSizing::Reference,
        })
        .expect("a good configuration");
        let mut rng = Pcg64::seed_from_u64(7);
        let mut uniform = |n: usize| (0..n).map(|_| rng.random::<f32>()).collect::<Vec<_>>();
        Self {
            positions: uniform(n * layout.dims()),
            table: uniform(layout.n_entries() * layout.n_features_per_level()),
            v_out: uniform(n * layout.n_features()),
            layout,
            n,
        }
    }

    fn tensors(&self, device: &Device) -> (Tensor<2>, Tensor<2>) {
        let tensor = |values: &Vec<f32>, shape| {
            Tensor::from_data(TensorData::new(values.clone(), shape), device)
        };
        (
            tensor(&self.positions, [self.n, self.layout.dims()]),
            tensor(
                &self.table,
                [self.layout.n_entries(), self.layout.n_features_per_level()],
            ),
        )
    }
}

#[divan::bench(args = POINTS)]
fn forward(bencher: Bencher, n: usize) {
    let s = Scene::new(n);
    bencher.bench(|| black_box(cpu::hash_encode(&s.positions, &s.table, &s.layout)));
}

/// Includes allocating and mapping the table's gradient, 104 MB.
#[divan::bench(args = POINTS)]
fn table_gradient(bencher: Bencher, n: usize) {
    let s = Scene::new(n);
    bencher.bench(|| black_box(cpu::table_vjp(&s.positions, &s.v_out, &s.layout)));
}

#[divan::bench(args = POINTS)]
fn positions_gradient(bencher: Bencher, n: usize) {
    let s = Scene::new(n);
    bencher.bench(|| {
        black_box(cpu::positions_vjp(
            &s.positions,
            &s.table,
            &s.v_out,
            &s.layout,
        ))
    });
}

/// Forward and both gradients through the autodiff graph.
#[divan::bench(args = POINTS)]
fn step_on_tensors(bencher: Bencher, n: usize) {
    let s = Scene::new(n);
    let (positions, table) = s.tensors(&Device::default().autodiff());
    let (positions, table) = (positions.require_grad(), table.require_grad());
    bencher.bench(|| {
        let out = hash_encode(positions.clone(), table.clone(), &s.layout).expect("fits");
        black_box(out.sum().backward());
    });
}
