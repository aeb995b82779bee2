//! Search for values that are not finite on the CPU: one pass at the speed of memory.

use rayon::prelude::*;

use crate::isa::{Kernel, dispatch};

/// Values per parallel piece; a smaller tensor is not worth waking threads for.
const PIECE: usize = 1 << 16;
/// Values between two checks whether to stop.
const GROUP: usize = 1 << 12;
/// Bits of an infinity without its sign; those of every NaN are greater.
const INFINITE: u32 = 0x7f80_0000;
const WITHOUT_SIGN: u32 = 0x7fff_ffff;

/// Whether every value is finite.
pub(super) fn all_finite(values: &[f32]) -> bool {
    if values.len() <= PIECE {
        return dispatch(Piece(values));
    }
    values
        .par_chunks(PIECE)
        .all(|values| dispatch(Piece(values)))
}

/// Rows of `width` values of which one is not finite; none where `width` is 0.
pub(super) fn broken_rows(values: &[f32], width: usize) -> impl Iterator<Item = usize> + '_ {
    let n = if width == 0 { 0 } else { values.len() };
    let rows = values[..n].chunks(width.max(1)).enumerate();
    rows.filter(|(_, row)| !row.iter().all(|value| value.is_finite()))
        .map(|(row, _)| row)
}

struct Piece<'a>(&'a [f32]);

impl Kernel for Piece<'_> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        self.0.chunks(GROUP).all(|group| {
            let bits = group.iter().map(|value| value.to_bits() & WITHOUT_SIGN);
            bits.fold(0, u32::max) < INFINITE
        })
    }
}
