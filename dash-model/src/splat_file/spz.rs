//! SPZ, version 3 (Niantic): 16 bytes of header, then one attribute after the other, gzipped.
//!
//! Axes are x right, y up, z backward. Version 2, whose quaternions have three bytes, is read, too.
//!
//! | attribute | a Gaussian |
//! | --- | --- |
//! | centre | 3 x 24 bits, fixed point |
//! | opacity | u8 |
//! | colour | 3 x u8, `(0.15 dc + 0.5) 255` |
//! | log scales | 3 x u8, `16 (s + 10)` |
//! | quaternion | which of x, y, z, w is largest, and the other three in 10 bits each |
//! | higher colour coefficients | u8, `128 c + 128`, in steps of 8 (degree 1) and 16 |

use std::f32::consts::FRAC_1_SQRT_2;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;

use dash_kernels::splats::NEAR_PLANE;
use flate2::Compression;
use flate2::bufread::GzDecoder;
use flate2::write::GzEncoder;

use super::axes::HalfTurn;
use super::{byte, logit_of, opacity, unit};
use crate::scene_file::write_atomically;
use crate::splat_ply::SplatFile;
use crate::{GaussianRows, ModelError};

const MAGIC: u32 = 0x5053_474e;
const HEADER: usize = 16;
/// As many as the reference reads.
const MOST_GAUSSIANS: usize = 10_000_000;
/// Colour coefficients by what is stored in [0, 1].
const COLOR_SCALE: f32 = 0.15;
/// Bits of a coordinate with its sign.
const COORDINATE_BITS: i32 = 24;
/// Bits after the point, at most.
const MOST_FRACTIONAL_BITS: i32 = 20;
/// Steps of the coefficients of degree 1, and of the others.
const SH_STEPS: [f32; 2] = [8.0, 16.0];
/// Values of degree 1 in a row.
const DEGREE_1: usize = 9;
/// Nine bits of a component's magnitude.
const MAGNITUDE: u32 = (1 << 9) - 1;

/// Values of a row beyond the constant colour, by degree.
const REST_WIDTHS: [usize; 4] = [0, 9, 24, 45];

pub fn write(path: &Path, rows: &GaussianRows) -> Result<(), ModelError> {
    let rows = HalfTurn::AboutX.of(rows.clone());
    let farthest = rows
        .means
        .as_flattened()
        .iter()
        .fold(0.0, |m: f32, v| m.max(v.abs()));
    let fractional_bits = fractional_bits(farthest);
    let mut bytes = Vec::new();
    for word in [MAGIC, 3, rows.len() as u32] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend([rows.sh_degree() as u8, fractional_bits as u8, 0, 0]);
    let scale = f64::from(fractional_bits).exp2();
    let limit = f64::from(COORDINATE_BITS - 1).exp2() - 1.0;
    for value in rows.means.as_flattened() {
        let fixed = (f64::from(*value) * scale).round().clamp(-limit, limit) as i32;
        bytes.extend(&fixed.to_le_bytes()[..3]);
    }
    bytes.extend(
        rows.opacity_logits
            .iter()
            .map(|logit| byte(255.0 * opacity(*logit))),
    );
    let colors = rows.sh_dc.as_flattened().iter();
    bytes.extend(colors.map(|dc| byte(255.0 * (COLOR_SCALE * dc + 0.5))));
    let scales = rows.log_scales.as_flattened().iter();
    bytes.extend(scales.map(|s| byte(16.0 * (s + 10.0))));
    for quat in &rows.quats {
        bytes.extend(packed(unit(*quat)).to_le_bytes());
    }
    if rows.sh_rest_width > 0 {
        for row in rows.sh_rest.chunks_exact(rows.sh_rest_width) {
            bytes.extend(row.iter().enumerate().map(|(k, value)| {
                let step = SH_STEPS[usize::from(k >= DEGREE_1)];
                byte(((128.0 * value + 128.0) / step).round() * step)
            }));
        }
    }
    write_atomically(path, |file| {
        let mut out = GzEncoder::new(file, Compression::default());
        out.write_all(&bytes)?;
        out.finish().map(|_| ())
    })
}

