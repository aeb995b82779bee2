//! A whole frame on tensors: projection and rasterization, forward and backward, on every backend
//! of the build. The clock stops after the device has.

mod scene;

use burn::tensor::Device;
use dash_kernels::rasterize::{RasterizeOptions, rasterize};
use scene::clock::median;
use scene::gaussians::Gaussians;
use scene::{SIZES, Size};

fn main() {
    // `cargo bench` passes flags of its own; a word picks the backends whose names hold it.
    let wanted = std::env::args().skip(1).find(|arg| !arg.starts_with('-'));
    for (name, device) in scene::devices() {
        if wanted
            .as_ref()
            .is_some_and(|wanted| !name.contains(wanted.as_str()))
        {
            continue;
        }
        for size in SIZES {
            let (forward, both) = Frame::new(size, &device).times();
            println!("{name:8} {size:24} forward {forward:8.2} ms, with backward {both:8.2} ms");
        }
    }
}

struct Frame {
    gaussians: Gaussians,
    options: RasterizeOptions,
    device: Device,
}

impl Frame {
    fn new(size: Size, device: &Device) -> Self {
        let Size(_, width, height, _) = size;
        Self {
            gaussians: Gaussians::new(device, size),
            options: RasterizeOptions {
                width,
                height,
                background: [0.0; 3],
            },
            device: device.clone(),
        }
    }

    /// Milliseconds of the forward pass, and of both.
    fn times(&self) -> (f64, f64) {
        let image = |gaussians: &Gaussians| {
            rasterize(gaussians.project(), &self.options).expect("a good size")
        };
        let forward = self.ms(|| drop(image(&self.gaussians)));
        let tracked = self.gaussians.clone().autodiff();
        let both = self.ms(|| drop(image(&tracked).sum().backward()));
        (forward, both)
    }

    fn ms(&self, work: impl Fn()) -> f64 {
        median(&self.device, work).as_secs_f64() * 1e3
    }
}
