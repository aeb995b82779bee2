//! The picture, the hand on it, and what is drawn over it.

use std::f32::consts::PI;

use dash_kernels::Camera;
use eframe::egui::{
    Align2, Color32, FontId, PointerButton, Pos2, Rect, Response, Sense, Stroke, Ui, Vec2, pos2,
    vec2,
};

use super::app::{App, CapturedView};
use super::glass::Shown;
use crate::camera_path::{between, frustum};

/// Distance by which the wheel's points multiply.
const ZOOM_PER_POINT: f64 = 0.002;
/// Cameras of the path that its line is drawn with.
const PATH_POINTS: usize = 90;
/// Depth of a drawn camera, by the distance to the focus.
const FRUSTUM_DEPTH: f64 = 0.08;

const PASSED: Color32 = Color32::from_rgb(255, 200, 60);
const COMING: Color32 = Color32::from_rgb(255, 255, 255);
const TRAINED: Color32 = Color32::from_rgb(90, 160, 255);
const HELD_OUT: Color32 = Color32::from_rgb(255, 110, 90);
const PATH: Color32 = Color32::from_rgb(110, 230, 140);
const ERROR: Color32 = Color32::from_rgb(255, 130, 120);

/// Shows the picture in all the room there is.
pub fn show(ui: &mut Ui, app: &mut App) {
    let place = ui.available_rect_before_wrap();
    let response = ui.allocate_rect(place, Sense::click_and_drag());
    let scale = ui.ctx().pixels_per_point();
    app.set_full([place.width(), place.height()].map(|side| (side * scale).round() as usize));
    let painter = ui.painter().with_clip_rect(place);
    painter.rect_filled(place, 0.0, Color32::from_gray(20));
    if let Some(shown) = &app.shown {
        let rects = paint(&painter, place, app, shown);
        for rect in &rects {
            overlay(
                &painter.with_clip_rect(rect.intersect(place)),
                *rect,
                app,
                &shown.drawn.request.camera,
            );
        }
        let camera = shown.drawn.request.camera.clone();
        let time = shown.drawn.request.time;
        hand(
            ui,
            app,
            &response,
            place,
            rects.first().copied(),
            &camera,
            time,
        );
    }
    message(&painter, place, app);
}

/// Paints the picture; where it is then.
fn paint(painter: &eframe::egui::Painter, place: Rect, app: &App, shown: &Shown) -> Vec<Rect> {
    let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
    let [width, height] = shown.drawn.picture.size();
    let size = vec2(width as f32, height as f32);
    let picture = shown.picture;
    let pair = shown.captured.as_ref().zip(shown.difference.as_ref());
    match (app.captured, pair) {
        (CapturedView::Beside, Some((captured, _))) => {
            let (left, right) = place.split_left_right_at_fraction(0.5);
            let (left, right) = (fit(left, size), fit(right, size));
            painter.image(picture, left, whole, Color32::WHITE);
            painter.image(captured.id(), right, whole, Color32::WHITE);
            vec![left, right]
        }
        (CapturedView::Slider, Some((captured, _))) => {
            let rect = fit(place, size);
            painter.image(picture, rect, whole, Color32::WHITE);
            let at = rect.left() + app.split * rect.width();
            let right = Rect::from_min_max(pos2(at, rect.top()), rect.max);
            let part = Rect::from_min_max(pos2(app.split, 0.0), pos2(1.0, 1.0));
            painter.image(captured.id(), right, part, Color32::WHITE);
            painter.vline(at, rect.y_range(), Stroke::new(2.0, Color32::WHITE));
            vec![rect]
        }
        (CapturedView::Difference, Some((_, difference))) => {
            let rect = fit(place, size);
            painter.image(difference.id(), rect, whole, Color32::WHITE);
            vec![rect]
        }
        _ => {
            let rect = fit(place, size);
            painter.image(picture, rect, whole, Color32::WHITE);
            vec![rect]
        }
    }
}

/// The largest place of a picture's shape, in the middle.
fn fit(place: Rect, size: Vec2) -> Rect {
    let scale = (place.width() / size.x).min(place.height() / size.y);
    Rect::from_center_size(place.center(), size * scale)
}

