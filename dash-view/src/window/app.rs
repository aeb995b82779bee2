//! The window's state, and what happens to it before and after it is shown.

use std::collections::VecDeque;
use std::sync::Arc;

use dash_kernels::Camera;
use eframe::egui::{Context, Key, ViewportCommand};
use glam::DVec3;

use super::actions::pressed;
use super::glass::{Glass, Shown};
use super::title;
use crate::camera_path::PathCamera;
use crate::draw::ViewLayer;
use crate::navigator::Navigator;
use crate::pace::Pace;
use crate::playback::Playback;
use crate::tracks::Tracks;
use crate::worker::{Drawn, Opened, Reply, Request, Task, Worker};

/// Seconds after which an eye that stopped is at rest, and its picture sharp.
const REST_SECS: f64 = 0.15;
/// Distances to the target that a flight covers in a second, and how much faster it is with Shift.
const FLIGHT: [f64; 2] = [0.8, 4.0];
/// Distance of the first eye, by the radius of the middle half of the Gaussians.
const FIRST_DISTANCE: f64 = 4.0;
/// Drawn pictures that the rate is measured over.
const RATE_WINDOW: usize = 20;

/// How the captured picture is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CapturedView {
    /// Not at all.
    #[default]
    Hidden,
    /// At the right of the drawn one.
    Beside,
    /// At the right of a line that can be moved.
    Slider,
    /// As how far both are apart.
    Difference,
}

impl CapturedView {
    pub const ALL: [Self; 4] = [Self::Hidden, Self::Beside, Self::Slider, Self::Difference];

    pub fn name(self) -> &'static str {
        match self {
            Self::Hidden => "hidden",
            Self::Beside => "beside",
            Self::Slider => "slider",
            Self::Difference => "difference",
        }
    }
}

/// A line below the picture.
pub struct Message {
    pub text: String,
    pub is_error: bool,
}

/// The window's state.
pub struct App {
    pub(super) worker: Worker,
    /// Where pictures are shown that stay on the GPU.
    glass: Option<Glass>,
    /// Whether the scene that trains was asked for.
    begun: bool,
    pub opened: Option<Opened>,
    pub eye: Navigator,
    /// The camera that is looked through.
    pub through: Option<usize>,
    pub playback: Playback,
    pub layer: ViewLayer,
    pub captured: CapturedView,
    /// Where the line between the drawn and the captured picture is, of the width.
    pub split: f32,
    pub show_cameras: bool,
    pub background: Option<[f32; 3]>,
    pub tracks: Option<Arc<Tracks>>,
    /// Dynamic Gaussians whose ways are drawn.
    pub picked: Vec<usize>,
    /// A click that waits for the tracks.
    pending_pick: Option<(Camera, f32, [f64; 2])>,
    pub keyframes: Vec<PathCamera>,
    pace: Pace,
    /// The full size of the picture in the window, pixels.
    pub full: [usize; 2],
    pub(super) asked: Option<Request>,
    pub shown: Option<Shown>,
    pub message: Option<Message>,
    pub show_panel: bool,
    pub show_help: bool,
    /// When the eye moved last, seconds.
    moved_at: f64,
    /// When pictures came, seconds.
    drawn_at: VecDeque<f64>,
}

impl App {
    pub fn new(worker: Worker, glass: Option<Glass>) -> Self {
        Self {
            worker,
            glass,
            begun: false,
            opened: None,
            eye: Navigator::new(DVec3::ZERO, 1.0),
            through: None,
            playback: Playback::new(1, 1.0),
            layer: ViewLayer::default(),
            captured: CapturedView::default(),
            split: 0.5,
            show_cameras: false,
            background: None,
            tracks: None,
            picked: Vec::new(),
            pending_pick: None,
            keyframes: Vec::new(),
            pace: Pace::default(),
            full: [1, 1],
            asked: None,
            shown: None,
            message: None,
            show_panel: true,
            show_help: false,
            moved_at: f64::NEG_INFINITY,
            drawn_at: VecDeque::new(),
        }
    }

