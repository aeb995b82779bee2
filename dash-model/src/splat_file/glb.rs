//! glTF 2.0 in one file, with `KHR_gaussian_splatting` (ratified): a primitive of points whose attributes are those of Gaussians.
//!
//! Axes are x left, y up, z forward, as other writers have them. Scales and opacities are stored as they are drawn, not as logarithms and logits.

use std::fs;
use std::io::Write;
use std::path::Path;

use dash_kernels::splats::NEAR_PLANE;
use serde_json::{Value, json};

use super::axes::HalfTurn;
use super::{logit_of, opacity, unit};
use crate::scene_file::write_atomically;
use crate::splat_ply::SplatFile;
use crate::{GaussianRows, ModelError, SH_C0};

const EXTENSION: &str = "KHR_gaussian_splatting";
const MAGIC: &[u8; 4] = b"glTF";
const JSON_CHUNK: &[u8; 4] = b"JSON";
const BINARY_CHUNK: &[u8; 4] = b"BIN\0";
const FLOAT: u64 = 5126;
const POINTS: u64 = 0;

/// The attribute of one coefficient, by its place among the higher ones.
fn coefficient(k: usize) -> String {
    let (degree, first) = match k {
        0..3 => (1, 0),
        3..8 => (2, 3),
        _ => (3, 8),
    };
    format!("{EXTENSION}:SH_DEGREE_{degree}_COEF_{}", k - first)
}

fn attribute(name: &str) -> String {
    format!("{EXTENSION}:{name}")
}

pub fn write(path: &Path, rows: &GaussianRows) -> Result<(), ModelError> {
    let rows = HalfTurn::AboutZ.of(rows.clone());
    let n = rows.len();
    let mut file = Accessors::new(n);
    let bounds = [f32::min, f32::max].map(|pick| {
        let extreme = |axis: usize| {
            rows.means
                .iter()
                .map(|m| m[axis])
                .reduce(pick)
                .unwrap_or(0.0)
        };
        [0, 1, 2].map(extreme)
    });
    file.add("POSITION".into(), &rows.means);
    file.accessors[0]["min"] = json!(bounds[0]);
    file.accessors[0]["max"] = json!(bounds[1]);
    let colors = |row: usize| {
        let [r, g, b] = rows.sh_dc[row].map(|dc| (0.5 + SH_C0 * dc).clamp(0.0, 1.0));
        [r, g, b, opacity(rows.opacity_logits[row])]
    };
    // What viewers without the extension draw: points.
    file.add("COLOR_0".into(), &(0..n).map(colors).collect::<Vec<_>>());
    let quats: Vec<[f32; 4]> = rows
        .quats
        .iter()
        .map(|quat| {
            let [w, x, y, z] = unit(*quat);
            [x, y, z, w]
        })
        .collect();
    file.add(attribute("ROTATION"), &quats);
    let scales: Vec<[f32; 3]> = rows.log_scales.iter().map(|s| s.map(f32::exp)).collect();
    file.add(attribute("SCALE"), &scales);
    let opacities: Vec<[f32; 1]> = rows.opacity_logits.iter().map(|l| [opacity(*l)]).collect();
    file.add(attribute("OPACITY"), &opacities);
    file.add(attribute("SH_DEGREE_0_COEF_0"), &rows.sh_dc);
    for k in 0..rows.sh_rest_width / 3 {
        let of = |row: usize| {
            let rest = &rows.sh_rest[row * rows.sh_rest_width + 3 * k..];
            [rest[0], rest[1], rest[2]]
        };
        file.add(coefficient(k), &(0..n).map(of).collect::<Vec<_>>());
    }
    let bytes = file.glb();
    write_atomically(path, |mut file| file.write_all(&bytes))
}

/// Attributes of a primitive, and their values.
struct Accessors {
    n: usize,
    attributes: serde_json::Map<String, Value>,
    accessors: Vec<Value>,
    views: Vec<Value>,
    binary: Vec<u8>,
}

impl Accessors {
    fn new(n: usize) -> Self {
        Self {
            n,
            attributes: serde_json::Map::new(),
            accessors: Vec::new(),
            views: Vec::new(),
            binary: Vec::new(),
        }
    }

    fn add<const C: usize>(&mut self, name: String, values: &[[f32; C]]) {
        let kind = match C {
            1 => "SCALAR".into(),
            columns => format!("VEC{columns}"),
        };
        let index = self.accessors.len();
        self.attributes.insert(name, json!(index));
        self.accessors.push(json!({
            "bufferView": index, "componentType": FLOAT, "count": self.n, "type": kind,
        }));
        self.views.push(json!({
            "buffer": 0, "byteOffset": self.binary.len(), "byteLength": 4 * C * self.n, "target": 34962,
        }));
        for value in values.as_flattened() {
            self.binary.extend(value.to_le_bytes());
        }
    }

