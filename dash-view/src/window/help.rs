//! The page of keys.

use eframe::egui::{Context, Grid, RichText, Ui, Window};

use super::actions::{BINDINGS, GESTURES};

/// Shows the page while `open`.
pub fn show(ctx: &Context, open: &mut bool) {
    Window::new("Keys").open(open).show(ctx, |ui| {
        ui.columns(2, |columns| {
            let half = BINDINGS.len().div_ceil(2);
            let keys = |ui: &mut Ui, id: &str, from: usize, to: usize| {
                Grid::new(id).num_columns(2).striped(true).show(ui, |ui| {
                    for binding in &BINDINGS[from..to] {
                        row(ui, &binding.label(), binding.what);
                    }
                });
            };
            keys(&mut columns[0], "first keys", 0, half);
            keys(&mut columns[1], "other keys", half, BINDINGS.len());
            columns[1].separator();
            Grid::new("gestures")
                .num_columns(2)
                .striped(true)
                .show(&mut columns[1], |ui| {
                    for (gesture, what) in GESTURES {
                        row(ui, gesture, what);
                    }
                });
        });
    });
}

fn row(ui: &mut Ui, key: &str, what: &str) {
    ui.label(RichText::new(key).strong());
    ui.label(what);
    ui.end_row();
}
