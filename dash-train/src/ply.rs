//! Point clouds in PLY files.

use std::fs;
use std::io::{BufWriter, Cursor, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_ply::{ElementDef, PlyFormat, PlyReader, PropertyType, ScalarType, SerializeOptions};

use crate::Error;
use crate::files::refuse_pointer;

/// Colour of points whose file states none.
const NEUTRAL_GRAY: u8 = 128;
/// A colour value above is of a file whose white is 255, or of a highlight.
const BRIGHTEST: f64 = 1.5;
/// Share of highlights among the colour values of a file whose white is 1, at most.
const MAX_HIGHLIGHTS: f64 = 0.01;

/// Points with colours, as structure from motion leaves them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PointCloud {
    /// World positions `[N, 3]`.
    pub positions: Vec<[f32; 3]>,
    /// sRGB colours `[N, 3]`.
    pub colors: Vec<[u8; 3]>,
}

impl PointCloud {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Adds a point; `false` when a coordinate is not finite in f32, and the point is left out.
    pub(crate) fn push_finite(&mut self, position: [f64; 3], color: [u8; 3]) -> bool {
        let position = position.map(|v| v as f32);
        let finite = position.iter().all(|v| v.is_finite());
        if finite {
            self.positions.push(position);
            self.colors.push(color);
        }
        finite
    }
}

/// Reads a point cloud: `x, y, z` and, where present, `red, green, blue` of the element `vertex`;
/// ASCII or binary, further columns and elements are skipped. Integer colours are scaled from
/// their type's range, real ones from [0, 1], or from [0, 255] where more than 1 % exceed 1.5.
/// Points that are not finite are left out with a warning; one tells of points without colours, too.
///
/// # Errors
/// Names the file: unreadable, not a PLY file, truncated, or without positions.
pub fn read_points(path: &Path) -> Result<PointCloud, Error> {
    let bytes = fs::read(path).map_err(Error::access(path))?;
    let parsed = parse(path, bytes)?;
    if parsed.n_dropped > 0 {
        tracing::warn!(
            "{}: left out {} points that are not finite",
            path.display(),
            parsed.n_dropped
        );
    }
    if let Some(told) = parsed.lacks_colors {
        tracing::warn!("{}: {told}", path.display());
    }
    Ok(parsed.points)
}

/// What a file holds.
#[derive(Debug)]
pub(crate) struct Parsed {
    pub(crate) points: PointCloud,
    /// Points that are not finite and were left out.
    pub(crate) n_dropped: usize,
    /// Why all points are gray, where they are.
    lacks_colors: Option<String>,
}

/// [`read_points`] without the warnings: the points and how many were not finite.
///
/// # Errors
/// As [`read_points`].
pub fn read_points_counting(path: &Path) -> Result<(PointCloud, usize), Error> {
    let bytes = fs::read(path).map_err(Error::access(path))?;
    let parsed = parse(path, bytes)?;
    Ok((parsed.points, parsed.n_dropped))
}

/// Writes a binary little-endian PLY with the columns that 3DGS tools expect of initial points
/// (`x, y, z, nx, ny, nz, red, green, blue`; normals zero).
///
/// # Errors
/// The system's, naming the file.
///
/// # Panics
/// When there are not as many colours as positions.
///
/// ```
/// use dash_train::ply::{PointCloud, read_points, write_points};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("points.ply");
/// let points = PointCloud { positions: vec![[1.0, 2.0, 3.0]], colors: vec![[255, 0, 0]] };
/// write_points(&path, &points)?;
/// assert_eq!(read_points(&path)?, points);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write_points(path: &Path, points: &PointCloud) -> Result<(), Error> {
    assert_eq!(
        points.positions.len(),
        points.colors.len(),
        "one colour per position"
    );
    let vertex = points
        .positions
        .iter()
        .zip(&points.colors)
        .map(|(&[x, y, z], &[red, green, blue])| WrittenVertex {
            x,
            y,
            z,
            nx: 0.0,
            ny: 0.0,
            nz: 0.0,
            red,
            green,
            blue,
        })
        .collect();
    let mut file = BufWriter::new(fs::File::create(path).map_err(Error::access(path))?);
    serde_ply::to_writer(
        &WrittenCloud { vertex },
        SerializeOptions::binary_le(),
        &mut file,
    )
    .map_err(|e| Error::access(path)(e.0))?;
    file.flush().map_err(Error::access(path))
}

#[derive(Serialize)]
struct WrittenCloud {
    vertex: Vec<WrittenVertex>,
}

#[derive(Serialize)]
struct WrittenVertex {
    x: f32,
    y: f32,
    z: f32,
    nx: f32,
    ny: f32,
    nz: f32,
    red: u8,
    green: u8,
    blue: u8,
}

/// A vertex row; serde widens every column type to f64, so the header alone decides the scale.
#[derive(Deserialize)]
struct Vertex {
    x: f64,
    y: f64,
    z: f64,
    #[serde(default)]
    red: f64,
    #[serde(default)]
    green: f64,
    #[serde(default)]
    blue: f64,
}

/// A row of an element that precedes the vertices.
#[derive(Deserialize)]
struct Skipped {}

