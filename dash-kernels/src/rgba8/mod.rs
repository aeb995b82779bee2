//! Pictures in 8 bits a channel, as screens and files take them.

mod cpu;
#[cfg(feature = "cube")]
mod cube;
#[cfg(test)]
mod tests;

use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Backend, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::{Int, Tensor, TensorData, try_read_sync};

use crate::KernelError;
use crate::host::{HostBackend, dims};

#[cfg(feature = "wgpu")]
pub use cube::wgpu_buffer;

/// A picture `[H, W, C]` as `[H, pitch]` pixels: bytes red, green, blue and 255 from the lowest on, in sRGB as given.
///
/// The first three channels are the colours; fewer than three are one gray, the first. Values are rounded to the nearest of
/// 256 levels of [0, 1]; what lies outside is clamped, what is not finite counts as zero. Pixels of a row beyond `W` are zero: a pitch
/// of a multiple of 64 lets GPUs copy the rows into a texture. Does not wait for the device, and has no gradient.
///
/// # Errors
/// [`KernelError::Shape`] when there is no channel, or the pitch is less than `W`.
///
/// # Panics
/// On tensors of an autodiff device.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::rgba8::rgba8;
///
/// let orange = Tensor::<3>::from_floats([[[1.0, 0.5, 0.0]]], &Device::flex());
/// let pixels = rgba8(orange, 1)?.into_data();
/// assert_eq!(pixels.as_bytes(), [255, 128, 0, 255]);
/// # Ok::<(), dash_kernels::KernelError>(())
/// ```
pub fn rgba8(image: Tensor<3>, pitch: usize) -> Result<Tensor<2, Int>, KernelError> {
    let [height, width, channels] = image.dims();
    if channels == 0 || pitch < width {
        return Err(KernelError::Shape {
            op: "rgba8",
            tensor: "image",
            expected: format!("[H, W, C] with W at most {pitch} and C at least 1"),
            found: vec![height, width, channels],
        });
    }
    let image = image.into_dispatch();
    Ok(Tensor::from_dispatch(Dispatch::pack_rgba8(image, pitch)))
}

/// Bytes as numbers in [0, 1]: a picture in a quarter of the memory, on its way to a device.
///
/// # Shapes
/// `words [W]` of four bytes each, the lowest first; the first `n` bytes count `-> [n]`.
///
/// # Errors
/// [`KernelError::Shape`] when there are fewer bytes, or none is asked for.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Int, Tensor};
/// use dash_kernels::rgba8::from_bytes;
///
/// let words = Tensor::<1, Int>::from_ints([0x33_ff_00], &Device::flex());
/// let numbers = from_bytes(words, 3)?;
/// assert_eq!(numbers.into_data().try_into_vec::<f32>()?, [0.0, 1.0, 0.2]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn from_bytes(words: Tensor<1, Int>, n: usize) -> Result<Tensor<1>, KernelError> {
    let [n_words] = words.dims();
    if n == 0 || n > BYTES * n_words {
        return Err(KernelError::Shape {
            op: "from_bytes",
            tensor: "words",
            expected: format!("[{}] or more, of 1 byte or more", n.div_ceil(BYTES)),
            found: vec![n_words],
        });
    }
    let words = words.into_dispatch();
    Ok(Tensor::from_dispatch(Dispatch::from_bytes(words, n)))
}

/// Bytes of a word.
const BYTES: usize = 4;

/// Dispatch of [`rgba8`] and [`from_bytes`] over the enabled backends.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait PackRgba8: Backend {
    /// `[H, W, C]` to `[H, pitch]`, 32 bits each.
    fn pack_rgba8(image: FloatTensor<Self>, pitch: usize) -> IntTensor<Self>;

    /// See [`from_bytes`]; there are as many bytes.
    fn from_bytes(words: IntTensor<Self>, n: usize) -> FloatTensor<Self>;
}

impl<B: HostBackend> PackRgba8 for B {
    fn pack_rgba8(image: FloatTensor<B>, pitch: usize) -> IntTensor<B> {
        let [height, width, channels] = dims(&image);
        let pixels = cpu::rgba8(&B::values(&image), [height, width, channels], pitch);
        let data = TensorData::new(pixels, [height, pitch]);
        B::int_from_data(data, &image.device())
    }
    fn from_bytes(words: IntTensor<B>, n: usize) -> FloatTensor<B> {
        let device = words.device();
        let words = try_read_sync(B::int_into_data(words))
            .expect("a host backend's tensors are read without waiting")
            .expect("reading host memory cannot fail");
        let bytes = words.iter::<i32>().flat_map(i32::to_le_bytes).take(n);
        let numbers: Vec<f32> = bytes.map(|byte| f32::from(byte) / 255.0).collect();
        B::float_from_data(TensorData::new(numbers, [n]), &device)
    }
}
