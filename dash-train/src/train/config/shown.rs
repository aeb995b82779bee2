//! Keys and values as people write them.

/// A value as people write it: f32 without the digits that f64 adds.
pub(in crate::train) fn shown(value: &toml::Value) -> String {
    match value {
        toml::Value::Float(float) => format!("{}", *float as f32),
        toml::Value::Array(values) => {
            let values: Vec<String> = values.iter().map(shown).collect();
            format!("[{}]", values.join(", "))
        }
        toml::Value::String(word) => word.clone(),
        toml::Value::Table(table) => {
            let entries = table
                .iter()
                .map(|(key, value)| format!("{key} = {}", shown(value)));
            format!("{{ {} }}", entries.collect::<Vec<_>>().join(", "))
        }
        other => other.to_string(),
    }
}

pub(in crate::train) fn joined(path: &str, name: &str) -> String {
    match path {
        "" => name.to_string(),
        path => format!("{path}.{name}"),
    }
}
