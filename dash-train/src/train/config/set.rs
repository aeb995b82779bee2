//! One value by its dotted path.

use toml::{Table, Value};

use super::shown::shown;
use super::{Preset, TrainConfig};
use crate::Error;

impl TrainConfig {
    /// Sets one value by its dotted path, such as `dssim=0.1` or `densify.static.max_gaussians=50000`. `none` or `off` takes an
    /// optional value or an extension's section away; a section that is named with `on` gets the values of the preset
    /// `default`, else of `quick`.
    ///
    /// # Errors
    /// When the path does not exist or the value does not fit.
    ///
    /// ```
    /// use dash_train::train::{Preset, TrainConfig};
    ///
    /// let mut config = TrainConfig::preset(Preset::Quick);
    /// config.set("dssim=0.1")?;
    /// assert_eq!(config.dssim, 0.1);
    /// assert!(config.set("dssim=often").is_err());
    /// # Ok::<(), dash_train::Error>(())
    /// ```
    pub fn set(&mut self, assignment: &str) -> Result<(), Error> {
        let refuse = |why: String| Error::Config(format!("--set {assignment}: {why}"));
        let (path, value) = assignment
            .split_once('=')
            .ok_or_else(|| refuse("expected KEY=VALUE, such as dssim=0.1".into()))?;
        let (path, value) = (path.trim(), value.trim());
        if path == "preset" {
            return Err(refuse("a preset is chosen with --preset".into()));
        }
        let mut table = Table::try_from(&*self).map_err(|e| refuse(e.to_string()))?;
        let parsed: Table = format!("v = {value}")
            .parse()
            .or_else(|_| format!("v = \"{value}\"").parse())
            .map_err(|e: toml::de::Error| refuse(e.to_string()))?;
        put(&mut table, &all_keys(), path, parsed["v"].clone()).map_err(refuse)?;
        let config: Self = table
            .try_into()
            .map_err(|e: toml::de::Error| refuse(e.message().to_string()))?;
        config.validate()?;
        *self = config;
        Ok(())
    }
}

/// A table with every key that there is, optional ones too, with the values of the preset `default` where it has one,
/// else with those of `quick`.
fn all_keys() -> Table {
    let table = |preset| Table::try_from(TrainConfig::preset(preset)).unwrap_or_default();
    let mut keys = table(Preset::Default);
    add_missing(&mut keys, table(Preset::Quick));
    keys.entry("near_plane").or_insert(Value::Float(0.01));
    keys
}

/// Adds what a table lacks of another, in sections, too.
fn add_missing(table: &mut Table, more: Table) {
    for (key, value) in more {
        match (table.get_mut(&key), value) {
            (Some(Value::Table(section)), Value::Table(more)) => add_missing(section, more),
            (Some(_), _) => {}
            (None, value) => {
                table.insert(key, value);
            }
        }
    }
}

/// Puts a value at a path of a table, whose keys are among those of `known`.
fn put(table: &mut Table, known: &Table, path: &str, mut value: Value) -> Result<(), String> {
    let (key, rest) = match path.split_once('.') {
        Some((key, rest)) => (key, Some(rest)),
        None => (path, None),
    };
    let Some(example) = known.get(key) else {
        let keys: Vec<&str> = known.keys().map(String::as_str).collect();
        return Err(format!("no key `{key}`; there are {}", keys.join(", ")));
    };
    if let Some(rest) = rest {
        let known = example
            .as_table()
            .ok_or_else(|| format!("`{key}` is no section"))?;
        let section = table.get_mut(key).and_then(Value::as_table_mut);
        let section = section.ok_or_else(|| {
            format!("the section `{key}` is off in this preset; switch it on first with {key}=on")
        })?;
        return put(section, known, rest, value);
    }
    match value.as_str() {
        Some("none" | "off") if !example.is_str() => {
            table.remove(key);
            return Ok(());
        }
        Some("on") if example.is_table() => value = example.clone(),
        _ => {}
    }
    value = match (example, value) {
        (Value::Float(_), Value::Integer(whole)) => Value::Float(whole as f64),
        (Value::Integer(_), Value::Float(number)) if number.fract() == 0.0 => {
            Value::Integer(number as i64)
        }
        (_, value) => value,
    };
    if let Some(kind) = kind_of(example)
        && kind_of(&value) != Some(kind)
    {
        let (example, value) = (shown(example), shown(&value));
        return Err(format!(
            "expected {kind} such as {example}, found `{value}`"
        ));
    }
    table.insert(key.into(), value);
    Ok(())
}

/// What a value is, in words; `None` where a key takes values of several kinds.
fn kind_of(value: &Value) -> Option<&'static str> {
    match value {
        Value::Float(_) => Some("a number"),
        Value::Integer(whole) if *whole >= 0 => Some("a whole number of at least 0"),
        Value::Integer(_) => Some("a negative number"),
        Value::Array(_) => Some("two numbers"),
        _ => None,
    }
}
