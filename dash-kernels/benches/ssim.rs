//! SSIM and its gradient at the sizes of the rasterizer's benchmark.

use dash_kernels::ssim::cpu;
use divan::{Bencher, black_box};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

const SIZES: [(usize, usize); 2] = [(240, 320), (1014, 1352)];
const CHANNELS: usize = 3;

fn main() {
    divan::main();
}

fn images((height, width): (usize, usize)) -> [Vec<f32>; 3] {
    let mut rng = Pcg64::seed_from_u64(7);
    let n = height * width * CHANNELS;
    std::array::from_fn(|_| (0..n).map(|_| rng.random()).collect())
}

#[divan::bench(args = SIZES)]
fn forward(bencher: Bencher, (height, width): (usize, usize)) {
    let [x, y, _] = images((height, width));
    bencher.bench(|| black_box(cpu::ssim(&x, &y, [height, width, CHANNELS])));
}

#[divan::bench(args = SIZES)]
fn gradient_of_one_image(bencher: Bencher, (height, width): (usize, usize)) {
    let [x, y, v] = images((height, width));
    bencher.bench(|| black_box(cpu::ssim_vjp(&x, &y, &v, [height, width, CHANNELS])));
}
