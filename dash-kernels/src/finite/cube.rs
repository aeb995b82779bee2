//! Search for values that are not finite on CubeCL devices.
//!
//! A launch searches six tensors. A unit owns every `stride`-th value of each, raises the tensor's flag if one of them is not
//! finite, and marks its row; units that raise the same flag write the same word. No shared memory, no atomics;
//! deterministic.

use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{arg, contiguous, is_finite, own_memory, units};

use super::{AT_ONCE, RAISED, RaiseFlags, Slots};

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
        slots: Slots,
    ) -> CubeTensor {
        let tensors: [CubeTensor; AT_ONCE] = [a, b, c, d, e, f].map(contiguous);
        let lengths = tensors.each_ref().map(|tensor| tensor.meta.num_elements());
        let n = lengths.into_iter().fold(0, usize::max);
        let flags = own_memory(flags);
        let client = flags.client.clone();
        let stride = n.div_ceil(VALUES_PER_UNIT);
        let (count, dim) = units(&client, stride);
        let place = |k: usize| {
            let (marks, width) = slots.marks[k];
            let [n, flag, marks, width] =
                [lengths[k], slots.flags[k], marks, width].map(|value| value as u32);
            PlaceLaunch::new(n, flag, marks, width)
        };
        let places = PlacesLaunch::new(place(0), place(1), place(2), place(3), place(4), place(5));
        let [a, b, c, d, e, f] = tensors.each_ref().map(arg);
        raise_kernel::launch(
            &client,
            count,
            dim,
            TensorsLaunch::new(a, b, c, d, e, f, places),
            arg(&flags),
            slots.any as u32,
            stride as u32,
        );
        flags
    }
}

/// A tensor's length (its memory may be longer), its flag, its first mark and values in a row.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
struct Place {
    n: u32,
    flag: u32,
    marks: u32,
    width: u32,
}

/// Those of each tensor.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
struct Places {
    a: Place,
    b: Place,
    c: Place,
    d: Place,
    e: Place,
    f: Place,
}

/// The tensors of a launch.
#[derive(CubeType, CubeLaunch)]
struct Tensors {
    a: Box<[f32]>, // [places.a.n]
    b: Box<[f32]>, // [places.b.n]
    c: Box<[f32]>, // [places.c.n]
    d: Box<[f32]>, // [places.d.n]
    e: Box<[f32]>, // [places.e.n]
    f: Box<[f32]>, // [places.f.n]
    places: Places,
}

/// Raises flags and marks of this unit's values that are not finite.
#[cube]
fn look(
    values: &[f32],    // [place.n]
    flags: &mut [f32], // [F]
    place: Place,
    any: u32,
    stride: u32,
) {
    let mut i = ABSOLUTE_POS;
    while i < place.n as usize {
        if !is_finite(values[i]) {
            flags[any as usize] = RAISED;
            flags[place.flag as usize] = RAISED;
            let has_marks = place.width > 0;
            if has_marks {
                flags[(place.marks + i as u32 / place.width) as usize] = RAISED;
            }
        }
        i += stride as usize;
    }
}

#[cube(launch)]
fn raise_kernel(
    tensors: Tensors,
    flags: &mut [f32], // [F]
    any: u32,
    stride: u32,
) {
    if ABSOLUTE_POS >= stride as usize {
        terminate!();
    }
    let places = tensors.places;
    look(&tensors.a, flags, places.a, any, stride);
    look(&tensors.b, flags, places.b, any, stride);
    look(&tensors.c, flags, places.c, any, stride);
    look(&tensors.d, flags, places.d, any, stride);
    look(&tensors.e, flags, places.e, any, stride);
    look(&tensors.f, flags, places.f, any, stride);
}
