//! What was done to COLMAP's world before poses were written.

use super::Transforms;

/// What was done to COLMAP's world before poses were written (nerfstudio).
#[derive(Debug, PartialEq)]
pub(crate) enum Applied {
    /// Nothing that the file states.
    Nothing,
    /// This transform, its first three rows.
    Transform([[f64; 4]; 3]),
    /// Something else.
    Unclear,
}

impl Transforms {
    /// What `applied_transform` and `applied_scale` say.
    pub(crate) fn applied(&self) -> Applied {
        let scale = self.other.get("applied_scale");
        let is_scaled = scale.is_some_and(|scale| scale.as_f64() != Some(1.0));
        let Some(rows) = self.other.get("applied_transform") else {
            return match is_scaled {
                true => Applied::Unclear,
                false => Applied::Nothing,
            };
        };
        let rows: Vec<[f64; 4]> = serde_json::from_value(rows.clone()).unwrap_or_default();
        let first = rows.first_chunk::<3>().copied();
        match first.filter(|rows| rows.as_flattened().iter().all(|v| v.is_finite())) {
            Some(rows) if !is_scaled => Applied::Transform(rows),
            _ => Applied::Unclear,
        }
    }
}
