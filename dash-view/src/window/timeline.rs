//! The bar below: play, scrub, speed.

use eframe::egui::{ComboBox, Slider, Ui};

use super::actions::{Action, binding};
use crate::playback::{Playback, SPEEDS};

/// Shows the bar; what its buttons ask for.
pub fn show(ui: &mut Ui, playback: &mut Playback) -> Vec<Action> {
    let mut asked = Vec::new();
    ui.horizontal(|ui| {
        let mut button = |ui: &mut Ui, label: &str, action: Action| {
            if button(ui, label, action).clicked() {
                asked.push(action);
            }
        };
        button(ui, "|<", Action::Start);
        button(ui, "<", Action::StepBack);
        button(
            ui,
            if playback.playing { "Stop" } else { "Play" },
            Action::Play,
        );
        button(ui, ">", Action::StepForward);
        button(ui, ">|", Action::End);
        let loops = ui.selectable_label(playback.looping, "Loop");
        if with_tip(loops, Action::Loop).clicked() {
            asked.push(Action::Loop);
        }
        ComboBox::from_id_salt("speed")
            .width(56.0)
            .selected_text(speed_label(playback.speed))
            .show_ui(ui, |ui| {
                for speed in SPEEDS {
                    ui.selectable_value(&mut playback.speed, speed, speed_label(speed));
                }
            });
        let last = playback.n_frames() - 1;
        ui.label(format!("frame {} of {last}", playback.frame()));
        let mut time = f64::from(playback.time());
        ui.spacing_mut().slider_width = (ui.available_width() - 60.0).max(80.0);
        let slider = Slider::new(&mut time, 0.0..=1.0).show_value(false);
        let slider = ui.add(slider).on_hover_text("time: drag to scrub");
        if slider.changed() {
            playback.playing = false;
            playback.seek(time);
        }
        ui.label(format!("{:.3}", playback.time()));
    });
    asked
}

fn speed_label(speed: f64) -> String {
    format!("{speed}x")
}

/// A small button that says its key.
pub fn button(ui: &mut Ui, label: &str, action: Action) -> eframe::egui::Response {
    with_tip(ui.button(label), action)
}

/// Says what an action does, and its key.
pub fn with_tip(response: eframe::egui::Response, action: Action) -> eframe::egui::Response {
    match binding(action) {
        Some(binding) => response.on_hover_text(format!("{} ({})", binding.what, binding.label())),
        None => response,
    }
}
