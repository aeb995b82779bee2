//! Pictures in 8 bits a channel on CubeCL devices.
//!
//! A unit owns a pixel. No shared memory, no atomics; deterministic.

use burn::tensor::DType;
use burn_cubecl::CubeBackend;
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::ops::numeric::empty_device_contiguous_dtype;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use super::{BYTES, PackRgba8};
use crate::cube::{arg, contiguous, finite_or_zero, units};
use crate::host::dims;

impl PackRgba8 for CubeBackend {
    fn pack_rgba8(image: CubeTensor, pitch: usize) -> CubeTensor {
        let image = contiguous(image);
        let [height, width, channels] = dims(&image);
        let (client, device) = (image.client.clone(), image.device.clone());
        let shape = [height, pitch].into();
        let pixels = empty_device_contiguous_dtype(client, device, shape, DType::I32);
        let length = height * pitch;
        let (count, dim) = units(&image.client, length);
        rgba8_kernel::launch(
            &image.client,
            count,
            dim,
            arg(&image),
            arg(&pixels),
            length as u32,
            width as u32,
            channels as u32,
            pitch as u32,
        );
        pixels
    }

    fn from_bytes(words: CubeTensor, n: usize) -> CubeTensor {
        let words = into_contiguous(words);
        let (client, device) = (words.client.clone(), words.device.clone());
        let numbers = empty_device_contiguous_dtype(client, device, [n].into(), DType::F32);
        let (count, dim) = units(&words.client, n.div_ceil(BYTES));
        bytes_kernel::launch(
            &words.client,
            count,
            dim,
            arg(&words),
            arg(&numbers),
            n as u32,
        );
        numbers
    }
}

/// A unit owns a word.
#[cube(launch)]
fn bytes_kernel(
    words: &[u32],       // [ceil(n / 4)]
    numbers: &mut [f32], // [n]
    n: u32,
) {
    let first = ABSOLUTE_POS * BYTES;
    if first < n as usize {
        let word = words[ABSOLUTE_POS];
        #[unroll]
        for k in 0..BYTES {
            if first + k < n as usize {
                let byte = (word >> comptime!(8 * k as u32)) & 0xffu32;
                numbers[first + k] = f32::cast_from(byte) / 255.0f32;
            }
        }
    }
}

/// The memory of a tensor on a wgpu device, and the offset of its first value in bytes; `None` on other devices.
///
/// Kernels that write the tensor are submitted to the device's queue before this returns, so what is submitted after it reads
/// what they wrote. Keep the tensor until then: its memory is used again once nobody holds it.
#[cfg(feature = "wgpu")]
pub fn wgpu_buffer(
    tensor: &burn::tensor::Tensor<2, burn::tensor::Int>,
) -> Option<(cubecl::wgpu::wgpu::Buffer, u64)> {
    use cubecl::wgpu::{AutoCompiler, WgpuServer};

    let tensor = tensor.clone().try_into_primitive::<CubeBackend>().ok()?;
    let memory = tensor
        .client
        .get_resource::<WgpuServer<AutoCompiler>>(tensor.handle.clone())
        .ok()?;
    tensor.client.flush().ok()?;
    let resource = memory.resource();
    Some((resource.buffer.clone(), resource.offset))
}

/// The nearest of 256 levels of [0, 1].
#[cube]
fn level(value: f32) -> u32 {
    u32::cast_from(f32::clamp(finite_or_zero(value), 0.0, 1.0) * 255.0 + 0.5)
}

#[cube(launch)]
fn rgba8_kernel(
    image: &[f32],      // [H, W, C]
    pixels: &mut [u32], // [H, pitch]
    length: u32,
    width: u32,
    channels: u32,
    pitch: u32,
) {
    if ABSOLUTE_POS >= length as usize {
        terminate!();
    }
    let (row, column) = (ABSOLUTE_POS / pitch as usize, ABSOLUTE_POS % pitch as usize);
    let mut pixel = 0u32;
    if column < width as usize {
        let first = (row * width as usize + column) * channels as usize;
        let red = level(image[first]);
        let mut green = red;
        let mut blue = red;
        if channels >= 3u32 {
            green = level(image[first + 1]);
            blue = level(image[first + 2]);
        }
        pixel = red | (green << 8u32) | (blue << 16u32) | 0xff00_0000u32;
    }
    pixels[ABSOLUTE_POS] = pixel;
}
