//! NumPy files: `poses_bounds.npy`, one row of 17 numbers per camera, and positions of points.

use std::path::Path;

use npyz::{DType, NpyFile, Order, TypeChar};

use crate::Error;
use crate::files::refuse_pointer;

/// Columns of a row of poses: a 3x5 pose and two depth bounds.
pub(crate) const POSE_COLUMNS: usize = 17;
/// NumPy's own limit (`numpy.lib.format`).
const MAX_HEADER_BYTES: usize = 10_000;
/// Enough for `[n, 17]`; keeps the product of the shape below 2^64.
const MAX_HEADER_DIGITS: usize = 19;
/// Those of the dictionary and of the shape. The parser takes time and memory exponential in the depth
/// of nested brackets.
const MAX_HEADER_BRACKETS: usize = 2;

/// Parses LLFF poses and bounds.
pub(crate) fn parse_poses(path: &Path, bytes: &[u8]) -> Result<Vec<[f64; POSE_COLUMNS]>, Error> {
    let what = "[cameras, 17] of f32 or f64 (LLFF poses and bounds)";
    let rows = parse_rows(path, bytes, what)?;
    if rows.is_empty() {
        return Err(malformed(path, what, "no rows".into()));
    }
    Ok(rows)
}

/// Parses positions of points, of which there may be none.
pub(crate) fn parse_points(path: &Path, bytes: &[u8]) -> Result<Vec<[f64; 3]>, Error> {
    parse_rows(path, bytes, "[points, 3] of f32 or f64 (positions)")
}

/// Parses points with their colours and a label, of which there may be none.
pub(crate) fn parse_cloud(path: &Path, bytes: &[u8]) -> Result<Vec<[f64; 7]>, Error> {
    parse_rows(
        path,
        bytes,
        "[points, 7] of f32 or f64 (positions, colours, a label)",
    )
}

/// Parses an array of rows of f32 or f64, in either memory order and byte order.
fn parse_rows<const COLUMNS: usize>(
    path: &Path,
    bytes: &[u8],
    what: &str,
) -> Result<Vec<[f64; COLUMNS]>, Error> {
    refuse_pointer(path, bytes, &format!("a NumPy array {what}"))?;
    let malformed = |found: String| malformed(path, what, found);
    check_header(bytes).map_err(malformed)?;
    let mut rest = bytes;
    let npy = NpyFile::new(&mut rest).map_err(|e| malformed(e.to_string()))?;
    let item_bytes = match npy.dtype() {
        DType::Plain(scalar)
            if scalar.type_char() == TypeChar::Float && matches!(scalar.size_field(), 4 | 8) =>
        {
            scalar.size_field() as usize
        }
        other => return Err(malformed(format!("elements of type {}", other.descr()))),
    };
    let shape = npy.shape().to_vec();
    let order = npy.order();
    let [n, columns] = shape[..] else {
        return Err(malformed(format!("shape {shape:?}")));
    };
    if columns != COLUMNS as u64 {
        return Err(malformed(format!("shape {shape:?}")));
    }
    let header = npy.header().clone();
    drop(npy);
    let available = rest.len() / (COLUMNS * item_bytes);
    if n > available as u64 {
        return Err(malformed(format!(
            "shape {shape:?} announced but {} bytes of numbers (truncated?)",
            rest.len()
        )));
    }
    let npy = NpyFile::with_header(header, rest);
    let values: Vec<f64> = if item_bytes == 4 {
        npy.into_vec::<f32>()
            .map(|v| v.into_iter().map(f64::from).collect())
    } else {
        npy.into_vec::<f64>()
    }
    .map_err(|e| malformed(e.to_string()))?;
    let n = n as usize;
    let row = |index: usize| {
        std::array::from_fn(|column| match order {
            Order::C => values[index * COLUMNS + column],
            Order::Fortran => values[column * n + index],
        })
    };
    Ok((0..n).map(row).collect())
}

fn malformed(path: &Path, what: &str, found: String) -> Error {
    Error::invalid(
        path,
        format!("a NumPy array {what}"),
        found,
        "write it again with `numpy.save`",
    )
}

