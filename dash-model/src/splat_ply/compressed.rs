//! SuperSplat's compressed PLY: Gaussians in chunks of 256, whose values are fractions of their chunk's range.
//!
//! | element | properties |
//! | --- | --- |
//! | `chunk` | `min_` and `max_` of `x y z`, of `scale_x scale_y scale_z` and, in newer files, of `r g b` |
//! | `vertex` | `packed_position` and `packed_scale` of 11, 10 and 11 bits, `packed_rotation` of 2 and three times 10 bits, `packed_color` of four times 8 bits |
//! | `sh` | 9, 24 or 45 bytes `f_rest_*`; missing without view-dependent colour |

use std::f64::consts::SQRT_2;
use std::io::BufRead;
use std::path::Path;

use serde_ply::{ElementDef, PlyReader};

use super::table::{self, Table};
use super::{REST_COUNTS, rest_from_file};
use crate::gaussians::{SH_C0, logit};
use crate::{GaussianRows, ModelError};

/// The first element of such a file.
pub(super) const CHUNK: &str = "chunk";
const CHUNK_ROWS: usize = 256;
const PACKED: [&str; 4] = [
    "packed_position",
    "packed_rotation",
    "packed_scale",
    "packed_color",
];
/// Coefficients of colour lie in (-4, 4).
const SH_RANGE: f64 = 8.0;

/// Ranges by chunk, from the columns of three properties.
struct Ranges {
    table: Table<f32>,
    width: usize,
    positions: [[usize; 3]; 2],
    scales: [[usize; 3]; 2],
    /// `None` where colours are in [0, 1].
    colors: Option<[[usize; 3]; 2]>,
}

impl Ranges {
    fn find(element: &ElementDef, table: Table<f32>, path: &Path) -> Result<Self, ModelError> {
        let names = table::names(element);
        let column = |name: String| names.iter().position(|n| *n == name).ok_or(name);
        let range = |values: [&str; 3]| -> Result<[[usize; 3]; 2], String> {
            let mut columns = [[0; 3]; 2];
            for (bound, columns) in ["min_", "max_"].iter().zip(&mut columns) {
                for (value, at) in values.iter().zip(columns) {
                    *at = column(format!("{bound}{value}"))?;
                }
            }
            Ok(columns)
        };
        let lacks = |name: String| {
            let expected = format!("the property `{name}` of `{CHUNK}`");
            ModelError::format(path, expected, names.join(" "))
        };
        let has_colors = names.contains(&"min_r");
        Ok(Self {
            positions: range(["x", "y", "z"]).map_err(lacks)?,
            scales: range(["scale_x", "scale_y", "scale_z"]).map_err(lacks)?,
            colors: has_colors
                .then(|| range(["r", "g", "b"]))
                .transpose()
                .map_err(lacks)?,
            width: names.len(),
            table,
        })
    }

    /// The values at these fractions of the ranges of a row's chunk.
    fn at(&self, row: usize, [low, high]: [[usize; 3]; 2], fractions: [f64; 3]) -> [f32; 3] {
        let chunk = &self.table.values[row / CHUNK_ROWS * self.width..][..self.width];
        std::array::from_fn(|k| {
            let [low, high] = [low, high].map(|columns| f64::from(chunk[columns[k]]));
            // An infinite bound stays what it is at its own end.
            match fractions[k] {
                0.0 => low as f32,
                1.0 => high as f32,
                t => (low * (1.0 - t) + high * t) as f32,
            }
        })
    }
}

/// The Gaussians of a file whose header was read.
pub(super) fn read(
    reader: &mut PlyReader<impl BufRead>,
    path: &Path,
) -> Result<GaussianRows, ModelError> {
    let chunks = next(reader, CHUNK, path)?;
    let ranges = Ranges::find(&chunks, table::read(reader, &chunks, path)?, path)?;
    let vertices = next(reader, "vertex", path)?;
    if chunks.count.saturating_mul(CHUNK_ROWS) < vertices.count {
        let expected = format!(
            "a chunk for every {CHUNK_ROWS} of {} vertices",
            vertices.count
        );
        return Err(ModelError::format(path, expected, chunks.count.to_string()));
    }
    let names = table::names(&vertices);
    let mut columns = [0; 4];
    for (name, at) in PACKED.iter().zip(&mut columns) {
        *at = names.iter().position(|n| n == name).ok_or_else(|| {
            ModelError::format(path, format!("the property `{name}`"), names.join(" "))
        })?;
    }
    let packed: Table<u32> = table::read(reader, &vertices, path)?;
    let mut rows = GaussianRows::default();
    for (index, row) in packed.values.chunks_exact(names.len()).enumerate() {
        unpack(&mut rows, index, columns.map(|column| row[column]), &ranges);
    }
    if reader.current_element().is_some() {
        read_sh(reader, &mut rows, path)?;
    }
    Ok(rows)
}

