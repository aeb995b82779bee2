//! Feature tables without their rows of zeros.
//!
//! `NAME` holds the other rows only, and `NAME.marks` is a bit mask of them: one bit for each row of the table, from the
//! lowest bit of the first byte. One more byte counts the unused bits of the last byte of bits.

use std::collections::BTreeMap;
use std::path::Path;

use burn::tensor::f16;

use super::tensors::{self, Stored};
use crate::ModelError;
use crate::parameters::HostTensor;

/// The name of a table's mask.
pub(super) fn marks_of(name: &str) -> String {
    format!("{name}{SUFFIX}")
}

const SUFFIX: &str = ".marks";
/// Most values in a row. A file that stores no row could claim any width.
const MAX_WIDTH: usize = 8;
/// Most bytes of memory that a table may take for each of its bytes in the file.
const MOST_PER_BYTE: usize = 32;

/// The mask of a table `[N, F]`, and its rows that have a bit set; `None` where that saves no space at
/// `bytes_per_value`.
pub(super) fn marked(tensor: &HostTensor, bytes_per_value: usize) -> Option<(Vec<u8>, HostTensor)> {
    let (n, _) = shape(tensor)?;
    let (rows, kept) = tensors::rows_with_bits(tensor)?;
    let mut marks = vec![0u8; n.div_ceil(8)];
    for row in rows {
        marks[row as usize / 8] |= 1 << (row % 8);
    }
    marks.push((8 * marks.len() - n) as u8);
    let saved = bytes_per_value * (tensor.values.len() - kept.values.len());
    let worthwhile =
        saved > marks.len() && is_allowed(tensor.values.len(), &marks, kept.values.len());
    worthwhile.then_some((marks, kept))
}

/// The inverse; `None` unless the mask has one set bit for each row of `kept`.
fn unmarked(kept: &HostTensor, marks_and_count: &[u8]) -> Option<HostTensor> {
    let (_, width) = shape(kept)?;
    let (&unused, marks) = marks_and_count.split_last()?;
    let n = (8 * marks.len()).checked_sub(usize::from(unused))?;
    let is_marked = |row: usize| marks[row / 8] >> (row % 8) & 1 == 1;
    let fit = unused < 8 && is_allowed(n.checked_mul(width)?, marks_and_count, kept.values.len());
    if !fit {
        return None;
    }
    let rows: Option<Vec<u32>> = (0..8 * marks.len())
        .filter(|&row| is_marked(row))
        .map(|row| u32::try_from(row).ok())
        .collect();
    tensors::with_zero_rows(kept, &rows?, n)
}

/// Whether a table of `n_values` stays within [`MOST_PER_BYTE`].
fn is_allowed(n_values: usize, marks: &[u8], n_stored: usize) -> bool {
    let in_file = marks.len() + size_of::<f16>() * n_stored;
    n_values <= MOST_PER_BYTE / size_of::<f32>() * in_file
}

/// Rows of a table, and values in each; `None` where these are none or more than [`MAX_WIDTH`].
fn shape(tensor: &HostTensor) -> Option<(usize, usize)> {
    let &[n, width] = tensor.shape.as_slice() else {
        return None;
    };
    (1..=MAX_WIDTH).contains(&width).then_some((n, width))
}

/// Puts the rows of zeros back into the tables. Masks of other tensors stay.
///
/// # Errors
/// [`ModelError::Format`] when a mask does not fit its table.
pub(super) fn fill_in(
    stored: &mut BTreeMap<String, Stored>,
    is_table: impl Fn(&str) -> bool,
    path: &Path,
) -> Result<(), ModelError> {
    let tables: Vec<String> = stored
        .keys()
        .filter_map(|name| name.strip_suffix(SUFFIX))
        .filter(|name| is_table(name))
        .map(String::from)
        .collect();
    for name in tables {
        let marks = match stored.get(&marks_of(&name)) {
            Some(Stored::Marks(marks)) => marks.clone(),
            _ => continue,
        };
        stored.remove(&marks_of(&name));
        let whole = match stored.get(&name) {
            Some(Stored::Single(kept)) => unmarked(kept, &marks),
            _ => None,
        };
        let whole = whole.ok_or_else(|| {
            ModelError::format(
                path,
                format!(
                    "in `{}` a set bit for each row of `{name}`",
                    marks_of(&name)
                ),
                format!("a mask of {} bytes that does not fit", marks.len()),
            )
        })?;
        stored.insert(name, Stored::Single(whole));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tensor(rows: &[[f32; 2]]) -> HostTensor {
        HostTensor {
            shape: vec![rows.len(), 2],
            values: rows.concat(),
        }
    }

    #[test]
    fn rows_of_zeros_take_a_bit_each() {
        for n in [8, 11, 16, 17] {
            let mut rows = vec![[0.0; 2]; n];
            rows[1] = [0.0, 2.0];
            // A negative zero has a bit set, and files keep every bit.
            rows[n - 2] = [-0.0, 0.0];
            rows[n - 1] = [f32::NAN, 3.0];
            let whole = tensor(&rows);
            let (marks, kept) = marked(&whole, 4).expect("most rows are zero");
            assert_eq!(kept.shape, [3, 2]);
            assert_eq!(marks.len(), n.div_ceil(8) + 1);
            let back = unmarked(&kept, &marks).expect("what was taken out goes in");
            let bits = |t: &HostTensor| t.values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert_eq!((bits(&back), back.shape), (bits(&whole), whole.shape));
        }
    }

    #[test]
    fn marks_are_made_only_where_they_save_room() {
        let full = tensor(&[[1.0; 2]; 40]);
        assert!(marked(&full, 4).is_none());
        // A row of four bytes less, and six bytes of marks; then two rows.
        let mut rows = [[1.0; 2]; 40];
        rows[3] = [0.0; 2];
        assert!(marked(&tensor(&rows), 2).is_none());
        rows[4] = [0.0; 2];
        assert!(marked(&tensor(&rows), 2).is_some());
        let no_rows = HostTensor {
            shape: vec![0, 2],
            values: Vec::new(),
        };
        assert!(marked(&no_rows, 4).is_none());
    }

    #[test]
    fn marks_that_do_not_fit_are_refused() {
        let kept = tensor(&[[1.0; 2], [2.0; 2]]);
        assert!(unmarked(&kept, &[0b11, 6]).is_some());
        // None, no bits at all, too few, too many, beyond the last row, more unused bits than there are.
        for marks in [
            &[][..],
            &[0],
            &[0b1, 6],
            &[0b111, 5],
            &[0b110, 6],
            &[0b11, 8],
            &[0b11, 255],
        ] {
            assert!(unmarked(&kept, marks).is_none(), "{marks:?}");
        }
        // Nothing, of rows that would fill all memory.
        let vast = HostTensor {
            shape: vec![0, 1 << 60],
            values: Vec::new(),
        };
        assert!(unmarked(&vast, &[0, 0]).is_none());
        // Eight rows for a byte, of eight values.
        let hollow = HostTensor {
            shape: vec![0, 8],
            values: Vec::new(),
        };
        assert!(unmarked(&hollow, &[0; 1000]).is_none());
    }
}
