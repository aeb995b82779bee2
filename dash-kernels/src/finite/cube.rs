//! Search for values that are not finite on CubeCL devices.
//!
//! A launch searches up to [`AT_ONCE`] tensors. A unit owns every `stride`-th value of each, raises the tensor's flag if one
//! of them is not finite, and marks its row; units that raise the same flag write the same word. No shared memory, no
//! atomics; deterministic.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{arg, at_once, contiguous, is_finite, own_memory, units};
use crate::tensor_list::TensorList;

use super::{RAISED, RaiseFlags, Slot, Slots};

/// Values of the longest tensor that a unit reads.
const VALUES_PER_UNIT: usize = 16;
/// Most tensors of a launch.
const AT_ONCE: usize = 24;

impl RaiseFlags for CubeBackend {
    fn raise_flags(
        TensorList(tensors): TensorList<Self>,
        flags: CubeTensor,
        slots: Slots,
    ) -> CubeTensor {
        let flags = own_memory(flags);
        let client = flags.client.clone();
        let tensors: Vec<CubeTensor> = tensors.into_iter().map(contiguous).collect();
        // One more holds the flags.
        let n = at_once(&client, 1, 1, AT_ONCE);
        for (tensors, slots_of_group) in tensors.chunks(n).zip(slots.each.chunks(n)) {
            let lengths = tensors.iter().map(|tensor| tensor.meta.num_elements());
            let stride = lengths.fold(0, usize::max).div_ceil(VALUES_PER_UNIT);
            let (count, dim) = units(&client, stride);
            let searched = tensors.iter().zip(slots_of_group);
            raise_kernel::launch(
                &client,
                count,
                dim,
                searched
                    .map(|(tensor, slot)| launched(tensor, slot))
                    .collect(),
                arg(&flags),
                slots.any as u32,
                stride as u32,
            );
        }
        flags
    }
}

/// A tensor, its length (its memory may be longer), its flag, its first mark and values in a row, and where its first value
/// is copied to.
#[derive(CubeType, CubeLaunch)]
struct Searched {
    values: Box<[f32]>, // [n]
    n: u32,
    flag: u32,
    marks: u32,
    width: u32,
    copies: u32,
    copy: u32,
}

fn launched(tensor: &CubeTensor, slot: &Slot) -> SearchedLaunch {
    let copies = slot.copy.is_some() as u32;
    SearchedLaunch::new(
        arg(tensor),
        tensor.meta.num_elements() as u32,
        slot.flag as u32,
        slot.marks.0 as u32,
        slot.marks.1 as u32,
        copies,
        slot.copy.unwrap_or(0) as u32,
    )
}

#[cube(launch)]
fn raise_kernel(
    tensors: Sequence<Searched>,
    flags: &mut [f32], // [F]
    any: u32,
    stride: u32,
) {
    if ABSOLUTE_POS >= stride as usize {
        terminate!();
    }
    #[unroll]
    for k in 0..tensors.len() {
        let tensor = tensors.index(k);
        if tensor.copies > 0u32 && ABSOLUTE_POS == 0 {
            flags[tensor.copy as usize] = tensor.values[0usize];
        }
        let mut i = ABSOLUTE_POS;
        while i < tensor.n as usize {
            if !is_finite(tensor.values[i]) {
                flags[any as usize] = RAISED;
                flags[tensor.flag as usize] = RAISED;
                let has_marks = tensor.width > 0u32;
                if has_marks {
                    flags[(tensor.marks + i as u32 / tensor.width) as usize] = RAISED;
                }
            }
            i += stride as usize;
        }
    }
}
