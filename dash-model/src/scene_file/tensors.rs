//! Tensors in a safetensors file.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::path::Path;

use burn::tensor::f16;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::write_atomically;
use crate::ModelError;
use crate::parameters::HostTensor;

/// Most values in a Gaussian's `sh_rest` (degree 3). A file that stores no row could claim any width.
const MAX_COLOUR: usize = 45;

/// A tensor in a file.
pub(super) enum Stored {
    /// As f32.
    Single(HostTensor),
    /// As f16, see [`half`].
    Half(HostTensor),
    /// Indices of the rows of another tensor that are stored.
    Rows(Vec<u32>),
    /// A bit mask of the rows of another tensor that are stored.
    Marks(Vec<u8>),
}

impl Stored {
    pub(super) fn bytes(&self) -> usize {
        match self {
            Self::Single(tensor) => size_of_val(tensor.values.as_slice()),
            Self::Half(tensor) => size_of::<f16>() * tensor.values.len(),
            Self::Rows(rows) => size_of_val(rows.as_slice()),
            Self::Marks(marks) => marks.len(),
        }
    }
}

/// The nearest f16; the largest one for values beyond its range.
pub(super) fn half(value: f32) -> f16 {
    f16::from_f32(value.clamp(f16::MIN.to_f32(), f16::MAX.to_f32()))
}

/// The rows `[M, ..]` of a tensor `[N, ..]` that have a bit set (-0.0 has one), and their indices; `None` where rows have
/// no values, or an index does not fit.
pub(super) fn rows_with_bits(tensor: &HostTensor) -> Option<(Vec<u32>, HostTensor)> {
    let width: usize = tensor.shape.get(1..)?.iter().product();
    if width == 0 {
        return None;
    }
    let (mut rows, mut values) = (Vec::new(), Vec::new());
    for (row, of_row) in tensor.values.chunks_exact(width).enumerate() {
        if of_row.iter().any(|value| value.to_bits() != 0) {
            rows.push(u32::try_from(row).ok()?);
            values.extend_from_slice(of_row);
        }
    }
    let mut shape = tensor.shape.clone();
    shape[0] = rows.len();
    Some((rows, HostTensor { shape, values }))
}

/// [`rows_with_bits`], where it saves space.
pub(super) fn without_zero_rows(tensor: &HostTensor) -> Option<(Vec<u32>, HostTensor)> {
    rows_with_bits(tensor)
        .filter(|(rows, kept)| rows.len() + kept.values.len() < tensor.values.len())
}

/// The inverse: `None` unless `rows` rise, stay below `n`, and are as many as `kept` has.
pub(super) fn with_zero_rows(kept: &HostTensor, rows: &[u32], n: usize) -> Option<HostTensor> {
    let dims = kept.shape.get(1..)?.iter();
    let width = dims.copied().try_fold(1, usize::checked_mul)?;
    let fit = width <= MAX_COLOUR
        && kept.shape[0] == rows.len()
        && rows.is_sorted_by(|a, b| a < b)
        && rows.last().is_none_or(|&last| (last as usize) < n);
    if !fit {
        return None;
    }
    let mut values = vec![0.0; n.checked_mul(width)?];
    if width > 0 {
        for (&row, of_row) in rows.iter().zip(kept.values.chunks_exact(width)) {
            values[row as usize * width..][..width].copy_from_slice(of_row);
        }
    }
    let mut shape = kept.shape.clone();
    shape[0] = n;
    Some(HostTensor { shape, values })
}

/// Writes named f32 tensors as one safetensors file.
///
/// # Errors
/// [`ModelError::Io`], or [`ModelError::Parameter`] when a tensor's values do not fill its shape.
///
/// # Example
/// ```
/// use dash_model::scene_file::{read_tensors, write_tensors};
/// # use dash_model::parameters::HostTensor;
/// # use std::collections::BTreeMap;
/// # let path = std::env::temp_dir().join(format!("dash-tensors-{}", std::process::id()));
/// let weights = HostTensor { shape: vec![2, 1], values: vec![0.5, -1.0] };
/// let tensors = BTreeMap::from([("weights".to_string(), weights)]);
/// write_tensors(&path, &tensors)?;
/// assert_eq!(read_tensors(&path)?, tensors);
/// # std::fs::remove_file(path).expect("written above");
/// # Ok::<(), dash_model::ModelError>(())
/// ```
pub fn write_tensors(
    path: &Path,
    tensors: &BTreeMap<String, HostTensor>,
) -> Result<(), ModelError> {
    let views = tensors.iter().map(|(name, tensor)| {
        let bytes = Cow::Borrowed(bytemuck::cast_slice(&tensor.values));
        (name.as_str(), Dtype::F32, tensor.shape.clone(), bytes)
    });
    let bytes = serialized(views.collect())?;
    write_atomically(path, |mut file| file.write_all(&bytes))
}