/// As many bits after the point as leave room for the farthest coordinate.
fn fractional_bits(farthest: f32) -> i32 {
    let whole = f64::from(farthest).max(f64::MIN_POSITIVE).log2().floor() as i32 + 1;
    (COORDINATE_BITS - 1 - whole).clamp(0, MOST_FRACTIONAL_BITS)
}

/// The place of the largest of x, y, z, w in two bits, and the others' signs and magnitudes.
fn packed([w, x, y, z]: [f32; 4]) -> u32 {
    let quat = [x, y, z, w];
    let largest = (0..4)
        .max_by(|a, b| quat[*a].abs().total_cmp(&quat[*b].abs()))
        .unwrap_or(3);
    let mut word = largest as u32;
    for k in (0..4).filter(|k| *k != largest) {
        let is_negative = (quat[k] < 0.0) != (quat[largest] < 0.0);
        let magnitude = (MAGNITUDE as f32 * (quat[k].abs() / FRAC_1_SQRT_2)).round() as u32;
        word = word << 10 | u32::from(is_negative) << 9 | magnitude.min(MAGNITUDE);
    }
    word
}

fn unpacked(mut word: u32) -> [f32; 4] {
    let largest = (word >> 30) as usize;
    let mut quat = [0.0; 4];
    let mut squares = 0.0;
    for k in (0..4).rev().filter(|k| *k != largest) {
        let magnitude = FRAC_1_SQRT_2 * (word & MAGNITUDE) as f32 / MAGNITUDE as f32;
        quat[k] = if word >> 9 & 1 == 1 {
            -magnitude
        } else {
            magnitude
        };
        squares += magnitude * magnitude;
        word >>= 10;
    }
    quat[largest] = (1.0 - squares).max(0.0).sqrt();
    let [x, y, z, w] = quat;
    [w, x, y, z]
}

