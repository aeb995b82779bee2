//! The reference of the configuration, made from the code's own documentation.

use std::fmt::Write;

use schemars::schema_for;
use serde_json::Value;
use toml::Table;

use super::config::shown::{joined, shown};
use super::config::{Preset, TrainConfig};
use super::run::DataConfig;

/// The presets by name, in the order of the table's columns.
const PRESETS: [(&str, Preset); 5] = [
    ("default", Preset::Default),
    ("quick", Preset::Quick),
    ("best", Preset::Best),
    ("paper", Preset::Paper),
    ("reference", Preset::Reference),
];

/// A page of Markdown with every key: what it means, and its value in each preset.
pub fn reference() -> String {
    let schema = schema_for!(TrainConfig);
    let schema = schema.as_value();
    let mut page = Page {
        schema,
        presets: PRESETS
            .map(|(_, preset)| Table::try_from(TrainConfig::preset(preset)).unwrap_or_default()),
        text: INTRODUCTION.to_string(),
    };
    page.section("", schema, one_line(schema.get("description")));
    page.text + &of_data()
}

/// The section that says what of a dataset is read.
fn of_data() -> String {
    let schema = schema_for!(DataConfig);
    let schema = schema.as_value();
    let mut text = format!(
        "\n## `[data]`\n\n{} They are the [options of a dataset](command-line.md#options-of-a-dataset); no preset sets them.\n\n\
         | key | is |\n| --- | --- |\n",
        one_line(schema.get("description"))
    );
    let properties = schema.get("properties").and_then(Value::as_object);
    for (name, property) in properties.into_iter().flatten() {
        let about = one_line(property.get("description"));
        let _ = writeln!(text, "| `{name}` | {about} |");
    }
    text
}

const INTRODUCTION: &str = "# Configuration

Every key of training, made by `dash config --markdown`. `dash train --set KEY=VALUE` changes one, `--config FILE.toml` many;
`RUN/config.toml` holds all of a run's, and `dash config --preset NAME` prints those of a preset.

An extension runs where its section stands. `--set extensions.NAME=none` takes one away, `--set extensions.NAME=on` brings
it with the values of `default`, or of `quick` where `default` has none; in a file `NAME = \"none\"` does the same. A dash marks a key that a preset does not have.

A file of your own needs only what differs from the preset:
```toml file=mine.toml
iterations = 3000

[densify.static]
max_gaussians = 20000

[extensions]
floaters = \"none\"
```
```sh
dash synth out/configured --cameras 5 --frames 4 --size 48x36
dash train out/configured --out runs/configured --preset quick --config mine.toml --iterations 30
```
A run's `config.toml` has the same sections below `[train]`, and `[data]` beside it.
";

struct Page<'a> {
    schema: &'a Value,
    presets: [Table; PRESETS.len()],
    text: String,
}

impl<'a> Page<'a> {
    /// The keys of a section, then its sections; `about` is what it says of itself.
    fn section(&mut self, path: &str, section: &'a Value, about: String) {
        let heading = match path {
            "" => "Top level".to_string(),
            path => format!("`[{path}]`"),
        };
        let properties = section.get("properties").and_then(Value::as_object);
        let properties: Vec<(&'a String, &'a Value)> = properties.into_iter().flatten().collect();
        let (sections, keys): (Vec<_>, Vec<_>) = properties
            .into_iter()
            .map(|(name, property)| (name, property, self.resolved(property)))
            .partition(|(.., resolved)| resolved.get("properties").is_some());
        let _ = write!(self.text, "\n## {heading}\n\n{about}\n");
        if !keys.is_empty() {
            let names = PRESETS.map(|(name, _)| name).join(" | ");
            let rule = "| --- ".repeat(PRESETS.len() + 2);
            let _ = write!(self.text, "\n| key | {names} | is |\n{rule}|\n");
        }
        for (name, property, _) in keys {
            let path = joined(path, name);
            let values = (0..PRESETS.len()).map(|preset| self.value(preset, &path));
            let values = values.collect::<Vec<_>>().join(" | ");
            let about = one_line(property.get("description"));
            let choices = choices(self.resolved(property));
            let _ = writeln!(self.text, "| `{name}` | {values} | {about}{choices} |");
        }
        for (name, property, resolved) in sections {
            // What an extension is stands where it is listed.
            let about = match path {
                "extensions" => property.get("description"),
                _ => resolved.get("description"),
            };
            self.section(&joined(path, name), resolved, one_line(about));
        }
    }

