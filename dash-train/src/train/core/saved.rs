//! What methods and extensions keep in a checkpoint.

use std::collections::BTreeMap;

use dash_model::parameters::HostTensor;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// State for an exact resume: tensors, and values that JSON can hold.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Saved {
    /// By name.
    pub tensors: BTreeMap<String, HostTensor>,
    /// Everything else; `null` where there is nothing.
    pub values: serde_json::Value,
}

impl Saved {
    /// Values without tensors.
    pub fn of_values(values: &impl Serialize) -> Self {
        Self {
            tensors: BTreeMap::new(),
            values: serde_json::to_value(values).unwrap_or_default(),
        }
    }

    /// Adds a flat tensor.
    pub fn insert(&mut self, name: &str, values: Vec<f32>) {
        let shape = vec![values.len()];
        let tensor = HostTensor { shape, values };
        self.tensors.insert(name.into(), tensor);
    }

    /// Takes a flat tensor out.
    ///
    /// # Errors
    /// When there is none of this name.
    pub fn take(&mut self, name: &str) -> Result<Vec<f32>, String> {
        let tensor = self.tensors.remove(name);
        tensor
            .map(|tensor| tensor.values)
            .ok_or(format!("no `{name}`"))
    }

    /// The values.
    ///
    /// # Errors
    /// When they are of another form.
    pub fn read<T: DeserializeOwned>(&self) -> Result<T, String> {
        serde_json::from_value(self.values.clone()).map_err(|e| e.to_string())
    }
}
