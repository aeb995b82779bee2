//! Every operation on every backend, forward and backward: milliseconds, and the share that the
//! memory traffic which can't be avoided has of the device's measured bandwidth. The clock stops
//! after the device has.
//!
//! `cargo bench --bench ops -- BACKEND OPERATION` runs those whose names hold the words; the
//! longest sizes are left out where one run takes more than [`TOO_LONG`].

mod scene;

use std::cell::Cell;

use burn::tensor::activation::relu;
use burn::tensor::module::linear;
use burn::tensor::{Device, Distribution, Tensor};
use dash_kernels::adam::{AdamStep, adam_step};
use dash_kernels::displacement::displacement;
use dash_kernels::hash_encode::{
    HashGridConfig, HashGridLayout, Interpolation, LevelSizing, hash_encode,
};
use dash_kernels::mlp::{MlpLayout, mlp};
use dash_kernels::photometric::photometric;
use dash_kernels::rasterize::{N_CHANNELS, RasterizeOptions, rasterize};
use dash_kernels::rows::{join_rows, take_rows};
use dash_kernels::space_time::{Bounds, space_time};
use dash_kernels::splats::N_COLUMNS;
use dash_kernels::ssim::ssim;
use dash_kernels::trajectory::{Polyline, squared_extent};
use dash_kernels::{limits, set_deterministic};
use scene::Size;
use scene::clock::{TOO_LONG, bandwidth, median};
use scene::gaussians::Gaussians;

const N_POINTS: [usize; 3] = [10_000, 100_000, 1_000_000];
const IMAGES: [(usize, usize); 3] = [(512, 512), (1352, 1014), (3840, 2160)];
const VALUE_BYTES: usize = 4;
/// Width of a decoder's hidden layers.
const N_HIDDEN: usize = 64;
/// Parts of a long trajectory.
const N_SPANS: usize = 48;

fn main() {
    // `cargo bench` passes flags of its own.
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with('-'))
        .collect();
    for (name, device) in scene::devices() {
        if words
            .first()
            .is_some_and(|word| !name.contains(word.as_str()))
        {
            continue;
        }
        let bench = Bench {
            name,
            operation: words.get(1).cloned().unwrap_or_default(),
            bandwidth: bandwidth(&device),
            device,
            too_long: Cell::new(false),
        };
        println!("{name}: {:.1} GB/s", bench.bandwidth / 1e9);
        bench.adam();
        bench.hash_encode();
        bench.mlp();
        bench.project();
        bench.rasterize();
        bench.ssim();
        bench.photometric();
        bench.trajectories();
    }
}

struct Bench {
    name: &'static str,
    operation: String,
    bandwidth: f64,
    device: Device,
    too_long: Cell<bool>,
}

impl Bench {
    fn wants(&self, operation: &str) -> bool {
        self.too_long.set(false);
        operation.contains(&self.operation)
    }

    /// Times `work`, which can't do with less traffic than `values`.
    fn time(&self, what: &str, values: usize, work: impl Fn()) {
        if self.too_long.get() {
            return;
        }
        let time = median(&self.device, work);
        let share = (values * VALUE_BYTES) as f64 / time.as_secs_f64() / self.bandwidth;
        let (name, ms) = (self.name, time.as_secs_f64() * 1e3);
        println!("{name:8} {what:56} {ms:9.2} ms {:5.1} %", 100.0 * share);
        self.too_long.set(time > TOO_LONG);
    }

    /// Runs `work` in the mode that costs something on GPUs only.
    fn deterministic(&self, work: impl Fn()) {
        if limits::largest_buffer_bytes(&self.device).is_some() {
            set_deterministic(true);
            work();
            set_deterministic(false);
        }
    }

    /// Whether the device has a buffer for `what` in `n` rows of so many values.
    fn holds(&self, what: &'static str, n: usize, n_values: usize) -> bool {
        let fits = limits::check_values(what, n * n_values, "take fewer", &self.device);
        if let Err(error) = &fits {
            println!("{:8} {n} rows: {error}", self.name);
        }
        fits.is_ok()
    }

    fn random<const R: usize>(&self, shape: [usize; R]) -> Tensor<R> {
        Tensor::random(shape, Distribution::Uniform(0.0, 1.0), &self.device)
    }