    fn glb(self) -> Vec<u8> {
        let mut text = json!({
            "asset": { "version": "2.0", "generator": "dash" },
            "extensionsUsed": [EXTENSION],
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{
                "attributes": self.attributes,
                "mode": POINTS,
                "extensions": { EXTENSION: {
                    "kernel": "ellipse",
                    "colorSpace": "srgb_rec709_display",
                    "projection": "perspective",
                    "sortingMethod": "cameraDistance",
                } },
            }] }],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{ "byteLength": self.binary.len() }],
        })
        .to_string()
        .into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + text.len() + 8 + self.binary.len();
        let mut bytes = Vec::with_capacity(total);
        bytes.extend(MAGIC);
        bytes.extend(2_u32.to_le_bytes());
        bytes.extend((total as u32).to_le_bytes());
        for (kind, chunk) in [(JSON_CHUNK, &text), (BINARY_CHUNK, &self.binary)] {
            bytes.extend((chunk.len() as u32).to_le_bytes());
            bytes.extend(kind);
            bytes.extend(chunk);
        }
        bytes
    }
}

pub fn read(path: &Path) -> Result<SplatFile, ModelError> {
    let bytes = fs::read(path).map_err(|e| ModelError::io(path, "open", e))?;
    let rows =
        parse(&bytes).map_err(|[expected, found]| ModelError::format(path, expected, found))?;
    SplatFile::of(HalfTurn::AboutZ.of(rows), NEAR_PLANE, path)
}

/// What was expected, and what was found.
type Mismatch = [String; 2];

fn mismatch<T>(expected: impl Into<String>, found: impl Into<String>) -> Result<T, Mismatch> {
    Err([expected.into(), found.into()])
}

fn parse(bytes: &[u8]) -> Result<GaussianRows, Mismatch> {
    let (root, binary) = chunks(bytes)?;
    let primitive = primitive(&root)?;
    let reader = Reader {
        root: &root,
        binary,
        attributes: &primitive["attributes"],
    };
    let means = reader.required::<3>("POSITION")?;
    let n = means.len();
    let quats = reader.required::<4>(&attribute("ROTATION"))?;
    let scales = reader.required::<3>(&attribute("SCALE"))?;
    let opacities = reader.required::<1>(&attribute("OPACITY"))?;
    let dc = reader.required::<3>(&attribute("SH_DEGREE_0_COEF_0"))?;
    let mut rest: Vec<Vec<[f32; 3]>> = Vec::new();
    for k in 0..15 {
        match reader.attribute::<3>(&coefficient(k))? {
            Some(values) => rest.push(values),
            None => break,
        }
    }
    if ![0, 3, 8, 15].contains(&rest.len()) {
        return mismatch(
            "whole degrees of colour coefficients",
            format!("{} of them", rest.len()),
        );
    }
    let counts = [quats.len(), scales.len(), opacities.len(), dc.len()];
    let counts = counts.into_iter().chain(rest.iter().map(Vec::len));
    if let Some(other) = counts.into_iter().find(|count| *count != n) {
        return mismatch(format!("{n} values of every attribute"), other.to_string());
    }
    let coefficients = (0..n).flat_map(|row| rest.iter().flat_map(move |values| values[row]));
    Ok(GaussianRows {
        means,
        quats: quats.into_iter().map(|[x, y, z, w]| [w, x, y, z]).collect(),
        log_scales: scales.into_iter().map(|s| s.map(f32::ln)).collect(),
        opacity_logits: opacities.into_iter().map(|[o]| logit_of(o)).collect(),
        sh_dc: dc,
        sh_rest: coefficients.collect(),
        sh_rest_width: 3 * rest.len(),
        ..Default::default()
    })
}

/// The JSON and the binary chunk of a GLB.
fn chunks(bytes: &[u8]) -> Result<(Value, &[u8]), Mismatch> {
    if bytes.get(..4) != Some(MAGIC) {
        return mismatch("a GLB, which begins with `glTF`", "another beginning");
    }
    let word = |at: usize| -> Option<usize> {
        let word = bytes.get(at..at + 4)?.first_chunk()?;
        Some(u32::from_le_bytes(*word) as usize)
    };
    if word(4) != Some(2) {
        return mismatch("GLB of version 2", format!("{:?}", word(4)));
    }
    let mut at = 12;
    let (mut text, mut binary) = (None, &[][..]);
    while let Some(length) = word(at) {
        let kind = bytes.get(at + 4..at + 8);
        let Some(chunk) = bytes.get(at + 8..).and_then(|rest| rest.get(..length)) else {
            return mismatch(format!("a chunk of {length} bytes"), "the end of the file");
        };
        match kind {
            Some(kind) if kind == JSON_CHUNK => text = text.or(Some(chunk)),
            Some(kind) if kind == BINARY_CHUNK => binary = chunk,
            _ => {}
        }
        at += 8 + length;
    }
    let Some(text) = text else {
        return mismatch("a JSON chunk", "none");
    };
    match serde_json::from_slice(text) {
        Ok(root) => Ok((root, binary)),
        Err(error) => mismatch("JSON", error.to_string()),
    }
}

