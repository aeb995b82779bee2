//! The standard 3DGS PLY file: one vertex per Gaussian.

use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::Path;

use dash_kernels::splats::NEAR_PLANE;
use serde::de::{Deserialize, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_ply::{PlyReader, PropertyType};

use crate::{GaussianRows, ModelError};

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
/// columns ignored. Also returns the near plane in world units, see [`write_splat_ply`]; 3DGS's 0.2 where the
/// file names none.
///
/// # Errors
/// [`ModelError::Io`] or [`ModelError::Format`]; the latter also for coordinates that are not finite.
pub fn read_splat_ply(path: &Path) -> Result<(GaussianRows, f64), ModelError> {
    let file = File::open(path).map_err(|e| ModelError::io(path, "open", e))?;
    let mut reader = PlyReader::from_reader(BufReader::new(file))
        .map_err(|e| ModelError::format(path, "a PLY header", e.to_string()))?;
    let near_plane = near_plane_of(&reader.header().comments).map_err(|found| {
        ModelError::format(path, "a positive near plane in the comments", found)
    })?;
    let vertex = reader
        .current_element()
        .filter(|element| element.name == "vertex")
        .cloned()
        .ok_or_else(|| ModelError::format(path, "`vertex` as the first element", "another"))?;
    let names: Vec<&str> = vertex.properties.iter().map(|p| p.name.as_str()).collect();
    if vertex
        .properties
        .iter()
        .any(|p| matches!(p.property_type, PropertyType::List { .. }))
    {
        return Err(ModelError::format(
            path,
            "scalar vertex properties",
            "a list property",
        ));
    }
    let columns = Columns::find(&names).map_err(|missing| {
        ModelError::format(
            path,
            format!("the 3DGS property `{missing}`"),
            names.join(" "),
        )
    })?;
    let table: Table = reader.next_element().map_err(|e| {
        ModelError::format(path, format!("{} vertices", vertex.count), e.to_string())
    })?;
    if table.rows != vertex.count {
        return Err(ModelError::format(
            path,
            format!("{} vertices", vertex.count),
            format!("{} before the end", table.rows),
        ));
    }
    let rows = columns.gather(&table.values, names.len(), path)?;
    Ok((rows, near_plane))
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
/// assert_eq!(read_splat_ply(&path)?, (rows, 0.05));
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
        })
    }

    fn gather(
        &self,
        values: &[f32],
        width: usize,
        path: &Path,
    ) -> Result<GaussianRows, ModelError> {
        let per_channel = self.rest.len() / 3;
        let mut rows = GaussianRows {
            sh_rest_width: self.rest.len(),
            ..Default::default()
        };
        for (index, row) in values.chunks_exact(width).enumerate() {
            let mean = self.means.map(|c| row[c]);
            if mean.iter().any(|v| !v.is_finite()) {
                return Err(ModelError::format(
                    path,
                    "finite positions",
                    format!("{mean:?} at vertex {index}"),
                ));
            }
            rows.means.push(mean);
            rows.sh_dc.push(self.dc.map(|c| row[c]));
            for k in 0..per_channel {
                rows.sh_rest
                    .extend((0..3).map(|channel| row[self.rest[channel * per_channel + k]]));
            }
            rows.opacity_logits.push(row[self.opacity]);
            rows.log_scales.push(self.scales.map(|c| row[c]));
            rows.quats.push(self.quats.map(|c| row[c]));
        }
        Ok(rows)
    }
}

/// All rows of an element, flattened. It grows with the rows read: the header's count is not trusted.
#[derive(Default)]
struct Table {
    values: Vec<f32>,
    rows: usize,
}

impl<'de> Deserialize<'de> for Table {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Rows;
        impl<'de> Visitor<'de> for Rows {
            type Value = Table;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("rows of numbers")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Table, A::Error> {
                let mut table = Table::default();
                while let Some(Row(values)) = seq.next_element()? {
                    table.values.extend(values);
                    table.rows += 1;
                }
                Ok(table)
            }
        }
        deserializer.deserialize_seq(Rows)
    }
}

/// One row's numbers in the order of its properties.
struct Row(Vec<f32>);

impl<'de> Deserialize<'de> for Row {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Numbers;
        impl<'de> Visitor<'de> for Numbers {
            type Value = Row;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("named numbers")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Row, A::Error> {
                let mut values = Vec::new();
                while let Some((_, value)) = map.next_entry::<IgnoredAny, f32>()? {
                    values.push(value);
                }
                Ok(Row(values))
            }
        }
        deserializer.deserialize_map(Numbers)
    }
}
