//! The table of the page about methods: what is published, and what presets make of it.

use std::fs;
use std::path::Path;

use super::Method;
use crate::train::core::CaptureFacts;
use crate::train::paper::published::{
    EMBEDDING_FEATURES_OF_TIME, GRID4D_TEMPORAL_LEVELS, GRID4D_TEMPORAL_RESOLUTION,
    HEXPLANE_FEATURES, Published,
};
use crate::train::{Preset, TrainConfig};

/// Values by name.
type Values = Vec<(&'static str, String)>;

fn range<T: std::fmt::Display + PartialEq>([from, to]: [T; 2]) -> String {
    if from == to {
        return from.to_string();
    }
    format!("{from} to {to}")
}

fn share(value: f32) -> String {
    format!("{:.1} %", 100.0 * value)
}

fn published(method: Method, of: &Published) -> Values {
    let (field, rates, schedule) = (of.field, of.rates, of.schedule);
    let [from, until] = schedule.densify.map(|step| schedule.share(step));
    let reset = schedule.opacity_reset_interval;
    let reset = reset.map(|steps| format!("{steps} of {}", schedule.steps));
    let mut values = match method {
        Method::HexPlane => vec![
            ("levels", field.n_levels.to_string()),
            ("features of a level", HEXPLANE_FEATURES.to_string()),
            ("cells in space", range(field.resolution)),
        ],
        Method::Grid4d => vec![
            ("levels in space", field.n_levels.to_string()),
            ("levels with time", GRID4D_TEMPORAL_LEVELS.to_string()),
            (
                "entries of a table",
                format!("2^{}", field.log2_hashmap_size),
            ),
            ("cells in space", range(field.resolution)),
            ("the same with time", range(GRID4D_TEMPORAL_RESOLUTION)),
        ],
        _ => vec![
            ("features of a Gaussian", (2 * field.n_levels).to_string()),
            ("features of a time", EMBEDDING_FEATURES_OF_TIME.to_string()),
        ],
    };
    let grid = rates.grid.unwrap_or(rates.network);
    values.extend([
        ("cells in time, 300 frames", range(field.time_resolution)),
        ("hidden units", field.hidden.to_string()),
        ("rate of tables", format!("{grid:.1e}")),
        ("rate of networks", format!("{:.1e}", rates.network)),
        ("rates at the end", share(rates.last)),
        ("warm-up", share(schedule.share(schedule.warmup))),
        ("density control", range([share(from), share(until)])),
        ("steps between resets", reset.unwrap_or("none".into())),
    ]);
    values
}

fn preset(method: Method, preset: Preset) -> Vec<String> {
    let config = method.of(&TrainConfig::preset(preset));
    let facts = CaptureFacts {
        n_frames: 300,
        is_synchronized: true,
    };
    let field = config.method.deformation(&facts);
    let cells = |axis: usize| {
        range([
            field.encoder.base_resolution[axis],
            field.encoder.finest_resolution[axis],
        ])
    };
    let mut values = match method {
        Method::HexPlane => vec![
            field.encoder.n_levels.to_string(),
            field.encoder.n_features_per_level.to_string(),
            cells(0),
        ],
        Method::Grid4d => {
            let temporal = field.temporal.as_ref().expect("grids with time");
            vec![
                field.encoder.n_levels.to_string(),
                temporal.n_levels.to_string(),
                format!("2^{}", field.encoder.log2_hashmap_size),
                cells(0),
                range([temporal.base_resolution[0], temporal.finest_resolution[0]]),
            ]
        }
        _ => vec![
            field.embedding_width().to_string(),
            (8 * field.embedding_width()).to_string(),
        ],
    };
    let (rates, densify) = (&config.optimizer, &config.densify);
    let [from, until] = densify.static_set.during;
    let reset = densify.opacity_reset_interval;
    let reset = reset.map(|steps| format!("{steps} of {}", config.iterations));
    values.extend([
        cells(3),
        field.hidden.to_string(),
        format!("{:.1e}", rates.grid),
        format!("{:.1e}", rates.network),
        share(rates.field_final),
        share(config.method.stages[0]),
        range([share(from), share(until)]),
        reset.unwrap_or("none".into()),
    ]);
    values
}

fn rows() -> String {
    let mut rows = Vec::new();
    for method in [Method::HexPlane, Method::Grid4d, Method::Embedding] {
        let of = published(method, method.published().expect("another method's"));
        let [quick, paper] = [Preset::Quick, Preset::Paper].map(|name| preset(method, name));
        for (((name, value), quick), paper) in of.iter().zip(quick).zip(paper) {
            rows.push(format!(
                "| `{method}` | {name} | {value} | {quick} | {paper} |"
            ));
        }
    }
    rows.join("\n")
}

#[test]
fn the_page_about_methods_has_their_values() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/src/howto/compare.md");
    let text = fs::read_to_string(&page).expect("the page");
    let rows = rows();
    assert!(
        text.contains(&rows),
        "{}: expected these rows:\n{rows}",
        page.display()
    );
}