pub fn read(path: &Path) -> Result<SplatFile, ModelError> {
    let file = File::open(path).map_err(|e| ModelError::io(path, "open", e))?;
    let mut file = BufReader::new(file);
    let wrong = |expected: &str, found: String| ModelError::format(path, expected, found);
    // Later versions are not gzipped as a whole.
    let start = file
        .fill_buf()
        .map_err(|e| ModelError::io(path, "read", e))?;
    if let Some(([magic, version], _)) = start.as_chunks::<4>().0.split_first_chunk::<2>()
        && u32::from_le_bytes(*magic) == MAGIC
    {
        let found = u32::from_le_bytes(*version).to_string();
        return Err(wrong(
            "SPZ of version 2 or 3, gzipped (write it as version 3)",
            format!("version {found}"),
        ));
    }
    let mut unzipped = GzDecoder::new(file);
    let damaged = |error: std::io::Error| wrong("gzipped SPZ", error.to_string());
    let mut header = [0; HEADER];
    unzipped.read_exact(&mut header).map_err(damaged)?;
    let word = |k: usize| u32::from_le_bytes([0, 1, 2, 3].map(|i| header[4 * k + i]));
    if word(0) != MAGIC {
        return Err(wrong(
            "the mark of SPZ, 0x5053474e",
            format!("{:#x}", word(0)),
        ));
    }
    let quat_bytes = match word(1) {
        2 => 3,
        3 => 4,
        version => return Err(wrong("SPZ of version 2 or 3", version.to_string())),
    };
    let n = word(2) as usize;
    if n > MOST_GAUSSIANS {
        return Err(wrong("10,000,000 Gaussians at most", n.to_string()));
    }
    let Some(&width) = REST_WIDTHS.get(usize::from(header[12])) else {
        return Err(wrong("colours of degree 0 to 3", header[12].to_string()));
    };
    let fractional_bits = i32::from(header[13]);
    if fractional_bits >= COORDINATE_BITS {
        return Err(wrong(
            "under 24 bits after the point",
            fractional_bits.to_string(),
        ));
    }
    let sizes = [9, 1, 3, 3, quat_bytes, width];
    let expected = n * sizes.iter().sum::<usize>();
    let mut body = Vec::new();
    // One byte more, so that a longer file is noticed, and no longer one is unpacked.
    unzipped
        .take(expected as u64 + 1)
        .read_to_end(&mut body)
        .map_err(damaged)?;
    if body.len() != expected {
        return Err(wrong(
            &format!("{expected} bytes for {n} Gaussians"),
            match body.len() > expected {
                true => "more".into(),
                false => body.len().to_string(),
            },
        ));
    }
    let mut rest = body.as_slice();
    let [positions, alphas, colors, scales, quats, sh] = sizes.map(|size| {
        let (part, behind) = rest.split_at(n * size);
        rest = behind;
        part
    });
    let unit_of = f64::from(-fractional_bits).exp2();
    let coordinate = |b: &[u8; 3]| {
        let fixed = i32::from_le_bytes([0, b[0], b[1], b[2]]) >> 8;
        (f64::from(fixed) * unit_of) as f32
    };
    let triples = |values: Vec<f32>| values.as_chunks::<3>().0.to_vec();
    let rows = GaussianRows {
        means: triples(
            positions
                .as_chunks::<3>()
                .0
                .iter()
                .map(coordinate)
                .collect(),
        ),
        opacity_logits: alphas
            .iter()
            .map(|a| logit_of(f32::from(*a) / 255.0))
            .collect(),
        sh_dc: triples(
            colors
                .iter()
                .map(|c| (f32::from(*c) / 255.0 - 0.5) / COLOR_SCALE)
                .collect(),
        ),
        log_scales: triples(scales.iter().map(|s| f32::from(*s) / 16.0 - 10.0).collect()),
        quats: match quat_bytes {
            3 => quats.as_chunks::<3>().0.iter().map(first_three).collect(),
            _ => {
                let words = quats.as_chunks::<4>().0.iter();
                words
                    .map(|word| unpacked(u32::from_le_bytes(*word)))
                    .collect()
            }
        },
        sh_rest: sh.iter().map(|c| (f32::from(*c) - 128.0) / 128.0).collect(),
        sh_rest_width: width,
        ..Default::default()
    };
    SplatFile::of(HalfTurn::AboutX.of(rows), NEAR_PLANE, path)
}

/// The quaternion of version 2: x, y and z, where w is not negative.
fn first_three(bytes: &[u8; 3]) -> [f32; 4] {
    let [x, y, z] = bytes.map(|b| f32::from(b) / 127.5 - 1.0);
    let w = (1.0 - (x * x + y * y + z * z)).max(0.0).sqrt();
    [w, x, y, z]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quaternions_survive_packing() {
        for quat in [
            [1.0, 0.0, 0.0, 0.0],
            [-0.5, 0.5, -0.5, 0.5],
            [0.1, -0.9, 0.3, 0.2],
            [0.0, 0.0, 0.0, -1.0],
            [0.7, 0.7, 0.01, -0.1],
        ] {
            let quat = unit(quat);
            let got = unpacked(packed(quat));
            let dot: f32 = quat.iter().zip(got).map(|(a, b)| a * b).sum();
            // The angle between both is under a third of a degree.
            assert!(dot.abs() > 1.0 - 4e-6, "{quat:?}: {got:?}");
        }
    }

    #[test]
    fn coordinates_have_as_many_bits_as_fit() {
        assert_eq!(fractional_bits(0.0), 20);
        assert_eq!(fractional_bits(5.0), 20);
        assert_eq!(fractional_bits(8.0), 19);
        assert_eq!(fractional_bits(2047.0), 12);
        assert_eq!(fractional_bits(1e30), 0);
    }
}
