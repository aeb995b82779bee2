//! Shared by the CubeCL kernels: device memory, launches, sums, prefix sums, sorting, atomic addition, numbers of
//! two floats.

pub(crate) mod atomic;
pub(crate) mod radix_sort;
pub(crate) mod scan;
pub(crate) mod sums;
#[cfg(test)]
pub(crate) mod tests;
pub(crate) mod two_float;

use burn::tensor::DType;
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::ops::numeric::empty_device_contiguous_dtype;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;
use cubecl::server::Handle;

/// Bytes of a buffer's element: every buffer holds `f32` or `u32`.
pub(crate) const WORD_BYTES: usize = 4;

/// The tensor's values in row-major order.
///
/// # Panics
/// When the tensor is not `f32`.
pub(crate) fn contiguous(tensor: CubeTensor) -> CubeTensor {
    assert_eq!(tensor.dtype, DType::F32, "expected an f32 tensor");
    into_contiguous(tensor)
}

/// The tensor itself where nobody else holds its memory, else a copy.
pub(crate) fn own_memory(tensor: CubeTensor) -> CubeTensor {
    let tensor = contiguous(tensor);
    if tensor.handle.can_mut() {
        tensor
    } else {
        contiguous(tensor.copy())
    }
}

/// A tensor of `shape` on the device of `like`, with uninitialised values.
pub(crate) fn uninitialised<const R: usize>(like: &CubeTensor, shape: [usize; R]) -> CubeTensor {
    let (client, device) = (like.client.clone(), like.device.clone());
    empty_device_contiguous_dtype(client, device, shape.into(), DType::F32)
}

/// A contiguous tensor of zeros on the device of `like`; Burn's own pad their rows on CUDA.
pub(crate) fn zeros<const R: usize>(like: &CubeTensor, shape: [usize; R]) -> CubeTensor {
    let tensor = uninitialised(like, shape);
    let length = tensor.meta.num_elements();
    let (count, dim) = units(&tensor.client, length);
    zero_kernel::launch(&tensor.client, count, dim, arg(&tensor), length as u32);
    tensor
}

/// A tensor as a kernel's argument. Kernels take lengths as arguments of their own: `.len()` in a kernel is the length of
/// the memory, which on CUDA may be longer, and nothing checks accesses beyond the tensor.
pub(crate) fn arg(tensor: &CubeTensor) -> BufferArg {
    assert!(tensor.is_contiguous(), "kernels read row-major tensors");
    let length = tensor.meta.num_elements();
    // SAFETY: the tensor is contiguous and holds as many 4-byte values as its shape says.
    unsafe { BufferArg::from_raw_parts(tensor.handle.clone(), length) }
}

/// Device memory for `u32` or `f32` values that are no tensor.
#[derive(Debug, Clone)]
pub(crate) struct Buffer {
    handle: Handle,
    length: usize,
}

impl Buffer {
    /// Memory for `length` uninitialised values.
    pub fn uninitialised(client: &Client, length: usize) -> Self {
        // No device binds an empty buffer.
        let handle = client.empty(length.max(1) * WORD_BYTES);
        Self { handle, length }
    }

    /// Values from the host.
    pub fn from_words(client: &Client, words: &[u32]) -> Self {
        let handle = client.create_from_slice(bytemuck::cast_slice(words));
        Self {
            handle,
            length: words.len(),
        }
    }

    /// The buffer as a kernel's argument.
    pub fn arg(&self) -> BufferArg {
        // SAFETY: the memory was made for this many 4-byte values, and for at least one.
        unsafe { BufferArg::from_raw_parts(self.handle.clone(), self.length.max(1)) }
    }

    /// The memory itself, to be read back.
    pub fn handle(&self) -> Handle {
        self.handle.clone()
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.length
    }
}

/// Sizes of buffers are rounded up to multiples of this many bytes, or of the device's alignment where that is more.
const PIECE_BYTES: u64 = 512;

/// Bytes of the device's largest buffer. A limit between two multiples, such as the 2^31 - 1 bytes of many drivers, can't
/// be used up: the last piece would exceed it.
pub(crate) fn largest_buffer(client: &Client) -> u64 {
    let memory = &client.properties().memory;
    whole_pieces(memory.max_page_size, memory.alignment)
}

fn whole_pieces(limit: u64, alignment: u64) -> u64 {
    let piece = alignment.max(PIECE_BYTES);
    limit / piece * piece
}

/// Units of a cube in kernels whose units are independent of each other.
pub(crate) const CUBE_UNITS: u32 = 64;

/// The launch size for `n` independent units; the last cube may have idle units.
pub(crate) fn units(client: &Client, n: usize) -> (CubeCount, CubeDim) {
    let dim = CubeDim::new_1d(CUBE_UNITS);
    // A launch of nothing is one idle cube: kernels check their position anyway.
    (
        calculate_cubes(client, n.div_ceil(dim.x as usize).max(1)),
        dim,
    )
}

/// Groups of `each` buffers that a kernel can be given at once besides `others`; at most `most`. WebGPU promises 8 buffers, other
/// devices have more.
pub(crate) fn at_once(client: &Client, each: usize, others: usize, most: usize) -> usize {
    let bindings = client.properties().hardware.max_bindings as usize;
    (bindings.saturating_sub(others) / each).clamp(1, most)
}

/// `n` cubes, spread over as many axes as the device needs.
pub(crate) fn calculate_cubes(client: &Client, n: usize) -> CubeCount {
    cubecl::calculate_cube_count_elemwise(client, n, CubeDim::new_1d(1))
}

#[cube(launch)]
fn zero_kernel(
    values: &mut [u32], // [length]
    length: u32,
) {
    if ABSOLUTE_POS < length as usize {
        values[ABSOLUTE_POS] = 0u32;
    }
}

/// The value, or zero where it is infinite or not a number.
#[cube]
pub(crate) fn finite_or_zero(value: f32) -> f32 {
    select(is_finite(value), value, 0.0f32)
}

/// Whether the value is neither infinite nor NaN, from its bits.
#[cube]
pub(crate) fn is_finite(value: f32) -> bool {
    (u32::reinterpret(value) & 0x7f80_0000u32) != 0x7f80_0000u32
}