/// Refuses headers that the parser behind `npyz` would allocate, recurse or panic on.
fn check_header(bytes: &[u8]) -> Result<(), String> {
    let (length, text) = match bytes {
        [0x93, b'N', b'U', b'M', b'P', b'Y', 1, _, a, b, text @ ..] => {
            (usize::from(u16::from_le_bytes([*a, *b])), text)
        }
        [
            0x93,
            b'N',
            b'U',
            b'M',
            b'P',
            b'Y',
            2 | 3,
            _,
            a,
            b,
            c,
            d,
            text @ ..,
        ] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, text),
        _ => return Err("no NumPy header".into()),
    };
    if length > MAX_HEADER_BYTES {
        return Err(format!("a header of {length} bytes"));
    }
    let text = text
        .get(..length)
        .ok_or("an incomplete header (truncated?)")?;
    let count = |wanted: fn(&u8) -> bool| text.iter().filter(|c| wanted(c)).count();
    if count(|c| !c.is_ascii() || *c == b'\\') > 0
        || count(u8::is_ascii_digit) > MAX_HEADER_DIGITS
        || count(|c| b"([{".contains(c)) > MAX_HEADER_BRACKETS
    {
        let shown: String = text.iter().take(120).map(|&c| char::from(c)).collect();
        return Err(format!("the header {}", shown.escape_debug()));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_kit::{npy, npy_f64};

    fn read(bytes: &[u8]) -> Result<Vec<[f64; POSE_COLUMNS]>, Error> {
        parse_poses(Path::new("poses_bounds.npy"), bytes)
    }

    fn rows() -> Vec<[f64; POSE_COLUMNS]> {
        (0..3)
            .map(|r| std::array::from_fn(|c| f64::from(r) + c as f64 / 32.0))
            .collect()
    }

    #[test]
    fn both_orders_types_and_byte_orders() {
        assert_eq!(read(&npy_f64(&rows())).expect("valid"), rows());
        let mut by_column = Vec::new();
        for column in 0..POSE_COLUMNS {
            for row in rows() {
                by_column.extend((row[column] as f32).to_be_bytes());
            }
        }
        let header = "{'descr': '>f4', 'fortran_order': True, 'shape': (3, 17), }";
        assert_eq!(read(&npy(header, &by_column)).expect("valid"), rows());
    }

    #[test]
    fn every_truncation_is_an_error_naming_the_file() {
        let bytes = npy_f64(&rows());
        for end in 0..bytes.len() {
            let error = read(&bytes[..end]).expect_err("truncated").to_string();
            assert!(error.contains("poses_bounds.npy"), "{error}");
        }
    }

    #[test]
    fn headers_with_more_brackets_than_a_table_needs_are_refused_unparsed() {
        let header = "{'descr': '<f8', 'fortran_order': True, 'shape': (1, 17),{{{{{{{{";
        let error = read(&npy(header, &[0; 8 * 17])).expect_err("malformed");
        assert!(error.to_string().contains("found the header {"), "{error}");
    }

    #[test]
    fn wrong_shapes_types_and_hostile_headers() {
        let nested = format!(
            "{{'descr': '<f8', 'shape': {}1{}, }}",
            "(".repeat(3000),
            ")".repeat(3000)
        );
        let zeros = [0u8; 8 * 17];
        for header in [
            "{'descr': '<f8', 'fortran_order': False, 'shape': (17,), }",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 15), }",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 1, 17), }",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (0, 17), }",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999, 17), }",
            "{'descr': '<f8', 'fortran_order': False, 'shape': (18446744073709551615, 18446744073709551615), }",
            "{'descr': '|O', 'fortran_order': False, 'shape': (1, 17), }",
            "{'descr': '|O8', 'fortran_order': False, 'shape': (1, 17), }",
            "{'descr': '<i8', 'fortran_order': False, 'shape': (1, 17), }",
            "{'descr': '<f2', 'fortran_order': False, 'shape': (1, 17), }",
            "{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (1, 17), }",
            "{'descr': '€', 'fortran_order': False, 'shape': (1, 17), }",
            "{'descr': '\\u20ac', 'fortran_order': False, 'shape': (1, 17), }",
            "{'fortran_order': False, 'shape': (1, 17), }",
            "[]",
            "",
            &nested,
        ] {
            assert!(read(&npy(header, &zeros)).is_err(), "{header}");
        }
        // A header length beyond the file.
        assert!(read(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}").is_err());
    }
}
