//! From a scene's parameters to the tensors of its file, and back.

use std::collections::BTreeMap;
use std::path::Path;

use super::tensors::Stored;
use super::{TablePrecision, marks, tensors};
use crate::parameters::{HostTensor, named_parameters};
use crate::{DynamicScene, HashEncoder, ModelError};

/// Sets whose `sh_rest` may be stored for some Gaussians only.
const SETS: [&str; 2] = ["static_set", "dynamic.gaussians"];

/// Prefix of the field's parameters. Each decoder has one, which files hold as one tensor per layer and head.
const FIELD: &str = "dynamic.field.";

/// Whether a scene's parameter is a feature table of its deformation field.
pub(super) fn is_table(name: &str) -> bool {
    name.starts_with("dynamic.field.encoder.") && HashEncoder::is_table(name)
}

fn colour(set: &str) -> String {
    format!("{set}.sh_rest")
}

fn rows_of(name: &str) -> String {
    format!("{name}.rows")
}

/// The tensors of a scene's file.
pub(super) fn stored(scene: &DynamicScene, precision: TablePrecision) -> BTreeMap<String, Stored> {
    let mut parameters = named_parameters(scene);
    if let Some(dynamic) = &scene.dynamic {
        for (prefix, parameter, decoder) in dynamic.field.decoders() {
            if let Some(packed) = parameters.remove(&format!("{FIELD}{parameter}")) {
                let prefix = format!("{FIELD}{prefix}");
                parameters.extend(decoder.packing().unpack(&prefix, &packed.values));
            }
        }
    }
    let mut tensors = BTreeMap::new();
    for (name, tensor) in parameters {
        if is_table(&name) {
            let (bytes, wrap): (usize, fn(HostTensor) -> Stored) = match precision {
                TablePrecision::Single => (4, Stored::Single),
                TablePrecision::Half => (2, Stored::Half),
            };
            let tensor = match marks::marked(&tensor, bytes) {
                Some((marks, kept)) => {
                    tensors.insert(marks::marks_of(&name), Stored::Marks(marks));
                    kept
                }
                None => tensor,
            };
            tensors.insert(name, wrap(tensor));
        } else if SETS.iter().any(|set| colour(set) == name)
            && let Some((rows, kept)) = tensors::without_zero_rows(&tensor)
        {
            tensors.insert(rows_of(&name), Stored::Rows(rows));
            tensors.insert(name, Stored::Single(kept));
        } else {
            tensors.insert(name, Stored::Single(tensor));
        }
    }
    tensors
}

/// Joins the stored layers and heads into the decoders' parameters, which `skeleton` lays out.
///
/// # Errors
/// [`ModelError::Parameter`] when a layer or head is missing or has another shape.
pub(super) fn join_decoder(
    parameters: &mut BTreeMap<String, HostTensor>,
    skeleton: &DynamicScene,
) -> Result<(), ModelError> {
    if let Some(dynamic) = &skeleton.dynamic {
        for (prefix, parameter, decoder) in dynamic.field.decoders() {
            let prefix = format!("{FIELD}{prefix}");
            let values = decoder.packing().pack(&prefix, parameters)?;
            let shape = vec![values.len()];
            let name = format!("{FIELD}{parameter}");
            parameters.insert(name, HostTensor { shape, values });
        }
    }
    Ok(())
}

/// The parameters of a scene's file with all their rows; those of the decoder by layer and head.
///
/// # Errors
/// [`ModelError::Format`] when indices or a mask do not fit their tensor.
pub(super) fn whole(
    mut stored: BTreeMap<String, Stored>,
    path: &Path,
) -> Result<BTreeMap<String, HostTensor>, ModelError> {
    for set in SETS {
        let name = colour(set);
        let rows = match stored.get(&rows_of(&name)) {
            Some(Stored::Rows(rows)) => rows.clone(),
            _ => continue,
        };
        stored.remove(&rows_of(&name));
        let n = match stored.get(&format!("{set}.means")) {
            Some(Stored::Single(means)) => means.shape.first().copied().unwrap_or(0),
            _ => 0,
        };
        let spread = match stored.get(&name) {
            Some(Stored::Single(kept)) => tensors::with_zero_rows(kept, &rows, n),
            _ => None,
        };
        let spread = spread.ok_or_else(|| {
            ModelError::format(
                path,
                format!(
                    "in `{}` rising indices below {n}, one for each row of `{name}`",
                    rows_of(&name)
                ),
                format!("{} indices that do not fit", rows.len()),
            )
        })?;
        stored.insert(name, Stored::Single(spread));
    }
    marks::fill_in(&mut stored, is_table, path)?;
    tensors::only_floats(stored, path)
}