/// The only primitive of Gaussians.
fn primitive(root: &Value) -> Result<&Value, Mismatch> {
    let list = |value: &'_ Value| value.as_array().map_or(0, Vec::len);
    let mut found = Vec::new();
    for mesh in 0..list(&root["meshes"]) {
        let primitives = &root["meshes"][mesh]["primitives"];
        for index in 0..list(primitives) {
            if primitives[index]["extensions"].get(EXTENSION).is_some() {
                found.push((mesh, &primitives[index]));
            }
        }
    }
    let [(mesh, primitive)] = found[..] else {
        let found = format!("{} of them", found.len());
        return mismatch(format!("one primitive with {EXTENSION}"), found);
    };
    let kernel = &primitive["extensions"][EXTENSION]["kernel"];
    if !kernel.is_null() && kernel != "ellipse" {
        return mismatch("the kernel `ellipse`", kernel.to_string());
    }
    let space = &primitive["extensions"][EXTENSION]["colorSpace"];
    if !space.is_null() && space != "srgb_rec709_display" {
        return mismatch("the colour space `srgb_rec709_display`", space.to_string());
    }
    let nodes = root["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    // A turn of the node would turn the colours' directions, too.
    let moves = ["matrix", "rotation", "scale", "translation"];
    for node in nodes
        .iter()
        .filter(|node| node["mesh"] == mesh || node.get("children").is_some())
    {
        if let Some(key) = moves.iter().find(|key| node.get(**key).is_some()) {
            return mismatch(
                "Gaussians where they are, in nodes that do not move them",
                format!("a node with `{key}`"),
            );
        }
    }
    Ok(primitive)
}

struct Reader<'a> {
    root: &'a Value,
    binary: &'a [u8],
    attributes: &'a Value,
}

impl Reader<'_> {
    fn required<const C: usize>(&self, name: &str) -> Result<Vec<[f32; C]>, Mismatch> {
        match self.attribute(name)? {
            Some(values) => Ok(values),
            None => mismatch(format!("the attribute `{name}`"), "none"),
        }
    }

    fn attribute<const C: usize>(&self, name: &str) -> Result<Option<Vec<[f32; C]>>, Mismatch> {
        let Some(index) = self.attributes.get(name) else {
            return Ok(None);
        };
        let missing = || -> Mismatch {
            [
                format!("`{name}` in the file's buffer"),
                "nothing there".into(),
            ]
        };
        let number = |value: &Value| value.as_u64().and_then(|v| usize::try_from(v).ok());
        let place = |list: &str, index: &Value| -> Result<&Value, Mismatch> {
            let index = number(index).ok_or_else(missing)?;
            self.root[list].get(index).ok_or_else(missing)
        };
        let accessor = place("accessors", index)?;
        if accessor["componentType"] != FLOAT || accessor.get("sparse").is_some() {
            let found = accessor["componentType"].to_string();
            return mismatch(format!("`{name}` in single precision (5126)"), found);
        }
        let kind = if C == 1 {
            "SCALAR".to_string()
        } else {
            format!("VEC{C}")
        };
        if accessor["type"] != kind.as_str() {
            return mismatch(
                format!("`{name}` of type {kind}"),
                accessor["type"].to_string(),
            );
        }
        let view = place("bufferViews", &accessor["bufferView"])?;
        if view["buffer"] != 0 {
            return mismatch("values in the file's own buffer", "another buffer");
        }
        let or_zero = |value: &Value| number(value).unwrap_or(0);
        let stride = number(&view["byteStride"]).unwrap_or(4 * C);
        if stride < 4 * C {
            return mismatch(
                format!("at least {} bytes a value of `{name}`", 4 * C),
                stride.to_string(),
            );
        }
        let count = number(&accessor["count"]).ok_or_else(missing)?;
        let start = or_zero(&view["byteOffset"]).checked_add(or_zero(&accessor["byteOffset"]));
        let values = start
            .and_then(|start| self.binary.get(start..))
            .ok_or_else(missing)?;
        let last = count.saturating_sub(1).checked_mul(stride);
        let needed = last
            .and_then(|last| last.checked_add(4 * C))
            .ok_or_else(missing)?;
        if count > 0 && needed > values.len() {
            return Err(missing());
        }
        let value = |row: usize| -> [f32; C] {
            std::array::from_fn(|c| {
                let bytes = values[row * stride + 4 * c..].first_chunk();
                bytes.map_or(f32::NAN, |b| f32::from_le_bytes(*b))
            })
        };
        Ok(Some((0..count).map(value).collect()))
    }
}