    fn adam(&self) {
        if !self.wants("adam") {
            return;
        }
        for n in N_POINTS {
            let n = n * 16;
            let state = Cell::new(Some((
                self.random([n]),
                self.random::<1>([n]),
                self.random::<1>([n]),
            )));
            let gradient = self.random::<1>([n]);
            self.time(&format!("adam {n}"), 7 * n, || {
                let (param, first, second) = state.take().expect("put back");
                let stepped =
                    adam_step(param, gradient.clone(), first, second, &AdamStep::default());
                state.set(Some(stepped.expect("equal shapes")));
            });
        }
    }

    fn hash_encode(&self) {
        if !self.wants("hash_encode") {
            return;
        }
        let layout = HashGridLayout::new(&HashGridConfig {
            n_levels: 16,
            n_features_per_level: 2,
            log2_hashmap_size: 19,
            base_resolution: vec![8; 4],
            finest_resolution: vec![2048, 2048, 2048, 25],
            interpolation: Interpolation::Linear,
            sizing: LevelSizing::Paper,
        })
        .expect("a good configuration");
        let table = self.random([layout.n_entries(), 2]);
        for n in N_POINTS {
            let positions = self.random([n, 4]);
            // Sixteen corners of two features on every level, and what goes in and out.
            let (corners, ends) = (n * 16 * 16 * 2, n * (4 + 32));
            self.time(&format!("hash_encode {n}, forward"), corners + ends, || {
                drop(hash_encode(positions.clone(), table.clone(), &layout));
            });
            let positions = positions.autodiff().require_grad();
            let table = table.clone().autodiff().require_grad();
            let values = 4 * corners + 2 * ends + 2 * layout.n_entries() * 2;
            let both = || {
                let out = hash_encode(positions.clone(), table.clone(), &layout).expect("fits");
                drop(out.sum().backward());
            };
            self.time(&format!("hash_encode {n}, both"), values, both);
            self.deterministic(|| {
                self.time(
                    &format!("hash_encode {n}, both, deterministic"),
                    values,
                    both,
                );
            });
        }
    }

    fn project(&self) {
        if !self.wants("project") {
            return;
        }
        for n in N_POINTS {
            if !self.holds("the colours", n, 3 * scene::N_COEFFS) {
                continue;
            }
            let inputs = Gaussians::new(&self.device, Size(n, 1352, 1014, 3.0));
            let values = n * (3 + 4 + 3 + 1 + 48 + N_COLUMNS);
            self.time(&format!("project {n}, forward"), values, || {
                drop(inputs.project())
            });
            let inputs = inputs.autodiff();
            self.time(&format!("project {n}, both"), 3 * values, || {
                drop(inputs.project().sum().backward());
            });
        }
    }

    /// The decoder of a 4D field with its heads: 16 features, two hidden layers, 10 outputs.
    fn mlp(&self) {
        if !self.wants("mlp") {
            return;
        }
        let layout = MlpLayout::new(&[16, N_HIDDEN, N_HIDDEN, 10]).expect("good widths");
        let parameters = self.random([layout.n_parameters()]) * 0.2;
        for n in N_POINTS {
            // What is kept for the backward pass is the widest layer of every row.
            if !self.holds("the network", n, N_HIDDEN) {
                continue;
            }
            let input = self.random([n, layout.n_inputs()]);
            let values = n * (layout.n_inputs() + layout.n_outputs());
            self.time(&format!("mlp {n}, forward"), values, || {
                drop(mlp(input.clone(), parameters.clone(), &layout).expect("fits"));
            });
            let [input, parameters] = [input.flatten(0, 1), parameters.clone()]
                .map(|tensor: Tensor<1>| tensor.autodiff().require_grad());
            let both = || {
                let input = input.clone().reshape([n, layout.n_inputs()]);
                let out = mlp(input, parameters.clone(), &layout).expect("fits");
                drop(out.sum().backward());
            };
            self.time(&format!("mlp {n}, both"), 3 * values, both);
            let burn = || {
                let mut first = 0;
                let mut take = |length: usize| {
                    first += length;
                    parameters.clone().narrow(0, first - length, length)
                };
                let mut x = input.clone().reshape([n, layout.n_inputs()]);
                for (index, layer) in layout.layers().iter().enumerate() {
                    let weights = take(layer.n_inputs * layer.n_outputs);
                    let weights = weights.reshape([layer.n_inputs, layer.n_outputs]);
                    x = linear(x, weights, Some(take(layer.n_outputs)));
                    if index + 1 < layout.layers().len() {
                        x = relu(x);
                    }
                }
                drop(x.sum().backward());
            };
            self.time(
                &format!("mlp {n}, both, as Burn's layers"),
                3 * values,
                burn,
            );
        }
    }

