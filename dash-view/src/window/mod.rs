//! The window.
//!
//! `layout`: where everything is. `app`: its state, and what happens to it in a frame. `actions`: what can be done, and by which key; `act` does it. `picture`: the picture, the
//! hand on it, and what is drawn over it. `glass`: the pictures in the window. `timeline`: the bar
//! below. `panel`: the bar at the side. `help`: the page of keys.

mod act;
mod actions;
mod app;
mod glass;
mod help;
mod layout;
mod panel;
mod picture;
#[cfg(test)]
mod tests;
mod timeline;

use std::ffi::OsString;

use eframe::egui;

use crate::worker::Worker;
use crate::{Content, Host, Screen, Source, ViewError};
use app::App;
use glass::Glass;

/// The window's size when it opens, points.
const SIZE: [f32; 2] = [1280.0, 800.0];

/// Opens a window on a content, and returns when it is closed. Systems want it on the program's first thread.
///
/// With `screen`, the window is drawn by the GPU that draws the scene, and a picture stays there.
///
/// # Errors
/// When the system can't open a window.
pub fn open_window(
    content: Content,
    host: Box<dyn Host>,
    screen: Option<Screen>,
) -> Result<(), ViewError> {
    check_display()?;
    let live = match &content.source {
        Source::Live(live, _) => Some(live.clone()),
        Source::Scene(_) | Source::Frames(_) | Source::Windows(_) => None,
    };
    let closed = live.clone();
    let title = title(&content.name);
    let viewport = egui::ViewportBuilder::default()
        .with_title(&title)
        .with_app_id("dash-view")
        .with_inner_size(SIZE)
        .with_drag_and_drop(true);
    let mut options = eframe::NativeOptions {
        viewport,
        ..Default::default()
    };
    if let Some(screen) = &screen {
        options.wgpu_options.wgpu_setup = screen.setup().into();
    }
    let create = move |creation: &eframe::CreationContext<'_>| {
        let ctx = creation.egui_ctx.clone();
        if let Some(live) = live {
            let ctx = ctx.clone();
            live.on_change(move || ctx.request_repaint());
        }
        let worker = Worker::start(content, host, screen, move || ctx.request_repaint())?;
        let glass = creation.wgpu_render_state.clone().map(Glass::new);
        Ok(Box::new(Window(App::new(worker, glass))) as Box<dyn eframe::App>)
    };
    let done = eframe::run_native(&title, options, Box::new(create));
    if let Some(live) = closed {
        live.closed();
    }
    done.map_err(|error| ViewError::Window(error.to_string()))
}

/// Whether there is a display to open a window on.
///
/// # Errors
/// When there is none.
pub fn check_display() -> Result<(), ViewError> {
    if cfg!(target_os = "linux") && !has_display(|name| std::env::var_os(name)) {
        let missing = "neither WAYLAND_DISPLAY nor DISPLAY is set";
        return Err(ViewError::Window(missing.into()));
    }
    Ok(())
}

/// Whether the environment of a Linux program names a display.
fn has_display(variable: impl Fn(&str) -> Option<OsString>) -> bool {
    let names = ["WAYLAND_DISPLAY", "WAYLAND_SOCKET", "DISPLAY"];
    let mut values = names.into_iter().filter_map(variable);
    values.any(|value| !value.is_empty())
}

fn title(name: &str) -> String {
    format!("{name} - dash view")
}

struct Window(App);

impl eframe::App for Window {
    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        layout::show(ui, &mut self.0);
    }
}
