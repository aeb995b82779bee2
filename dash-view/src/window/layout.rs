//! Where everything is in the window.

use eframe::egui::{CentralPanel, Frame as Margin, Panel, Ui};

use super::app::App;
use super::{help, panel, picture, timeline};

/// One frame of the window.
pub fn show(ui: &mut Ui, app: &mut App) {
    let ctx = ui.ctx().clone();
    app.begin(&ctx);
    let asked = Panel::bottom("time")
        .show(ui, |ui| timeline::show(ui, &mut app.playback))
        .inner;
    asked.into_iter().for_each(|action| app.act(action));
    if app.show_panel {
        Panel::right("panel")
            .default_size(250.0)
            .show(ui, |ui| panel::show(ui, app));
    }
    CentralPanel::default()
        .frame(Margin::NONE)
        .show(ui, |ui| picture::show(ui, app));
    help::show(&ctx, &mut app.show_help);
    app.end(&ctx);
}