    /// The definition behind a reference, or behind an optional one.
    fn resolved(&self, property: &'a Value) -> &'a Value {
        let alternatives = property.get("anyOf").and_then(Value::as_array);
        let inner = alternatives.and_then(|all| all.iter().find(|one| one.get("$ref").is_some()));
        let reference = inner
            .unwrap_or(property)
            .get("$ref")
            .and_then(Value::as_str);
        reference
            .and_then(|reference| self.schema.pointer(reference.trim_start_matches('#')))
            .unwrap_or(property)
    }

    /// A preset's value at a dotted path.
    fn value(&self, preset: usize, path: &str) -> String {
        let (sections, key) = path.rsplit_once('.').unwrap_or(("", path));
        let mut table = Some(&self.presets[preset]);
        for section in sections.split('.').filter(|section| !section.is_empty()) {
            table = table.and_then(|table| table.get(section)?.as_table());
        }
        let value = table.and_then(|table| table.get(key));
        value.map_or("-".into(), |value| format!("`{}`", shown(value)))
    }
}

/// The words that a key takes, where it takes no others.
fn choices(resolved: &Value) -> String {
    let words = |key: &str| resolved.get(key).and_then(Value::as_array);
    let word = |one: &Value| {
        one.get("const")
            .unwrap_or(one)
            .as_str()
            .map(|word| format!("`{word}`"))
    };
    let all: Option<Vec<String>> = match words("enum") {
        Some(all) => all.iter().map(word).collect(),
        None => words("oneOf").and_then(|all| all.iter().map(word).collect()),
    };
    all.map_or_else(String::new, |all| format!(" One of {}.", all.join(", ")))
}

fn one_line(text: Option<&Value>) -> String {
    let text = text.and_then(Value::as_str).unwrap_or_default();
    text.split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
        .replace('|', "\\|")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_is_documented_and_named_once() {
        let page = reference();
        let rows: Vec<&str> = page
            .lines()
            .filter(|line| line.starts_with("| `"))
            .collect();
        let (of_data, rows): (Vec<&str>, Vec<&str>) = rows
            .into_iter()
            .partition(|row| row.matches(" | ").count() == 1);
        assert_eq!(of_data.len(), 10);
        for row in &rows {
            let cells: Vec<&str> = row.split(" | ").collect();
            assert_eq!(cells.len(), PRESETS.len() + 2, "{row}");
            assert!(
                cells[PRESETS.len() + 1].len() > 10,
                "no documentation: {row}"
            );
            let is_told = row.contains("Source:") || row.starts_with("| `preset` |");
            assert!(is_told, "no source: {row}");
            let is_set = cells[1..=PRESETS.len()].iter().any(|value| *value != "-");
            assert!(is_set, "no preset sets it: {row}");
        }
        for preset in PRESETS {
            let text = toml::to_string(&TrainConfig::preset(preset.1)).expect("serialises");
            for key in text.lines().filter_map(|line| line.split_once(" = ")) {
                // A key, or a variant of a value such as `{ up_to_frames = 4 }`.
                let shown = [format!("| `{}` |", key.0), format!("{{ {} = ", key.0)];
                let is_shown = shown.iter().any(|shown| page.contains(shown));
                assert!(is_shown, "{} is missing", key.0);
            }
        }
    }

    #[test]
    fn the_books_page_is_what_the_code_says() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../docs/src/reference/configuration.md");
        let Ok(page) = std::fs::read_to_string(&path) else {
            // A packaged crate has no book beside it.
            return;
        };
        assert!(
            page.trim_end() == reference().trim_end(),
            "{} is not what `dash config --markdown` prints; write it anew",
            path.display()
        );
    }
}
