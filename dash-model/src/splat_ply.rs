//! The standard 3DGS PLY file: one vertex per Gaussian. SuperSplat's compressed PLY is read, too.

mod compressed;
mod filter;
mod table;
#[cfg(test)]
mod tests;
mod values;

use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::Path;

use dash_kernels::splats::NEAR_PLANE;
use serde_ply::PlyReader;

use table::Table;
pub use values::LeftOut;

use crate::{GaussianRows, ModelError};

/// What a file of Gaussians holds.
#[derive(Debug, Clone, PartialEq)]
pub struct SplatFile {
    /// The Gaussians that can be seen.
    pub rows: GaussianRows,
    /// The near plane in world units, see [`write_splat_ply`]; 3DGS's 0.2 where the file names none.
    pub near_plane: f64,
    /// How many others the file has.
    pub left_out: LeftOut,
}

impl SplatFile {
    /// What a file's rows are as drawn.
    pub(crate) fn of(rows: GaussianRows, near_plane: f64, path: &Path) -> Result<Self, ModelError> {
        let (rows, left_out) = values::settled(rows, path)?;
        Ok(Self {
            rows,
            near_plane,
            left_out,
        })
    }
}

/// Higher SH coefficients per channel of degrees 0 to 3.
const REST_COUNTS: [usize; 4] = [0, 3, 8, 15];

/// The comment of the header that holds the near plane; the number follows.
const NEAR_PLANE_COMMENT: &str = "dash near_plane";

/// The near plane in a header's comments; that of 3DGS where there is none.
fn near_plane_of(comments: &[String]) -> Result<f64, String> {
    let Some(text) = comments
        .iter()
        .find_map(|comment| comment.strip_prefix(NEAR_PLANE_COMMENT))
    else {
        return Ok(NEAR_PLANE);
    };
    let value = text.trim().parse::<f64>().ok();
    value
        .filter(|v| v.is_finite() && *v > 0.0)
        .ok_or_else(|| format!("`comment {NEAR_PLANE_COMMENT}{text}`"))
}

/// Reads a standard 3DGS PLY: `x y z f_dc_* f_rest_* opacity scale_* rot_*`, ASCII or binary, other
/// columns ignored; or SuperSplat's compressed PLY. Where there is Mip-Splatting's `filter_3D`, Gaussians are read as they are
/// drawn with it. Infinite and extreme values that have a limit are brought to where
/// they are drawn as that limit says.
///
/// # Errors
/// [`ModelError::Io`] or [`ModelError::Format`]; the latter, with row and property, also for values that have no limit:
/// NaN, and infinite positions, rotations and colours.
pub fn read_splat_ply(path: &Path) -> Result<SplatFile, ModelError> {
    let mut reader = open(path)?;
    let near_plane = near_plane_of(&reader.header().comments).map_err(|found| {
        ModelError::format(path, "a positive near plane in the comments", found)
    })?;
    let first = reader
        .current_element()
        .map(|element| element.name.as_str());
    let rows = match first {
        Some(compressed::CHUNK) => compressed::read(&mut reader, path)?,
        _ => read_standard(&mut reader, path)?,
    };
    SplatFile::of(rows, near_plane, path)
}

/// Whether a PLY file is one of Gaussians, whole or damaged, and not one of points: by the names in its header. `false`
/// where there is no readable header.
pub fn is_splat_ply(path: &Path) -> bool {
    let Ok(reader) = open(path) else {
        return false;
    };
    let elements = reader.header().elem_defs.iter();
    let names: Vec<&str> = elements.flat_map(table::names).collect();
    let has = |prefix: &str| names.iter().any(|name| name.starts_with(prefix));
    let kinds = ["f_dc_", "opacity", "scale_", "rot_"];
    kinds.into_iter().filter(|kind| has(kind)).count() >= 2 || has("packed_")
}

fn open(path: &Path) -> Result<PlyReader<BufReader<File>>, ModelError> {
    let file = File::open(path).map_err(|e| ModelError::io(path, "open", e))?;
    PlyReader::from_reader(BufReader::new(file))
        .map_err(|e| ModelError::format(path, "a PLY header", e.to_string()))
}

fn read_standard(
    reader: &mut PlyReader<BufReader<File>>,
    path: &Path,
) -> Result<GaussianRows, ModelError> {
    let vertex = reader
        .current_element()
        .filter(|element| element.name == "vertex")
        .cloned()
        .ok_or_else(|| ModelError::format(path, "`vertex` as the first element", "another"))?;
    let names = table::names(&vertex);
    let columns = Columns::find(&names).map_err(|missing| {
        ModelError::format(
            path,
            format!("the 3DGS property `{missing}`"),
            names.join(" "),
        )
    })?;
    let table = table::read(reader, &vertex, path)?;
    if let Some(filter) = columns.filter {
        let widths = table
            .values
            .chunks_exact(names.len())
            .map(|row| row[filter]);
        if let Some((row, width)) = filter::refused(widths) {
            return Err(ModelError::format(
                path,
                "numbers that can be drawn",
                format!("`{}` {width} at vertex {row}", filter::COLUMN),
            ));
        }
    }
    Ok(columns.gather(&table, names.len()))
}

