//! The bar at the side: layers, cameras, the captured picture, the camera path, numbers.

use eframe::egui::{Grid, ScrollArea, Ui};

use super::actions::Action;
use super::app::{App, CapturedView};
use super::timeline::{button, with_tip};
use crate::draw::ViewLayer;

/// Shows the bar.
pub fn show(ui: &mut Ui, app: &mut App) {
    ui.add_space(4.0);
    ui.horizontal_wrapped(|ui| {
        for (label, action) in [
            ("Reset", Action::Reset),
            ("Save picture", Action::Screenshot),
            ("Background", Action::Background),
            ("Keys ?", Action::Help),
        ] {
            if button(ui, label, action).clicked() {
                app.act(action);
            }
        }
    });
    ui.separator();
    layers(ui, app);
    ui.separator();
    captured(ui, app);
    ui.separator();
    path(ui, app);
    ui.separator();
    numbers(ui, app);
    ui.separator();
    cameras(ui, app);
}

fn layers(ui: &mut Ui, app: &mut App) {
    ui.strong("Layer");
    ui.horizontal_wrapped(|ui| {
        for layer in ViewLayer::ALL {
            let label = ui.selectable_label(app.layer == layer, layer.to_string());
            if with_tip(label, Action::Layer(layer)).clicked() {
                app.layer = layer;
            }
        }
    });
    ui.small(app.layer.description());
    if !app.picked.is_empty() {
        ui.horizontal(|ui| {
            ui.label(format!("{} picked", app.picked.len()));
            if button(ui, "forget", Action::DropTracks).clicked() {
                app.act(Action::DropTracks);
            }
        });
    }
}

fn captured(ui: &mut Ui, app: &mut App) {
    ui.strong("Captured picture");
    ui.horizontal_wrapped(|ui| {
        for view in CapturedView::ALL {
            let label = ui.selectable_label(app.captured == view, view.name());
            if with_tip(label, Action::Captured).clicked() {
                app.captured = view;
            }
        }
    });
    let beside = app
        .shown
        .as_ref()
        .and_then(|shown| shown.drawn.beside.as_ref());
    let line = match (app.captured, app.through, beside) {
        (CapturedView::Hidden, ..) => String::new(),
        (_, None, _) => "look through a camera to compare".into(),
        (_, _, None) => "none here at this time".into(),
        (_, _, Some(beside)) => format!("{:.2} dB", beside.psnr),
    };
    ui.label(line);
}

fn path(ui: &mut Ui, app: &mut App) {
    ui.strong("Camera path");
    ui.horizontal_wrapped(|ui| {
        for (label, action) in [
            ("Add", Action::AddKeyframe),
            ("Forget", Action::DropKeyframes),
            ("Save", Action::SavePath),
            ("Render", Action::RenderPath),
        ] {
            if button(ui, label, action).clicked() {
                app.act(action);
            }
        }
    });
    ui.small(format!("keyframes: {}", app.keyframes.len()));
}

fn numbers(ui: &mut Ui, app: &App) {
    ui.strong("Numbers");
    if let Some(line) = app.line() {
        ui.small(line);
    }
    Grid::new("numbers").num_columns(2).show(ui, |ui| {
        let mut row = |name: &str, value: String| {
            ui.label(name);
            ui.label(value);
            ui.end_row();
        };
        if let Some(opened) = &app.opened {
            let (n_static, n_dynamic) = opened.counts;
            row("static", n_static.to_string());
            row("dynamic", n_dynamic.to_string());
            row("scene", format!("{:.1} MB", opened.bytes as f64 / 1e6));
        }
        if let Some(shown) = &app.shown {
            let drawn = &shown.drawn;
            let [width, height] = drawn.picture.size();
            row("picture", format!("{width} x {height}"));
            row("drawn in", format!("{:.1} ms", 1e3 * drawn.secs));
        }
        if let Some(rate) = app.rate().filter(|_| app.playback.playing) {
            row("pictures", format!("{rate:.1} a second"));
        }
        if let Some(bytes) = resident_bytes() {
            row("memory", format!("{:.0} MB", bytes as f64 / 1e6));
        }
    });
}

fn cameras(ui: &mut Ui, app: &mut App) {
    let Some(opened) = &app.opened else {
        return;
    };
    let names: Vec<String> = opened
        .cameras
        .iter()
        .map(|camera| match camera.held_out {
            true => format!("{} (held out)", camera.name),
            false => camera.name.clone(),
        })
        .collect();
    ui.horizontal(|ui| {
        ui.strong(format!("{} cameras", names.len()));
        let shown = ui.selectable_label(app.show_cameras, "show");
        if with_tip(shown, Action::Cameras).clicked() {
            app.act(Action::Cameras);
        }
    });
    let row_height = ui.spacing().interact_size.y;
    ScrollArea::vertical().show_rows(ui, row_height, names.len(), |ui, rows| {
        for index in rows {
            if ui
                .selectable_label(app.through == Some(index), &names[index])
                .clicked()
            {
                app.look_through(index);
            }
        }
    });
}

/// Memory of this program; `None` where the system does not say.
fn resident_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kilobytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(1024 * kilobytes)
}
