//! A contact sheet of a run: one picture that shows how the scene looks.

use std::path::Path;

use dash_model::{DynamicScene, Layer};

use super::picture::render;
use crate::Error;
use crate::dataset::View;
use crate::video::write_png;

/// Instants that are shown.
const COLUMNS: usize = 5;

/// Writes a table of pictures: the captured views, the scene as rendered, its static and its dynamic
/// layer, one row each, at up to five of the views from first to last.
///
/// # Errors
/// When there is no view, the views differ in size, or the file can't be written.
pub fn write_overview(scene: &DynamicScene, views: &[&View], path: &Path) -> Result<(), Error> {
    let columns = views.len().min(COLUMNS);
    let shown: Vec<&View> = (0..columns)
        .map(|k| views[k * (views.len() - 1) / (columns - 1).max(1)])
        .collect();
    let Some(first) = shown.first() else {
        return Err(Error::run(
            path,
            "expected at least one view to show, found none",
        ));
    };
    let (width, height) = (first.camera.width, first.camera.height);
    if let Some(other) = shown
        .iter()
        .find(|v| (v.camera.width, v.camera.height) != (width, height))
    {
        let found = format!(
            "expected views of one size, found {} of {}x{} beside {width}x{height}",
            other.name, other.camera.width, other.camera.height
        );
        return Err(Error::run(path, found));
    }
    let mut rows: Vec<Vec<Vec<f32>>> = Vec::new();
    rows.push(
        shown
            .iter()
            .map(|view| view.rgb(scene.settings.background))
            .collect::<Result<_, _>>()?,
    );
    for layer in [Layer::Full, Layer::Static, Layer::Dynamic] {
        let pictures = shown
            .iter()
            .map(|view| Ok(render(scene, &view.camera, view.time, layer)?.rgb));
        rows.push(pictures.collect::<Result<_, Error>>()?);
    }
    let mut pixels = Vec::with_capacity(rows.len() * height * columns * width * 3);
    for row in &rows {
        for y in 0..height {
            for picture in row {
                let line = &picture[y * width * 3..(y + 1) * width * 3];
                pixels.extend(
                    line.iter()
                        .map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8),
                );
            }
        }
    }
    write_png(path, columns * width, rows.len() * height, &pixels)
}