/// Writes a standard binary 3DGS PLY through a sibling scratch file.
///
/// The format has no column for the near plane (world units). Where it is not that of 3DGS it becomes a comment of the
/// header, which [`read_splat_ply`] understands and other readers skip.
///
/// # Example
/// ```
/// use dash_model::{GaussianRows, read_splat_ply, write_splat_ply};
///
/// let rows = GaussianRows::from_points(&[[0.0; 3], [0.5; 3]], &[[0.8; 3]; 2], 3, 0.1);
/// let path = std::env::temp_dir().join(format!("dash-{}.ply", std::process::id()));
/// write_splat_ply(&path, &rows, 0.05)?;
/// let read = read_splat_ply(&path)?;
/// assert_eq!((read.rows, read.near_plane), (rows, 0.05));
/// # std::fs::remove_file(path).expect("written above");
/// # Ok::<(), dash_model::ModelError>(())
/// ```
///
/// # Errors
/// [`ModelError::Io`].
pub fn write_splat_ply(
    path: &Path,
    rows: &GaussianRows,
    near_plane: f64,
) -> Result<(), ModelError> {
    let per_channel = rows.sh_rest_width / 3;
    let mut names: Vec<String> = ["x", "y", "z", "nx", "ny", "nz"].map(String::from).to_vec();
    names.extend((0..3).map(|i| format!("f_dc_{i}")));
    names.extend((0..rows.sh_rest_width).map(|i| format!("f_rest_{i}")));
    names.push("opacity".into());
    names.extend((0..3).map(|i| format!("scale_{i}")));
    names.extend((0..4).map(|i| format!("rot_{i}")));

    crate::scene_file::write_atomically(path, |file| {
        let mut out = BufWriter::new(file);
        writeln!(out, "ply\nformat binary_little_endian 1.0")?;
        if near_plane != NEAR_PLANE {
            writeln!(out, "comment {NEAR_PLANE_COMMENT} {near_plane}")?;
        }
        writeln!(out, "element vertex {}", rows.len())?;
        for name in &names {
            writeln!(out, "property float {name}")?;
        }
        writeln!(out, "end_header")?;
        for row in 0..rows.len() {
            let mut values = Vec::with_capacity(names.len());
            values.extend(rows.means[row]);
            values.extend([0.0; 3]);
            values.extend(rows.sh_dc[row]);
            let rest = &rows.sh_rest[row * rows.sh_rest_width..][..rows.sh_rest_width];
            for channel in 0..3 {
                values.extend((0..per_channel).map(|k| rest[3 * k + channel]));
            }
            values.push(rows.opacity_logits[row]);
            values.extend(rows.log_scales[row]);
            values.extend(rows.quats[row]);
            for value in values {
                out.write_all(&value.to_le_bytes())?;
            }
        }
        out.flush()
    })
}

/// The column of each attribute in a file's rows.
struct Columns {
    means: [usize; 3],
    dc: [usize; 3],
    rest: Vec<usize>,
    opacity: usize,
    scales: [usize; 3],
    quats: [usize; 4],
    filter: Option<usize>,
}

impl Columns {
    fn find(names: &[&str]) -> Result<Self, String> {
        let column = |name: String| names.iter().position(|n| *n == name).ok_or(name);
        let columns = |prefix: &str, count: usize| {
            (0..count)
                .map(|i| column(format!("{prefix}{i}")))
                .collect::<Result<Vec<_>, _>>()
        };
        let fixed = |found: Vec<usize>| [found[0], found[1], found[2]];
        let n_rest = names.iter().filter(|n| n.starts_with("f_rest_")).count();
        if !REST_COUNTS.contains(&(n_rest / 3)) || n_rest % 3 != 0 {
            return Err(format!("f_rest_{n_rest} (0, 9, 24 or 45 of them)"));
        }
        let quats = columns("rot_", 4)?;
        Ok(Self {
            means: [
                column("x".into())?,
                column("y".into())?,
                column("z".into())?,
            ],
            dc: fixed(columns("f_dc_", 3)?),
            rest: columns("f_rest_", n_rest)?,
            opacity: column("opacity".into())?,
            scales: fixed(columns("scale_", 3)?),
            quats: [quats[0], quats[1], quats[2], quats[3]],
            filter: column(filter::COLUMN.into()).ok(),
        })
    }

    fn gather(&self, table: &Table<f32>, width: usize) -> GaussianRows {
        let per_channel = self.rest.len() / 3;
        let mut rows = GaussianRows {
            sh_rest_width: self.rest.len(),
            ..Default::default()
        };
        for row in table.values.chunks_exact(width) {
            rows.means.push(self.means.map(|c| row[c]));
            rows.sh_dc.push(self.dc.map(|c| row[c]));
            rest_from_file(&mut rows.sh_rest, per_channel, |k| row[self.rest[k]]);
            let width = self.filter.map_or(0.0, |c| row[c]);
            let log_scales = self.scales.map(|c| row[c]);
            let (log_scales, logit) = filter::filtered(log_scales, row[self.opacity], width);
            rows.opacity_logits.push(logit);
            rows.log_scales.push(log_scales);
            rows.quats.push(self.quats.map(|c| row[c]));
        }
        rows
    }
}

/// Appends a row's coefficients: files have one channel after the other, rows have the channels next to each other.
fn rest_from_file(rest: &mut Vec<f32>, per_channel: usize, at: impl Fn(usize) -> f32) {
    for k in 0..per_channel {
        rest.extend((0..3).map(|channel| at(channel * per_channel + k)));
    }
}
