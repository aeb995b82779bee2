//! The look through a tensor on CubeCL devices.
//!
//! A unit owns every `stride`-th value and raises the flag if one of them is not finite; units that
//! raise the same flag write the same word. No shared memory, no atomics; deterministic.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{arg, contiguous, is_finite, own_memory, units};

use super::{RAISED, RaiseFlag};

/// Values that a unit looks at.
const VALUES_PER_UNIT: usize = 16;

impl RaiseFlag for CubeBackend {
    fn raise_flag(values: CubeTensor, flags: CubeTensor, slot: usize) -> CubeTensor {
        let values = contiguous(values);
        let n = values.meta.num_elements();
        if n == 0 {
            return flags;
        }
        let flags = own_memory(flags);
        let client = flags.client.clone();
        let stride = n.div_ceil(VALUES_PER_UNIT);
        let (count, dim) = units(&client, stride);
        raise_kernel::launch(
            &client,
            count,
            dim,
            arg(&values),
            arg(&flags),
            slot as u32,
            n as u32,
            stride as u32,
        );
        flags
    }
}

#[cube(launch)]
fn raise_kernel(values: &[f32], flags: &mut [f32], slot: u32, n: u32, stride: u32) {
    if ABSOLUTE_POS >= stride as usize {
        terminate!();
    }
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