/// The bytes of a safetensors file.
///
/// # Errors
/// [`ModelError::Parameter`] when values do not fill a shape.
pub(super) fn file_bytes(tensors: &BTreeMap<String, Stored>) -> Result<Vec<u8>, ModelError> {
    let views = tensors.iter().map(|(name, tensor)| match tensor {
        Stored::Single(tensor) => {
            let bytes = Cow::Borrowed(bytemuck::cast_slice(&tensor.values));
            (name.as_str(), Dtype::F32, tensor.shape.clone(), bytes)
        }
        Stored::Half(tensor) => {
            let bytes = tensor.values.iter().flat_map(|&v| half(v).to_le_bytes());
            let bytes = Cow::Owned(bytes.collect());
            (name.as_str(), Dtype::F16, tensor.shape.clone(), bytes)
        }
        Stored::Rows(rows) => {
            let bytes = Cow::Borrowed(bytemuck::cast_slice(rows));
            (name.as_str(), Dtype::U32, vec![rows.len()], bytes)
        }
        Stored::Marks(marks) => {
            let bytes = Cow::Borrowed(marks.as_slice());
            (name.as_str(), Dtype::U8, vec![marks.len()], bytes)
        }
    });
    serialized(views.collect())
}

type NamedBytes<'a> = (&'a str, Dtype, Vec<usize>, Cow<'a, [u8]>);

fn serialized(tensors: Vec<NamedBytes<'_>>) -> Result<Vec<u8>, ModelError> {
    let views: Result<Vec<_>, _> = tensors
        .iter()
        .map(|(name, kind, shape, bytes)| {
            let view = TensorView::new(*kind, shape.clone(), bytes);
            view.map(|view| (*name, view)).map_err(|_| {
                let expected = format!("values of {kind:?} that fill the shape {shape:?}");
                ModelError::parameter(name, expected, format!("{} bytes", bytes.len()))
            })
        })
        .collect();
    Ok(safetensors::serialize(views?, None).expect("names and shapes are plain"))
}

/// Reads a safetensors file of f32 and f16 tensors.
///
/// # Errors
/// [`ModelError::Io`] or [`ModelError::Format`].
pub fn read_tensors(path: &Path) -> Result<BTreeMap<String, HostTensor>, ModelError> {
    let bytes = fs::read(path).map_err(|e| ModelError::io(path, "read", e))?;
    only_floats(read_stored(&bytes, path)?, path)
}

/// The float tensors.
///
/// # Errors
/// [`ModelError::Format`] when indices or a mask of rows remain.
pub(super) fn only_floats(
    stored: BTreeMap<String, Stored>,
    path: &Path,
) -> Result<BTreeMap<String, HostTensor>, ModelError> {
    stored
        .into_iter()
        .map(|(name, tensor)| match tensor {
            Stored::Single(tensor) | Stored::Half(tensor) => Ok((name, tensor)),
            Stored::Rows(_) => Err(not_floats(path, &name, Dtype::U32)),
            Stored::Marks(_) => Err(not_floats(path, &name, Dtype::U8)),
        })
        .collect()
}

/// Reads what [`file_bytes`] wrote; f16 becomes [`Stored::Single`]. `path` is for errors.
///
/// # Errors
/// [`ModelError::Format`].
pub(super) fn read_stored(
    bytes: &[u8],
    path: &Path,
) -> Result<BTreeMap<String, Stored>, ModelError> {
    let file = SafeTensors::deserialize(bytes)
        .map_err(|e| ModelError::format(path, "a safetensors file", e.to_string()))?;
    file.tensors()
        .into_iter()
        .map(|(name, view)| {
            let shape = view.shape().to_vec();
            let tensor = match view.dtype() {
                Dtype::F32 => Stored::Single(HostTensor {
                    values: bytemuck::pod_collect_to_vec(view.data()),
                    shape,
                }),
                Dtype::F16 => {
                    let (halves, _) = view.data().as_chunks::<2>();
                    let values = halves
                        .iter()
                        .map(|&bytes| f16::from_le_bytes(bytes).to_f32());
                    Stored::Single(HostTensor {
                        values: values.collect(),
                        shape,
                    })
                }
                Dtype::U32 if shape.len() == 1 => {
                    Stored::Rows(bytemuck::pod_collect_to_vec(view.data()))
                }
                Dtype::U8 if shape.len() == 1 => Stored::Marks(view.data().to_vec()),
                kind => return Err(not_floats(path, &name, kind)),
            };
            Ok((name, tensor))
        })
        .collect()
}

fn not_floats(path: &Path, name: &str, kind: Dtype) -> ModelError {
    let found = format!("`{name}` of {kind:?}");
    ModelError::format(path, "f32 or f16 tensors", found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_zeros_need_no_room() {
        let tensor = HostTensor {
            shape: vec![4, 1, 3],
            values: [[0.0; 3], [1.0, 0.0, 2.0], [0.0; 3], [0.0, -0.0, 0.0]].concat(),
        };
        let (rows, kept) = without_zero_rows(&tensor).expect("two of four rows are zero");
        // A negative zero has a bit set, and files keep every bit.
        assert_eq!(
            (rows.as_slice(), kept.shape.as_slice()),
            (&[1, 3][..], &[2, 1, 3][..])
        );
        let back = with_zero_rows(&kept, &rows, 4).expect("what was taken out goes in");
        let bits = |t: &HostTensor| t.values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!((bits(&back), back.shape), (bits(&tensor), tensor.shape));
        for rows in [&[1, 1][..], &[3, 1], &[1, 4], &[1]] {
            assert!(with_zero_rows(&kept, rows, 4).is_none(), "{rows:?}");
        }
        let vast = HostTensor {
            shape: vec![0, 1 << 60],
            values: Vec::new(),
        };
        assert!(with_zero_rows(&vast, &[], 4).is_none());
        let full = HostTensor {
            shape: vec![2, 1, 3],
            values: vec![1.0; 6],
        };
        assert!(without_zero_rows(&full).is_none());
    }
}
