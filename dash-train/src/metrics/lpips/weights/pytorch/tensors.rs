//! From the values of a pickle to tensors and their places in the file.

use std::collections::BTreeMap;

use super::super::stored::{FLOAT_BYTES, Place, StoredTensor, float_bytes};
use super::pickle::Pickle;
use super::value::{FLOAT_STORAGE, Storage, Strided, Value};

/// Where a storage is in the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    /// Its first byte.
    pub offset: u64,
    /// Its bytes, all of them within the file.
    pub n_bytes: u64,
    /// Their checksum, where the file has one.
    pub crc32: Option<u32>,
}

/// The tensors of a pickled dictionary; `span_of` finds the storage of a name.
///
/// # Errors
/// What was found instead.
pub(super) fn locate(
    pickle: &Pickle,
    mut span_of: impl FnMut(&str) -> Result<Span, String>,
) -> Result<BTreeMap<String, StoredTensor>, String> {
    let Value::Dict(entries) = pickle.root() else {
        return Err(pickle.root().kind().into());
    };
    let mut tensors = BTreeMap::new();
    for &(key, value) in entries {
        let (Value::Text(key), Value::Tensor(tensor)) =
            (&pickle.values[key], &pickle.values[value])
        else {
            continue;
        };
        let (name, storage) = storage(pickle, tensor)?;
        let place = place(tensor, &storage, span_of(name)?)
            .map_err(|found| format!("`{key}` with {found}"))?;
        let shape = tensor.shape.clone();
        tensors.insert(key.clone(), StoredTensor { shape, place });
    }
    Ok(tensors)
}

/// A tensor's storage and that storage's name.
fn storage<'a>(pickle: &'a Pickle, tensor: &Strided) -> Result<(&'a str, Storage), String> {
    if let Value::Storage(storage) = pickle.values[tensor.storage]
        && let Value::Text(name) = &pickle.values[storage.key]
    {
        return Ok((name, storage));
    }
    Err("a tensor without a storage".into())
}

fn place(tensor: &Strided, storage: &Storage, span: Span) -> Result<Place, String> {
    let bytes = storage.n_elements.checked_mul(storage.element.bytes);
    if bytes.is_none_or(|bytes| bytes > span.n_bytes) {
        return Err(format!(
            "a storage of {} elements of {} bytes in {} bytes",
            storage.n_elements, storage.element.bytes, span.n_bytes
        ));
    }
    if storage.element.storage != FLOAT_STORAGE {
        return Ok(Place::Other(format!("a {}", storage.element.storage)));
    }
    if !is_contiguous(tensor) {
        return Ok(Place::Other(format!(
            "strides {:?}; save it after .contiguous()",
            tensor.strides
        )));
    }
    let start = tensor.offset.checked_mul(FLOAT_BYTES);
    let (Some(start), Some(length)) = (start, float_bytes(&tensor.shape)) else {
        return Err(format!("the shape {:?}", tensor.shape));
    };
    if start
        .checked_add(length)
        .is_none_or(|end| Some(end) > bytes)
    {
        return Err(format!(
            "shape {:?} from element {} of a storage of {}",
            tensor.shape, tensor.offset, storage.n_elements
        ));
    }
    let whole = start == 0 && length == span.n_bytes;
    Ok(Place::Floats {
        offset: span.offset + start,
        crc32: span.crc32.filter(|_| whole),
    })
}

/// Whether the elements follow each other in row-major order. Of a single index the stride is
/// never used.
fn is_contiguous(tensor: &Strided) -> bool {
    let mut expected = Some(1_u64);
    for (&side, &stride) in tensor.shape.iter().zip(&tensor.strides).rev() {
        if side != 1 && Some(stride) != expected {
            return false;
        }
        expected = expected.and_then(|e| e.checked_mul(side as u64));
    }
    true
}