/// [`read_points`] from a file's content.
pub(crate) fn parse(path: &Path, mut bytes: Vec<u8>) -> Result<Parsed, Error> {
    let malformed = |found: String| {
        Error::invalid(
            path,
            "a PLY point cloud with x, y, z",
            found,
            "export the points again or remove the file",
        )
    };
    refuse_pointer(path, &bytes, "a PLY point cloud")?;
    let n_bytes = bytes.len();
    let header = PlyReader::from_reader(&bytes[..]).map_err(|e| malformed(e.0.to_string()))?;
    let format = header.header().format;
    if format == PlyFormat::Ascii {
        // serde-ply ends a number at white space only, also the file's last one.
        bytes.push(b'\n');
    }
    let mut reader =
        PlyReader::from_reader(Cursor::new(bytes)).map_err(|e| malformed(e.0.to_string()))?;
    while let Some(element) = reader.current_element().cloned() {
        if !rows_fit(&element, format, n_bytes) {
            return Err(malformed(format!(
                "{} rows of `{}` announced in a file of {} bytes (truncated?)",
                element.count, element.name, n_bytes
            )));
        }
        if element.name != "vertex" {
            reader
                .next_element::<Vec<Skipped>>()
                .map_err(|e| malformed(format!("in `{}`: {}", element.name, e.0)))?;
            continue;
        }
        if let Some(axis) = ["x", "y", "z"]
            .iter()
            .find(|name| !element.has_property(name))
        {
            return Err(malformed(format!("no property `{axis}`")));
        }
        let rows = reader
            .next_element::<Vec<Vertex>>()
            .map_err(|e| malformed(format!("{} vertices announced: {}", element.count, e.0)))?;
        return Ok(collect(&element, rows));
    }
    Err(malformed("no element `vertex`".into()))
}

/// Whether a file of `n_bytes` can hold the announced rows, going by each column's smallest size; a
/// row without columns holds nothing.
fn rows_fit(element: &ElementDef, format: PlyFormat, n_bytes: usize) -> bool {
    let row_bytes: usize = element
        .properties
        .iter()
        .map(|property| match (format, &property.property_type) {
            (PlyFormat::Ascii, _) => 1,
            (
                _,
                PropertyType::Scalar(scalar)
                | PropertyType::List {
                    count_type: scalar, ..
                },
            ) => match scalar {
                ScalarType::I8 | ScalarType::U8 => 1,
                ScalarType::I16 | ScalarType::U16 => 2,
                ScalarType::I32 | ScalarType::U32 | ScalarType::F32 => 4,
                ScalarType::F64 => 8,
            },
        })
        .sum();
    element.count == 0 || (row_bytes > 0 && element.count <= n_bytes / row_bytes)
}

/// What white is among real colour values, 1 or 255. A few of a highlight may be above 1.
pub(crate) fn white(values: impl Iterator<Item = f64>) -> f64 {
    let (mut n, mut n_large) = (0usize, 0usize);
    for value in values.filter(|value| value.is_finite() && *value > 0.0) {
        n += 1;
        n_large += usize::from(value > BRIGHTEST);
    }
    match n_large as f64 > MAX_HIGHLIGHTS * n as f64 {
        true => 255.0,
        false => 1.0,
    }
}

fn collect(element: &ElementDef, rows: Vec<Vertex>) -> Parsed {
    let color_type = match element.get_property("red").map(|p| &p.property_type) {
        Some(PropertyType::Scalar(scalar))
            if element.has_property("green") && element.has_property("blue") =>
        {
            Some(*scalar)
        }
        _ => None,
    };
    let colors = || rows.iter().flat_map(|r| [r.red, r.green, r.blue]);
    let scale = match color_type {
        Some(ScalarType::F32 | ScalarType::F64) => 255.0 / white(colors()),
        Some(ScalarType::U16) if colors().any(|value| value > 255.0) => 255.0 / 65535.0,
        _ => 1.0,
    };
    let mut points = PointCloud::default();
    let mut n_dropped = 0;
    for row in rows {
        let color = match color_type {
            Some(_) => [row.red, row.green, row.blue].map(|value| match value.is_nan() {
                true => NEUTRAL_GRAY,
                false => (value * scale).round().clamp(0.0, 255.0) as u8,
            }),
            None => [NEUTRAL_GRAY; 3],
        };
        if !points.push_finite([row.x, row.y, row.z], color) {
            n_dropped += 1;
        }
    }
    Parsed {
        points,
        n_dropped,
        lacks_colors: color_type.is_none().then(|| lacks_colors(element)),
    }
}

/// Says that points have no colours of the names that are read, and what else they have.
fn lacks_colors(element: &ElementDef) -> String {
    const READ: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];
    let names = element.properties.iter().map(|p| p.name.as_str());
    let others: Vec<&str> = names.filter(|name| !READ.contains(name)).collect();
    let found = match others.is_empty() {
        true => "nothing but positions".into(),
        false => others.join(", "),
    };
    format!(
        "expected the colours of points as numbers red, green and blue, found {found}: all points are gray; rename or \
         convert the columns"
    )
}

#[cfg(test)]
mod tests;