/// What the mouse does.
fn hand(
    ui: &Ui,
    app: &mut App,
    response: &Response,
    place: Rect,
    rect: Option<Rect>,
    camera: &Camera,
    time: f32,
) {
    let ctx = ui.ctx();
    let modifiers = ctx.input(|input| input.modifiers);
    let drag = response.drag_delta();
    if drag != Vec2::ZERO {
        let by = drag / place.height();
        let (x, y) = (f64::from(by.x), f64::from(by.y));
        let secondary = [PointerButton::Secondary, PointerButton::Middle];
        let pans = modifiers.shift || secondary.into_iter().any(|b| response.dragged_by(b));
        let slides = app.captured == CapturedView::Slider && app.through.is_some();
        if slides {
            let width = rect.map_or(place.width(), |rect| rect.width());
            app.split = (app.split + drag.x / width).clamp(0.0, 1.0);
        } else {
            let angle = f64::from(PI);
            match (pans, modifiers.ctrl || modifiers.command) {
                (true, _) => app.eye.pan(x, y),
                (_, true) => app
                    .eye
                    .turn(x * app.eye.field_of_view(), y * app.eye.field_of_view()),
                _ => app.eye.orbit(x * angle, y * angle),
            }
            app.moved(ctx);
        }
    }
    let wheel = ctx.input(|input| f64::from(input.smooth_scroll_delta().y));
    let pinch = ctx.input(|input| f64::from(input.zoom_delta()));
    if response.hovered() && (wheel != 0.0 || pinch != 1.0) {
        app.eye.zoom((-wheel * ZOOM_PER_POINT).exp() / pinch);
        app.moved(ctx);
    }
    if response.clicked()
        && let Some((pointer, rect)) = response.interact_pointer_pos().zip(rect)
    {
        let scale = camera.width as f32 / rect.width();
        let at = (pointer - rect.min) * scale;
        app.pick(camera, time, [f64::from(at.x), f64::from(at.y)]);
    }
}

/// Ways of picked Gaussians, cameras, the camera path.
fn overlay(painter: &eframe::egui::Painter, rect: Rect, app: &App, camera: &Camera) {
    let scale = rect.width() / camera.width as f32;
    let place = |point: [f64; 3]| -> Option<Pos2> {
        let (pixel, _) = camera.project(point)?;
        Some(rect.min + vec2(pixel[0] as f32, pixel[1] as f32) * scale)
    };
    let line = |from: [f64; 3], to: [f64; 3], stroke: Stroke| {
        if let Some((from, to)) = place(from).zip(place(to)) {
            painter.line_segment([from, to], stroke);
        }
    };
    if let Some(tracks) = &app.tracks {
        let now = app.playback.time();
        for &gaussian in &app.picked {
            let way: Vec<(f32, [f64; 3])> = tracks.track(gaussian).collect();
            for pair in way.windows(2) {
                let color = if pair[1].0 <= now { PASSED } else { COMING };
                line(pair[0].1, pair[1].1, Stroke::new(1.5, color));
            }
            let nearest = way
                .iter()
                .min_by(|a, b| (a.0 - now).abs().total_cmp(&(b.0 - now).abs()));
            if let Some(at) = nearest.and_then(|(_, point)| place(*point)) {
                painter.circle_filled(at, 4.0, PASSED);
            }
        }
    }
    if let Some(opened) = app.opened.as_ref().filter(|_| app.show_cameras) {
        for (index, entry) in opened.cameras.iter().enumerate() {
            if app.through == Some(index) {
                continue;
            }
            let eye = entry.camera.position();
            let offset = std::array::from_fn::<f64, 3, _>(|k| eye[k] - opened.focus[k]);
            let distance = offset.iter().map(|v| v * v).sum::<f64>().sqrt();
            let color = if entry.held_out { HELD_OUT } else { TRAINED };
            let stroke = Stroke::new(1.0, color);
            let [eye, corners @ ..] = frustum(&entry.camera, FRUSTUM_DEPTH * distance);
            for k in 0..4 {
                line(eye, corners[k], stroke);
                line(corners[k], corners[(k + 1) % 4], stroke);
            }
            if let Some(at) = place(eye) {
                painter.text(
                    at,
                    Align2::LEFT_BOTTOM,
                    &entry.name,
                    FontId::proportional(11.0),
                    color,
                );
            }
        }
    }
    let path = between(&app.keyframes, PATH_POINTS);
    for pair in path.windows(2) {
        line(
            pair[0].camera.position(),
            pair[1].camera.position(),
            Stroke::new(1.5, PATH),
        );
    }
}

/// The line below the picture.
fn message(painter: &eframe::egui::Painter, place: Rect, app: &App) {
    let waiting = app.shown.is_none().then_some(("opening ..", false));
    let said = app
        .message
        .as_ref()
        .map(|message| (message.text.as_str(), message.is_error));
    let Some((text, is_error)) = said.or(waiting) else {
        return;
    };
    let color = if is_error { ERROR } else { Color32::WHITE };
    let galley = painter.layout(
        text.to_string(),
        FontId::proportional(14.0),
        color,
        place.width() - 24.0,
    );
    let at = place.left_bottom() + vec2(12.0, -galley.size().y - 10.0);
    let behind = Rect::from_min_size(at, galley.size()).expand(5.0);
    painter.rect_filled(behind, 3.0, Color32::from_black_alpha(190));
    painter.galley(at, galley, color);
}
