//! Search for values that are not finite on CubeCL devices.
//!
//! A launch searches six tensors. A unit owns every `stride`-th value of each and raises a tensor's flag if one of them
//! is not finite; units that raise the same flag write the same word. No shared memory, no atomics; deterministic.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{arg, contiguous, is_finite, own_memory, units};

use super::{RAISED, RaiseFlags};

/// Values of the longest tensor that a unit reads.
const VALUES_PER_UNIT: usize = 16;

impl RaiseFlags for CubeBackend {
    fn raise_flags(
        a: CubeTensor,
        b: CubeTensor,
        c: CubeTensor,
        d: CubeTensor,
        e: CubeTensor,
        f: CubeTensor,
        flags: CubeTensor,
        first: usize,
        last: usize,
    ) -> CubeTensor {
        let tensors = [a, b, c, d, e, f].map(contiguous);
        let lengths = tensors.each_ref().map(|tensor| tensor.meta.num_elements());
        let n = lengths.into_iter().fold(0, usize::max);
        if n == 0 {
            return flags;
        }
        let flags = own_memory(flags);
        let client = flags.client.clone();
        let stride = n.div_ceil(VALUES_PER_UNIT);
        let [n_a, n_b, n_c, n_d, n_e, n_f] = lengths.map(|n| n as u32);
        let (count, dim) = units(&client, stride);
        let [a, b, c, d, e, f] = tensors.each_ref().map(arg);
        let lengths = LengthsLaunch::new(n_a, n_b, n_c, n_d, n_e, n_f);
        raise_kernel::launch(
            &client,
            count,
            dim,
            TensorsLaunch::new(a, b, c, d, e, f, lengths),
            arg(&flags),
            first as u32,
            last as u32,
            stride as u32,
        );
        flags
    }
}

/// Lengths of the tensors; their memory may be longer.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
struct Lengths {
    a: u32,
    b: u32,
    c: u32,
    d: u32,
    e: u32,
    f: u32,
}

/// The tensors of a launch.
#[derive(CubeType, CubeLaunch)]
struct Tensors {
    a: Box<[f32]>, // [n.a]
    b: Box<[f32]>, // [n.b]
    c: Box<[f32]>, // [n.c]
    d: Box<[f32]>, // [n.d]
    e: Box<[f32]>, // [n.e]
    f: Box<[f32]>, // [n.f]
    n: Lengths,
}

/// Raises the flag of `slot` if one of this unit's values is not finite.
#[cube]
fn look(
    values: &[f32], // [n]
    n: u32,
    flags: &mut [f32], // [number of tensors]
    slot: u32,
    stride: u32,
) {
    let mut sound = true;
    let mut i = ABSOLUTE_POS;
    while i < n as usize {
        sound = sound && is_finite(values[i]);
        i += stride as usize;
    }
    if !sound {
        flags[slot as usize] = RAISED;
    }
}

/// The tensors' flags start at `first`; tensors after `last` repeat it.
#[cube(launch)]
fn raise_kernel(
    tensors: Tensors,
    flags: &mut [f32], // [number of tensors]
    first: u32,
    last: u32,
    stride: u32,
) {
    if ABSOLUTE_POS >= stride as usize {
        terminate!();
    }
    let n = tensors.n;
    look(&tensors.a, n.a, flags, first, stride);
    look(&tensors.b, n.b, flags, first + u32::min(1u32, last), stride);
    look(&tensors.c, n.c, flags, first + u32::min(2u32, last), stride);
    look(&tensors.d, n.d, flags, first + u32::min(3u32, last), stride);
    look(&tensors.e, n.e, flags, first + u32::min(4u32, last), stride);
    look(&tensors.f, n.f, flags, first + u32::min(5u32, last), stride);
}
