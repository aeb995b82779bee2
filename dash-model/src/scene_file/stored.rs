//! What of a scene's parameters is stored.

use std::collections::BTreeMap;
use std::path::Path;

use super::tensors::Stored;
use super::{TablePrecision, marks, tensors};
use crate::parameters::{HostTensor, named_parameters};
use crate::{DynamicScene, HashEncoder, ModelError};

/// Sets whose higher colour coefficients may be stored for some Gaussians only.
const SETS: [&str; 2] = ["static_set", "dynamic.gaussians"];

/// What the decoder's layers and heads are called behind.
const FIELD: &str = "dynamic.field.";
/// The one parameter that the decoder has of them.
const DECODER: &str = "dynamic.field.decoder.parameters";

/// Whether a parameter of a scene is a table of its field's features.
pub(super) fn is_table(name: &str) -> bool {
    name.starts_with("dynamic.field.encoder.") && HashEncoder::is_table(name)
}

fn colour(set: &str) -> String {
    format!("{set}.sh_rest")
}

fn rows_of(name: &str) -> String {
    format!("{name}.rows")
}

/// A scene's parameters as they are stored.
pub(super) fn stored(scene: &DynamicScene, precision: TablePrecision) -> BTreeMap<String, Stored> {
    let mut parameters = named_parameters(scene);
    if let Some(dynamic) = &scene.dynamic
        && let Some(decoder) = parameters.remove(DECODER)
    {
        let parts = dynamic.field.decoder().parts();
        parameters.extend(parts.split(FIELD, &decoder.values));
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

/// Joins the stored parameters of the decoder of a scene of this structure.
///
/// # Errors
/// What is missing or of another shape.
pub(super) fn join_decoder(
    parameters: &mut BTreeMap<String, HostTensor>,
    skeleton: &DynamicScene,
) -> Result<(), String> {
    if let Some(dynamic) = &skeleton.dynamic {
        let values = dynamic.field.decoder().parts().join(FIELD, parameters)?;
        let shape = vec![values.len()];
        parameters.insert(DECODER.into(), HostTensor { shape, values });
    }
    Ok(())
}

/// The parameters of what was stored, those of the decoder by layer and head.
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
                    "in `{}` a rising number below {n} for each row of `{name}`",
                    rows_of(&name)
                ),
                format!("{} numbers that do not fit", rows.len()),
            )
        })?;
        stored.insert(name, Stored::Single(spread));
    }
    marks::fill_in(&mut stored, is_table, path)?;
    tensors::only_floats(stored, path)
}