/// The element that comes next, which must have this name.
fn next(
    reader: &PlyReader<impl BufRead>,
    name: &str,
    path: &Path,
) -> Result<ElementDef, ModelError> {
    let element = reader.current_element().cloned();
    let found = element
        .as_ref()
        .map_or("the end".into(), |element| format!("`{}`", element.name));
    element
        .filter(|element| element.name == name)
        .ok_or_else(|| ModelError::format(path, format!("the element `{name}`"), found))
}

fn unpack(rows: &mut GaussianRows, index: usize, packed: [u32; 4], ranges: &Ranges) {
    let [position, rotation, scale, color] = packed;
    rows.means
        .push(ranges.at(index, ranges.positions, of_three(position)));
    rows.log_scales
        .push(ranges.at(index, ranges.scales, of_three(scale)));
    rows.quats.push(quaternion(rotation));
    let [r, g, b, alpha] = [24, 16, 8, 0].map(|shift| fraction(color, shift, 8));
    let rgb = match ranges.colors {
        Some(colors) => ranges.at(index, colors, [r, g, b]),
        None => [r, g, b].map(|v| v as f32),
    };
    rows.sh_dc.push(rgb.map(|v| (v - 0.5) / SH_C0));
    rows.opacity_logits.push(logit(alpha as f32));
}

/// Bits of a number as a fraction of the most that they can hold.
fn fraction(packed: u32, shift: u32, bits: u32) -> f64 {
    let most = (1 << bits) - 1;
    f64::from(packed >> shift & most) / f64::from(most)
}

/// 11, 10 and 11 bits.
fn of_three(packed: u32) -> [f64; 3] {
    [(21, 11), (11, 10), (0, 11)].map(|(shift, bits)| fraction(packed, shift, bits))
}

/// The place of the largest component in 2 bits, and the others in 10 bits each, in order.
fn quaternion(packed: u32) -> [f32; 4] {
    let others = [20, 10, 0].map(|shift| (fraction(packed, shift, 10) - 0.5) * SQRT_2);
    let rest: f64 = others.iter().map(|v| v * v).sum();
    let largest = (packed >> 30) as usize;
    let mut others = others.into_iter();
    std::array::from_fn(|k| match k == largest {
        true => (1.0 - rest).max(0.0).sqrt() as f32,
        false => others.next().unwrap_or_default() as f32,
    })
}

fn read_sh(
    reader: &mut PlyReader<impl BufRead>,
    rows: &mut GaussianRows,
    path: &Path,
) -> Result<(), ModelError> {
    let element = next(reader, "sh", path)?;
    let names = table::names(&element);
    let expected: Vec<String> = (0..names.len()).map(|k| format!("f_rest_{k}")).collect();
    let per_channel = names.len() / 3;
    let is_complete = names.len().is_multiple_of(3) && REST_COUNTS[1..].contains(&per_channel);
    if !is_complete || names != expected || element.count != rows.len() {
        return Err(ModelError::format(
            path,
            format!(
                "9, 24 or 45 properties f_rest_0, .. of `sh` for each of {} vertices",
                rows.len()
            ),
            format!("{} rows of {}", element.count, names.join(" ")),
        ));
    }
    let table: Table<u8> = table::read(reader, &element, path)?;
    let value = |byte: u8| match byte {
        0 => -0.5 * SH_RANGE,
        255 => 0.5 * SH_RANGE,
        byte => ((f64::from(byte) + 0.5) / 256.0 - 0.5) * SH_RANGE,
    };
    rows.sh_rest_width = names.len();
    for row in table.values.chunks_exact(names.len()) {
        rest_from_file(&mut rows.sh_rest, per_channel, |k| value(row[k]) as f32);
    }
    Ok(())
}
