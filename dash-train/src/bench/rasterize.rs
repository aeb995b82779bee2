//! Rasterization of a whole picture. Errors are measured on parts of it, because the reference blends every splat
//! into every pixel.

use burn::tensor::Tensor;
use dash_kernels::project::Activation;
use dash_kernels::rasterize::{N_CHANNELS, RasterizeOptions, rasterize, reference};
use dash_kernels::set_deterministic;
use dash_kernels::splats::{
    ACROSS_OFFSET, ACROSS_X, ACROSS_Y, MEAN_X, MEAN_Y, N_COLUMNS, N_DIFFERENTIABLE,
};

use super::project::{Cloud, columns_apart, sight};
use super::{
    Bench, ErrorStats, Errors, Measurement, Op, Pass, Target, generator, gradient, time, uniform,
    values,
};
use crate::Error;

const BACKGROUND: [f32; 3] = [0.25, 0.5, 0.125];
/// Left upper corners of the judged parts, pixels.
const PARTS: [[usize; 2]; 4] = [[20, 16], [150, 110], [288, 60], [90, 208]];
/// Side of a judged part, pixels.
const PART_SIDE: usize = 12;
const NOTE: &str = "judged in four parts of the picture; where rounding decides whether a splat is drawn at a pixel, \
                    the error is that splat's whole contribution";

/// Packed splats, a picture's size, and the parts of it that are judged.
pub(super) struct Judged {
    pub(super) splats: Vec<f32>,
    pub(super) size: [usize; 2],
    pub(super) parts: Vec<[usize; 2]>,
    pub(super) side: usize,
}

impl Judged {
    pub(super) fn options(&self) -> RasterizeOptions {
        RasterizeOptions {
            width: self.size[0],
            height: self.size[1],
            background: BACKGROUND,
        }
    }

    /// The splats as the reference sees them from a part's corner.
    fn moved(&self, [left, top]: [usize; 2]) -> Vec<f64> {
        let mut splats: Vec<f64> = self.splats.iter().map(|&v| f64::from(v)).collect();
        for row in splats.chunks_exact_mut(N_COLUMNS) {
            row[MEAN_X] -= left as f64;
            row[MEAN_Y] -= top as f64;
            row[ACROSS_OFFSET] -= row[ACROSS_X] * left as f64 + row[ACROSS_Y] * top as f64;
        }
        splats
    }

    /// The values of a whole picture that lie in a part.
    fn cut<T: Copy>(&self, picture: &[T], [left, top]: [usize; 2]) -> Vec<T> {
        let row = |y: usize| {
            let start = (y * self.size[0] + left) * N_CHANNELS;
            picture[start..start + self.side * N_CHANNELS]
                .iter()
                .copied()
        };
        (top..top + self.side).flat_map(row).collect()
    }

    /// Errors of a picture, each channel relative to its own values.
    pub(super) fn picture_errors(&self, got: &[f32]) -> ErrorStats {
        let mut errors = Errors::default();
        let (mut seen, mut expected) = (Vec::new(), Vec::new());
        for &part in &self.parts {
            seen.extend(self.cut(got, part));
            let size = [self.side; 2];
            let background = BACKGROUND.map(f64::from);
            expected.extend(reference::rasterize(&self.moved(part), size, background));
        }
        for channel in 0..N_CHANNELS {
            let got: Vec<f32> = seen
                .iter()
                .skip(channel)
                .step_by(N_CHANNELS)
                .copied()
                .collect();
            let expected: Vec<f64> = expected
                .iter()
                .skip(channel)
                .step_by(N_CHANNELS)
                .copied()
                .collect();
            errors.add(&got, &expected);
        }
        errors.stats()
    }

    /// A gradient of the picture, zero outside of the measured parts, and the splats' gradient that follows.
    fn cotangent(&self) -> (Vec<f32>, Vec<f64>) {
        let n = self.size[0] * self.size[1] * N_CHANNELS;
        let random = uniform(&mut generator(9), n, -1.0, 1.0);
        let mut cotangent = vec![0.0; n];
        let mut expected = vec![0.0; self.splats.len()];
        for &part in &self.parts {
            for y in part[1]..part[1] + self.side {
                let start = (y * self.size[0] + part[0]) * N_CHANNELS;
                let row = start..start + self.side * N_CHANNELS;
                cotangent[row.clone()].copy_from_slice(&random[row]);
            }
            let v: Vec<f64> = self
                .cut(&cotangent, part)
                .iter()
                .map(|&v| f64::from(v))
                .collect();
            let background = BACKGROUND.map(f64::from);
            let of_part =
                reference::rasterize_vjp(&self.moved(part), [self.side; 2], background, &v);
            for (sum, v) in expected.iter_mut().zip(of_part) {
                *sum += v;
            }
        }
        (cotangent, expected)
    }

    /// Calls `found` with each way of summing gradients, its errors, and the work to be timed.
    pub(super) fn gradients(
        &self,
        target: Target,
        mut found: impl FnMut(&str, ErrorStats, &dyn Fn() -> Result<(), Error>) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let shape = [self.size[1], self.size[0], N_CHANNELS];
        let (cotangent, expected) = self.cotangent();
        let cotangent = target.constant(&cotangent, shape);
        let dense = target.constant(
            &uniform(&mut generator(10), shape.iter().product(), -1.0, 1.0),
            shape,
        );
        let n = self.splats.len() / N_COLUMNS;
        let leaf = target.leaf(&self.splats, [n, N_COLUMNS]);
        let options = self.options();
        let both = |cotangent: &Tensor<3>| {
            let image = rasterize(leaf.clone(), &options)?;
            Ok::<_, Error>((image * cotangent.clone()).sum().backward())
        };
        for (way, deterministic) in target.gradient_variants() {
            set_deterministic(deterministic);
            let got = gradient(&leaf, &both(&cotangent)?)?;
            let errors = columns_apart(&got, &expected, 0..N_DIFFERENTIABLE);
            found(way, errors, &|| both(&dense).map(drop))?;
        }
        set_deterministic(false);
        Ok(())
    }

    pub(super) fn tensor(&self, target: Target) -> Tensor<2> {
        target.tensor(&self.splats, [self.splats.len() / N_COLUMNS, N_COLUMNS])
    }
}

pub(super) fn measure(bench: &mut Bench, target: Target, n: usize) -> Result<(), Error> {
    let sight = sight(Activation::Linear);
    let splats = Cloud::random(n, 11).expected(&sight);
    let judged = Judged {
        splats: splats.into_iter().map(|v| v as f32).collect(),
        size: [sight.camera.width, sight.camera.height],
        parts: PARTS.to_vec(),
        side: PART_SIDE,
    };
    let (splats, options) = (judged.tensor(target), judged.options());
    let image = values(rasterize(splats.clone(), &options)?)?;
    let timing = time(Some(target.device), || {
        drop(rasterize(splats.clone(), &options)?);
        Ok(())
    })?;
    bench.add(Measurement {
        error: judged.picture_errors(&image),
        time: Some(timing),
        note: Some(NOTE.into()),
        ..target.measurement(Op::Rasterize, "f32", Pass::Forward, n)
    });
    judged.gradients(target, |way, error, work| {
        let timing = time(Some(target.device), work)?;
        bench.add(Measurement {
            error,
            time: Some(timing),
            note: Some(NOTE.into()),
            ..target.measurement(Op::Rasterize, &format!("f32{way}"), Pass::Gradient, n)
        });
        Ok(())
    })
}