    fn rasterize(&self) {
        if !self.wants("rasterize") {
            return;
        }
        for (width, height) in IMAGES {
            self.too_long.set(false);
            for n in N_POINTS {
                if !self.holds("the colours", n, 3 * scene::N_COEFFS) {
                    continue;
                }
                let splats = Gaussians::new(&self.device, Size(n, width, height, 3.0)).project();
                let options = RasterizeOptions {
                    width,
                    height,
                    background: [0.0; 3],
                };
                // Too large for the device.
                if rasterize(splats.clone(), &options).is_err() {
                    continue;
                }
                let what = format!("rasterize {n} at {width} x {height}");
                let values = n * N_COLUMNS + width * height * N_CHANNELS;
                self.time(&format!("{what}, forward"), values, || {
                    drop(rasterize(splats.clone(), &options));
                });
                let splats = splats.autodiff().require_grad();
                let both = || {
                    let image = rasterize(splats.clone(), &options).expect("fits");
                    drop(image.sum().backward());
                };
                self.time(&format!("{what}, both"), 3 * values, both);
                self.deterministic(|| {
                    self.time(&format!("{what}, both, deterministic"), 3 * values, both);
                });
            }
        }
    }

    fn ssim(&self) {
        if !self.wants("ssim") {
            return;
        }
        for (width, height) in IMAGES {
            let [x, y] = [0, 1].map(|_| self.random([height, width, 3]));
            let values = 3 * width * height * 3;
            let what = format!("ssim {width} x {height}");
            self.time(&format!("{what}, forward"), values, || {
                drop(ssim(x.clone(), y.clone()))
            });
            let x = x.autodiff().require_grad();
            let y = y.autodiff();
            self.time(&format!("{what}, both"), 3 * values, || {
                drop(ssim(x.clone(), y.clone()).expect("equal").sum().backward());
            });
        }
    }

    fn photometric(&self) {
        if !self.wants("photometric") {
            return;
        }
        for (width, height) in IMAGES {
            let [x, y] = [0, 1].map(|_| self.random([height, width, 3]));
            let values = 2 * width * height * 3;
            let what = format!("photometric loss {width} x {height}");
            let (x, y) = (x.autodiff().require_grad(), y.autodiff());
            self.time(&format!("{what}, both"), values, || {
                let found = photometric(x.clone(), y.clone(), 0.2).expect("equal");
                drop(found.loss.backward());
            });
        }
    }

    /// What is done with coefficients of trajectories, rows and positions.
    fn trajectories(&self) {
        let width = 3 * N_SPANS;
        let bounds = Bounds {
            min: [0.1; 3],
            scale: [1.25; 3],
            clamp: true,
        };
        let basis = [0.5; N_SPANS];
        let polyline = Polyline::new(N_SPANS, 0.5).expect("a time in [0, 1]");
        for n in N_POINTS {
            let (all, taken, splats) = (n * width, n / 5 * width, 2 * n * N_COLUMNS);
            self.rows("displacement", [n, width], [all, n * 3], |rows| {
                displacement(rows, &basis).expect("fits")
            });
            self.rows("squared_extent", [n, width], [all, n], |rows| {
                squared_extent(rows, polyline).expect("fits")
            });
            let rows: Vec<u32> = (0..n as u32).step_by(5).collect();
            self.rows("take_rows", [n, width], [taken, taken], |values| {
                take_rows(values, &rows).expect("ascending")
            });
            self.rows("join_rows", [n, N_COLUMNS], [splats, splats], |rows| {
                join_rows(rows.clone(), rows).expect("of one width")
            });
            self.rows("space_time", [n, 3], [3 * n, 4 * n], |positions| {
                space_time(positions, &bounds, 0.5).expect("three axes")
            });
        }
    }

    /// Times `run` on `n` rows, of which it reads and writes so many values.
    fn rows<const R: usize>(
        &self,
        operation: &str,
        [n, width]: [usize; 2],
        [read, written]: [usize; 2],
        run: impl Fn(Tensor<2>) -> Tensor<R>,
    ) {
        let what = format!("{operation} {n}");
        if !self.wants(operation) || !self.holds("the tensor", n, width) {
            return;
        }
        let rows = self.random([n, width]);
        self.time(&format!("{what}, forward"), read + written, || {
            drop(run(rows.clone()));
        });
        let rows = rows.autodiff().require_grad();
        let values = read + 2 * written + n * width;
        self.time(&format!("{what}, both"), values, || {
            drop(run(rows.clone()).sum().backward());
        });
    }
}