    /// Begins a frame: takes what came and what was pressed.
    pub(super) fn begin(&mut self, ctx: &Context) {
        self.follow(ctx);
        self.take_replies(ctx);
        if !ctx.egui_wants_keyboard_input() {
            for action in ctx.input(pressed) {
                self.act(action);
            }
            self.fly(ctx);
        }
        if let Some(file) = ctx.input(|input| input.raw.dropped_files.first().cloned()) {
            self.ask(Task::Open(file.path().to_path_buf()));
        }
    }

    /// Ends a frame: lets time pass, and asks for the picture.
    pub(super) fn end(&mut self, ctx: &Context) {
        self.pass_time(ctx);
        self.request(ctx);
    }

    /// Takes part in a run that trains.
    fn follow(&mut self, ctx: &Context) {
        let Some(live) = self.worker.live() else {
            return;
        };
        if live.is_over() {
            ctx.send_viewport_cmd(ViewportCommand::Close);
        }
        if live.version() > 0 && !self.begun {
            self.begun = true;
            self.ask(Task::Begin);
        }
    }

    /// How far the run is that trains.
    pub fn line(&self) -> Option<String> {
        self.worker.live().map(|live| live.line())
    }

    fn take_replies(&mut self, ctx: &Context) {
        let replies: Vec<Reply> = self.worker.replies().collect();
        for reply in replies {
            match reply {
                Reply::Opened(opened) => self.open(ctx, *opened),
                Reply::Drawn(drawn) => self.take_picture(ctx, *drawn),
                Reply::Tracks(tracks) => {
                    self.tracks = tracks;
                    if self.tracks.is_none() {
                        self.say("nothing is dynamic here", false);
                    }
                    if let Some((camera, time, pixel)) = self.pending_pick.take() {
                        self.pick(&camera, time, pixel);
                    }
                }
                Reply::Saved(path) => self.say(&format!("written: {}", path.display()), false),
                Reply::Failed(why) => self.say(&why, true),
            }
        }
    }

    pub fn say(&mut self, text: &str, is_error: bool) {
        self.message = Some(Message {
            text: text.into(),
            is_error,
        });
    }

    fn open(&mut self, ctx: &Context, opened: Opened) {
        ctx.send_viewport_cmd(ViewportCommand::Title(title(&opened.name)));
        self.playback = Playback::new(opened.n_frames, opened.frame_rate);
        let focus = DVec3::from(opened.focus);
        self.eye = Navigator::new(focus, FIRST_DISTANCE * opened.radius);
        let down: DVec3 = opened
            .cameras
            .iter()
            .map(|entry| DVec3::from(entry.camera.rotation[1]))
            .sum();
        self.eye.set_up(-down);
        (self.tracks, self.pending_pick, self.asked) = (None, None, None);
        (self.picked, self.keyframes) = (Vec::new(), Vec::new());
        self.message = None;
        let first = opened.cameras.iter().position(|camera| camera.held_out);
        let first = first.or((!opened.cameras.is_empty()).then_some(0));
        self.opened = Some(opened);
        if let Some(first) = first {
            let playing = self.playback.playing;
            self.look_through(first);
            self.playback.playing = playing;
        }
        self.eye.set_home();
    }

    fn take_picture(&mut self, ctx: &Context, drawn: Drawn) {
        self.drawn_at.push_back(ctx.input(|input| input.time));
        if self.drawn_at.len() > RATE_WINDOW {
            self.drawn_at.pop_front();
        }
        if let Some(opened) = &mut self.opened {
            opened.counts = drawn.counts;
        }
        let size = drawn.picture.size();
        self.pace.saw(size, self.full, drawn.secs);
        if self
            .message
            .as_ref()
            .is_some_and(|message| message.is_error)
        {
            self.message = None;
        }
        // Only the window's own device is shared: a texture without a glass can't be.
        if let Some(shown) = Shown::of(drawn, ctx, self.glass.as_mut()) {
            self.shown = Some(shown);
        }
    }

    /// Pictures per second, of the last ones.
    pub fn rate(&self) -> Option<f64> {
        let (first, last) = (self.drawn_at.front()?, self.drawn_at.back()?);
        (last > first).then(|| (self.drawn_at.len() - 1) as f64 / (last - first))
    }

