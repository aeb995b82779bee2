//! `.splat`: 32 bytes a Gaussian, those that matter most first.
//!
//! | bytes | value |
//! | --- | --- |
//! | 0..12 | centre, 3 x f32 |
//! | 12..24 | standard deviations, 3 x f32 |
//! | 24..28 | red, green, blue, opacity, u8 |
//! | 28..32 | quaternion (w, x, y, z), `128 q + 128`, u8 |

use std::fs;
use std::io::Write;
use std::path::Path;

use super::{byte, logit_of, opacity, unit};
use crate::scene_file::write_atomically;
use crate::splat_ply::SplatFile;
use crate::{GaussianRows, ModelError, SH_C0};
use dash_kernels::splats::NEAR_PLANE;

/// Bytes of a Gaussian.
const RECORD: usize = 32;

pub fn read(path: &Path) -> Result<SplatFile, ModelError> {
    let bytes = fs::read(path).map_err(|e| ModelError::io(path, "open", e))?;
    let (records, rest) = bytes.as_chunks::<RECORD>();
    if !rest.is_empty() {
        let found = format!("{} bytes", bytes.len());
        return Err(ModelError::format(path, "32 bytes a Gaussian", found));
    }
    let mut rows = GaussianRows::default();
    for record in records {
        let (words, bytes) = record.split_at(24);
        let words = words.as_chunks::<4>().0;
        let float = |k: usize| f32::from_le_bytes(words[k]);
        rows.means.push([0, 1, 2].map(float));
        rows.log_scales.push([3, 4, 5].map(|k| float(k).ln()));
        rows.sh_dc
            .push([0, 1, 2].map(|k| (f32::from(bytes[k]) / 255.0 - 0.5) / SH_C0));
        rows.opacity_logits
            .push(logit_of(f32::from(bytes[3]) / 255.0));
        rows.quats
            .push([4, 5, 6, 7].map(|k| (f32::from(bytes[k]) - 128.0) / 128.0));
    }
    SplatFile::of(rows, NEAR_PLANE, path)
}

pub fn write(path: &Path, rows: &GaussianRows) -> Result<(), ModelError> {
    let mut bytes = Vec::with_capacity(RECORD * rows.len());
    for row in by_importance(rows) {
        let scales = rows.log_scales[row].map(f32::exp);
        for value in rows.means[row].iter().chain(&scales) {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend(rows.sh_dc[row].map(|dc| byte(255.0 * (0.5 + SH_C0 * dc))));
        bytes.push(byte(255.0 * opacity(rows.opacity_logits[row])));
        bytes.extend(unit(rows.quats[row]).map(|q| byte(128.0 * q + 128.0)));
    }
    write_atomically(path, |mut file| file.write_all(&bytes))
}

/// The rows by volume times opacity, largest first: a viewer shows them as they come.
fn by_importance(rows: &GaussianRows) -> Vec<usize> {
    let weight = |row: usize| {
        let volume: f32 = rows.log_scales[row].iter().sum();
        volume + opacity(rows.opacity_logits[row]).ln()
    };
    let mut order: Vec<usize> = (0..rows.len()).collect();
    order.sort_by(|a, b| weight(*b).total_cmp(&weight(*a)));
    order
}
