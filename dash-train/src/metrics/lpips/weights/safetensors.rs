//! The directory of a safetensors file: the length of a JSON header, the header, the values.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use safetensors::tensor::{Dtype, Metadata};

use super::stored::{Place, READ_WEIGHTS, StoredTensor};
use crate::Error;

/// Bytes of the header's length.
const N_LENGTH: u64 = 8;
/// Longest header in bytes: that of a whole network takes a few thousand.
const MAX_HEADER_BYTES: u64 = 1 << 24;

/// Whether a file that starts with these bytes is meant to be a safetensors file.
pub(super) fn is_one(start: &[u8]) -> bool {
    start.get(N_LENGTH as usize) == Some(&b'{')
}

/// What a safetensors file holds, by its name.
pub(super) fn directory(
    path: &Path,
    file: &mut File,
    n_bytes: u64,
) -> Result<BTreeMap<String, StoredTensor>, Error> {
    let io = |e| Error::io(path, READ_WEIGHTS, e);
    let damaged = |found: String| Error::weight_file(path, "a safetensors file", found);
    let mut length = [0; N_LENGTH as usize];
    file.seek(SeekFrom::Start(0)).map_err(io)?;
    file.read_exact(&mut length).map_err(io)?;
    let length = u64::from_le_bytes(length);
    if length > MAX_HEADER_BYTES || length > n_bytes.saturating_sub(N_LENGTH) {
        return Err(damaged(format!(
            "a header of {length} bytes in a file of {n_bytes}"
        )));
    }
    let mut header = vec![0; length as usize];
    file.read_exact(&mut header).map_err(io)?;
    let header: Metadata =
        serde_json::from_slice(&header).map_err(|e| damaged(format!("a header with: {e}")))?;
    let start = N_LENGTH + length;
    let described = header.data_len() as u64;
    if start.checked_add(described) != Some(n_bytes) {
        return Err(damaged(format!(
            "{} bytes of values where the header describes {described}",
            n_bytes - start
        )));
    }
    let tensors = header.tensors().into_iter().map(|(key, tensor)| {
        // The header was checked: offsets follow each other and fit the shapes.
        let place = if tensor.dtype == Dtype::F32 {
            Place::Floats {
                offset: start + tensor.data_offsets.0 as u64,
                crc32: None,
            }
        } else {
            Place::Other(format!("{:?}", tensor.dtype))
        };
        let shape = tensor.shape.clone();
        (key, StoredTensor { shape, place })
    });
    Ok(tensors.collect())
}
