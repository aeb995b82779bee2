//! The photometric loss on CubeCL devices: the similarity's two kernels, Burn's reductions, and one kernel that adds
//! the gradient of the absolute error.
//!
//! In the last a unit owns a value. No shared memory, no atomics; deterministic.

use burn::backend::TensorMetadata;
use burn::backend::ops::FloatTensorOps;
use burn::tensor::{FloatDType, Scalar, Shape, Slice};
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use super::{PhotometricLoss, PhotometricVjp};
use crate::cube::{arg, contiguous, is_finite, uninitialised, units, zeros};
use crate::host::dims;
use crate::ssim::{Ssim, SsimVjp};

impl PhotometricLoss for CubeBackend {
    fn photometric(image: CubeTensor, target: CubeTensor, dssim: f32) -> CubeTensor {
        type B = CubeBackend;
        let image = first_channels(image, &target);
        let scaled = |value: CubeTensor, by: f32| B::float_mul_scalar(value, Scalar::from(by));
        let error = B::float_sub(image.clone(), target.clone());
        let l1 = B::float_mean(B::float_abs(error.clone()));
        let mse = B::float_mean(B::float_mul(error.clone(), error));
        let mut loss = scaled(l1, 1.0 - dssim);
        if dssim > 0.0 {
            let similarity = B::float_mean(B::ssim(image, target));
            let unlike = B::float_add_scalar(scaled(similarity, -dssim), Scalar::from(dssim));
            loss = B::float_add(loss, unlike);
        }
        let [loss, mse] = [loss, mse].map(|value| B::float_reshape(value, Shape::new([1])));
        B::float_cat(vec![loss, mse], 0)
    }
}

impl PhotometricVjp for CubeBackend {
    fn photometric_and_gradient(
        image: CubeTensor,
        target: CubeTensor,
        dssim: f32,
    ) -> (CubeTensor, CubeTensor) {
        type B = CubeBackend;
        let of_image = dims::<3>(&image);
        let (image, target) = (
            contiguous(first_channels(image, &target)),
            contiguous(target),
        );
        let shape = dims::<3>(&target);
        let n = shape.iter().product::<usize>();
        let v_similar = (dssim > 0.0).then(|| {
            let v_out = Scalar::from(-dssim / n as f32);
            let shape = Shape::new(shape);
            let v_out = B::float_full(shape, v_out, &image.device(), FloatDType::F32);
            let [v_image, _] = B::ssim_vjp(image.clone(), target.clone(), v_out, [true, false]);
            v_image.expect("asked for")
        });
        let v_similar = v_similar.unwrap_or_else(|| zeros(&target, shape));
        let v_image = uninitialised(&image, of_image);
        let n_wide = of_image.iter().product::<usize>();
        let (count, dim) = units(&image.client, n_wide);
        add_absolute::launch(
            &image.client,
            count,
            dim,
            arg(&image),
            arg(&target),
            arg(&v_similar),
            arg(&v_image),
            (1.0 - dssim) / n as f32,
            n_wide as u32,
            of_image[2] as u32,
            shape[2] as u32,
        );
        (B::photometric(image, target, dssim), v_image)
    }
}

/// The channels of the image that the target has.
fn first_channels(image: CubeTensor, target: &CubeTensor) -> CubeTensor {
    let [height, width, channels] = dims::<3>(target);
    if dims::<3>(&image)[2] == channels {
        return image;
    }
    let slices = [height, width, channels].map(|end| Slice::from(0..end));
    CubeBackend::float_slice(image, &slices)
}

/// `v_image`: `v_similar` and the gradient of the absolute error, `weight` where the image is brighter and
/// `-weight` where it is darker; zero in the channels beyond the target's.
#[cube(launch)]
fn add_absolute(
    image: &[f32],       // [H, W, C + E]
    target: &[f32],      // [H, W, C]
    v_similar: &[f32],   // [H, W, C]
    v_image: &mut [f32], // [H, W, C + E]
    weight: f32,
    n: u32,
    wide: u32,
    channels: u32,
) {
    if ABSOLUTE_POS >= n as usize {
        terminate!();
    }
    let channel = ABSOLUTE_POS as u32 % wide;
    let mut v = 0.0f32;
    if channel < channels {
        let from = (ABSOLUTE_POS as u32 / wide * channels + channel) as usize;
        let error = image[from] - target[from];
        v = v_similar[from];
        if is_finite(error) {
            if error > 0.0f32 {
                v += weight;
            }
            if error < 0.0f32 {
                v -= weight;
            }
        }
    }
    v_image[ABSOLUTE_POS] = v;
}