    pub fn ask(&self, task: Task) {
        self.worker.ask(task);
    }

    /// The eye was moved by hand: it looks through no camera any longer.
    pub fn moved(&mut self, ctx: &Context) {
        self.through = None;
        self.moved_at = ctx.input(|input| input.time);
    }

    fn fly(&mut self, ctx: &Context) {
        let (direction, fast, secs) = ctx.input(|input| {
            let axis =
                |back, on| f64::from(i8::from(input.key_down(on)) - i8::from(input.key_down(back)));
            let direction = [
                axis(Key::A, Key::D),
                axis(Key::E, Key::Q),
                axis(Key::S, Key::W),
            ];
            let plain = !(input.modifiers.ctrl || input.modifiers.alt || input.modifiers.command);
            let direction = direction.map(|value| if plain { value } else { 0.0 });
            (direction, input.modifiers.shift, f64::from(input.stable_dt))
        });
        if direction == [0.0; 3] {
            return;
        }
        let speed = if fast {
            FLIGHT[0] * FLIGHT[1]
        } else {
            FLIGHT[0]
        };
        let [right, down, forward] = direction.map(|value| value * speed * secs);
        self.eye.fly(right, down, forward);
        self.moved(ctx);
        ctx.request_repaint();
    }

    /// Finds the dynamic Gaussian at a pixel of a camera's picture; looks for the tracks first.
    pub fn pick(&mut self, camera: &Camera, time: f32, pixel: [f64; 2]) {
        let Some(tracks) = &self.tracks else {
            let is_dynamic = self.opened.as_ref().is_some_and(|o| o.counts.1 > 0);
            if is_dynamic {
                self.pending_pick = Some((camera.clone(), time, pixel));
                self.ask(Task::Track);
            }
            return;
        };
        if let Some(gaussian) = tracks.pick(camera, time, pixel)
            && !self.picked.contains(&gaussian)
        {
            self.picked.push(gaussian);
        }
    }

    fn pass_time(&mut self, ctx: &Context) {
        if self.playback.playing {
            self.playback
                .advance(f64::from(ctx.input(|input| input.stable_dt)));
            ctx.request_repaint();
        }
    }

    /// The camera that is looked through, if its picture is to be compared with the captured one.
    fn compared(&self) -> Option<usize> {
        self.through
            .filter(|_| self.captured != CapturedView::Hidden)
    }

    /// The eye as a camera of this size, or of the shape of the camera that is looked through.
    pub fn camera(&self, [width, height]: [usize; 2]) -> Camera {
        let through = self.through.zip(self.opened.as_ref());
        let Some(own) = through.and_then(|(index, opened)| opened.cameras.get(index)) else {
            return self.eye.camera(width, height);
        };
        let own = &own.camera;
        if self.compared().is_some() {
            return own.clone();
        }
        let (w, h) = (own.width as f64, own.height as f64);
        let scale = (width as f64 / w).min(height as f64 / h);
        let side = |side: f64| ((side * scale).round() as usize).max(1);
        own.resized(side(w), side(h))
    }

    /// Takes in the size of the picture's place in the window, pixels.
    pub fn set_full(&mut self, full: [usize; 2]) {
        self.full = full.map(|side| side.max(1));
    }

    /// Asks for the picture, unless it is the last one that was asked for.
    fn request(&mut self, ctx: &Context) {
        if self.opened.is_none() {
            return;
        }
        let now = ctx.input(|input| input.time);
        let resting = now - self.moved_at;
        let moving = self.playback.playing || resting < REST_SECS;
        if moving && !self.playback.playing {
            let rest = std::time::Duration::from_secs_f64(REST_SECS - resting + 0.01);
            ctx.request_repaint_after(rest);
        }
        let request = Request {
            camera: self.camera(self.pace.size(self.full, moving)),
            time: self.playback.time(),
            frame: self.playback.frame(),
            version: self.worker.live().map_or(0, |live| live.version()),
            layer: self.layer,
            background: self.background,
            beside: self.compared(),
        };
        if self.asked.as_ref() != Some(&request) {
            self.worker.draw(request.clone());
            self.asked = Some(request);
        }
    }
}
