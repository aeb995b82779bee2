//! The window without a window: its frames are run one after the other, with keys and a mouse.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};

use burn::tensor::Device;
use dash_kernels::Camera;
use dash_model::{DynamicScene, GaussianRows, Gaussians, SceneSettings};
use eframe::egui::{
    Context, Event, Key, Modifiers, PointerButton, Pos2, RawInput, Rect, ViewportCommand, pos2,
    vec2,
};

use super::app::{App, CapturedView};
use super::layout;
use crate::camera_path::PathCamera;
use crate::draw::{Frame, ViewLayer};
use crate::worker::{Drawn, DrawnPicture, Worker};
use crate::{Content, FrameSource, Host, Live, NamedCamera, Source, ViewError};

const SIZE: [f32; 2] = [800.0, 600.0];

/// A few Gaussians at `x`.
fn scene(x: f32) -> DynamicScene {
    let points = [[x, 0.0, 0.0], [x + 0.3, 0.1, 0.2], [x - 0.2, -0.2, 0.1]];
    let mut rows = GaussianRows::from_points(&points, &[[0.9, 0.3, 0.1]; 3], 0, 0.1);
    rows.opacity_logits = vec![2.0; 3];
    DynamicScene {
        static_set: Gaussians::from_rows(&rows, &Device::flex()),
        dynamic: None,
        settings: SceneSettings::default(),
    }
}

fn camera(x: f64) -> Camera {
    Camera::new(60.0, 60.0, 40.0, 30.0, 80, 60).look_at([x, 0.0, -3.0], [0.0; 3], [0.0, -1.0, 0.0])
}

/// One scene for each frame.
struct Frames;

impl FrameSource for Frames {
    fn scene(&mut self, frame: usize) -> Result<DynamicScene, ViewError> {
        match frame {
            4 => Err(ViewError::Host("frame 4 is damaged".into())),
            frame => Ok(scene(0.2 * frame as f32)),
        }
    }
}

/// A host that remembers what it was asked.
struct Asked(std::sync::mpsc::Sender<String>);

impl Host for Asked {
    fn captured(&mut self, camera: usize, time: f32) -> Result<Option<Vec<u8>>, ViewError> {
        let _ = self.0.send(format!("captured {camera} at {time}"));
        Ok((camera == 0).then(|| vec![0; 80 * 60 * 3]))
    }

    fn open(&mut self, path: &Path) -> Result<Content, ViewError> {
        let source = Source::Scene(Box::new(scene(0.0)));
        Ok(Content::new(&path.display().to_string(), source, 1))
    }

    fn save_picture(&mut self, frame: &Frame) -> Result<PathBuf, ViewError> {
        let _ = self
            .0
            .send(format!("picture {}x{}", frame.width, frame.height));
        Ok("a.png".into())
    }

    fn save_path(&mut self, path: &[PathCamera]) -> Result<PathBuf, ViewError> {
        let _ = self.0.send(format!("path of {}", path.len()));
        Ok("a.json".into())
    }

    fn render_path(&mut self, _: &DynamicScene, path: &[PathCamera]) -> Result<PathBuf, ViewError> {
        let _ = self.0.send(format!("video of {}", path.len()));
        Ok("a.mp4".into())
    }
}

/// The colours of a picture in host memory.
fn rgb(drawn: &Drawn) -> Vec<u8> {
    match &drawn.picture {
        DrawnPicture::Host(frame) => frame.rgb(),
        DrawnPicture::Texture(_) => panic!("there is no screen"),
    }
}

struct Bench {
    app: App,
    ctx: Context,
    woken: Receiver<()>,
    asked: Receiver<String>,
    time: f64,
    modifiers: Modifiers,
}

impl Bench {
    fn new(content: Content) -> Self {
        let mut bench = Self::unopened(content);
        bench.reply();
        bench.reply();
        bench
    }

    /// Before the thread that draws has said anything.
    fn unopened(content: Content) -> Self {
        let (wake, woken) = channel();
        let (ask, asked) = channel();
        let worker = Worker::start(content, Box::new(Asked(ask)), None, move || {
            let _ = wake.send(());
        });
        Self {
            app: App::new(worker.expect("a thread"), None),
            ctx: Context::default(),
            woken,
            asked,
            time: 0.0,
            modifiers: Modifiers::NONE,
        }
    }

    /// Runs one frame, 20 ms after the last.
    fn frame(&mut self, events: Vec<Event>) {
        self.time += 0.02;
        let input = RawInput {
            screen_rect: Some(Rect::from_min_size(Pos2::ZERO, SIZE.into())),
            time: Some(self.time),
            predicted_dt: 0.02,
            events: [vec![Event::ModifiersChanged(self.modifiers)], events].concat(),
            ..Default::default()
        };
        let _ = self
            .ctx
            .clone()
            .run_ui(input, |ui| layout::show(ui, &mut self.app));
    }

    /// Waits for the next reply, and runs a frame.
    fn reply(&mut self) {
        self.frame(Vec::new());
        self.woken.recv().expect("the thread that draws");
        self.frame(Vec::new());
    }

    /// Runs frames until the eye is at rest and the picture that was asked for last is there.
    fn rest(&mut self) {
        for _ in 0..12 {
            self.frame(Vec::new());
        }
        self.app.worker.wait_until_idle();
        while self.woken.try_recv().is_ok() {}
        self.frame(Vec::new());
    }

    fn press(&mut self, key: Key) {
        for pressed in [true, false] {
            let event = Event::Key {
                key,
                physical_key: None,
                pressed,
                repeat: false,
                modifiers: self.modifiers,
            };
            self.frame(vec![event]);
        }
    }

    fn press_shift(&mut self, key: Key) {
        self.modifiers = Modifiers::SHIFT;
        self.press(key);
        self.modifiers = Modifiers::NONE;
    }

    fn drag(&mut self, from: Pos2, to: Pos2, button: PointerButton) {
        let pressed = |pos, pressed| Event::PointerButton {
            pos,
            button,
            pressed,
            modifiers: Modifiers::NONE,
        };
        self.frame(vec![Event::PointerMoved(from)]);
        self.frame(vec![pressed(from, true)]);
        self.frame(vec![Event::PointerMoved(from + (to - from) * 0.5)]);
        self.frame(vec![Event::PointerMoved(to)]);
        self.frame(vec![pressed(to, false)]);
    }

    fn shown(&self) -> &crate::worker::Drawn {
        &self.app.shown.as_ref().expect("a picture").drawn
    }
}

fn still() -> Content {
    Content::new("still", Source::Scene(Box::new(scene(0.0))), 1)
}

fn with_cameras() -> Content {
    let named = |name: &str, x, held_out| NamedCamera {
        name: name.into(),
        camera: camera(x),
        time: None,
        held_out,
    };
    Content {
        cameras: vec![named("left", -1.0, false), named("right", 1.0, true)],
        ..Content::new("frames", Source::Frames(Box::new(Frames)), 5)
    }
}

/// What the window shows is what the scene renders, in 8 bits.
#[test]
fn the_picture_is_the_scenes() {
    let mut bench = Bench::new(still());
    bench.rest();
    let drawn = bench.shown();
    let picture = scene(0.0)
        .render(&drawn.request.camera, 0.0)
        .expect("renders");
    let picture = dash_model::Picture::of(picture).expect("copied");
    assert_eq!(rgb(drawn), dash_model::rgb8(&picture.rgb));
    assert!(rgb(drawn).iter().any(|&v| v > 100));
}

/// Nothing is drawn where nothing has changed.
#[test]
fn a_scene_at_rest_costs_nothing() {
    let mut bench = Bench::new(still());
    bench.rest();
    let asked = bench.app.asked.take().expect("it was drawn");
    bench.app.asked = Some(asked.clone());
    for _ in 0..20 {
        bench.frame(Vec::new());
        assert_eq!(bench.app.asked.as_ref(), Some(&asked));
    }
}

#[test]
fn drags_move_the_eye_and_rest_sharpens_the_picture() {
    let mut bench = Bench::new(still());
    bench.rest();
    let sharp = bench.shown().picture.size();
    let before = bench.app.eye.clone();
    let middle = pos2(250.0, 250.0);
    for button in [PointerButton::Primary, PointerButton::Secondary] {
        bench.drag(middle, middle + vec2(60.0, 20.0), button);
        assert_ne!(bench.app.eye, before);
        bench.rest();
        assert_eq!(bench.shown().picture.size(), sharp);
        bench.press(Key::R);
        assert_eq!(bench.app.eye, before);
    }
    bench.frame(vec![Event::MouseWheel {
        unit: eframe::egui::MouseWheelUnit::Point,
        delta: vec2(0.0, 60.0),
        phase: eframe::egui::TouchPhase::Move,
        source: eframe::egui::MouseWheelSource::Unknown,
        modifiers: Modifiers::NONE,
    }]);
    for _ in 0..10 {
        bench.frame(Vec::new());
    }
    let nearer = |app: &App| glam::DVec3::from(app.eye.camera(9, 9).position()).length();
    let mut home = before.clone();
    home.reset();
    let far = glam::DVec3::from(home.camera(9, 9).position()).length();
    assert!(nearer(&bench.app) < far);
}

#[test]
fn layers_and_backgrounds_have_keys() {
    let mut bench = Bench::new(still());
    for (key, layer) in [
        Key::Num1,
        Key::Num2,
        Key::Num3,
        Key::Num4,
        Key::Num5,
        Key::Num6,
        Key::Num7,
    ]
    .into_iter()
    .zip(ViewLayer::ALL)
    {
        bench.press(key);
        bench.rest();
        assert_eq!(bench.shown().request.layer, layer);
        assert!(bench.app.message.is_none(), "{layer}");
        let is_blank = rgb(bench.shown()).iter().all(|&v| v == 0);
        assert_eq!(is_blank, layer == ViewLayer::Dynamic, "{layer}");
    }
    bench.press(Key::Num3);
    bench.press(Key::B);
    bench.press(Key::B);
    bench.rest();
    assert!(rgb(bench.shown()).iter().all(|&v| v == 255));
}

#[test]
fn time_plays_stops_and_steps() {
    let mut bench = Bench::new(with_cameras());
    assert!(bench.app.playback.playing);
    let before = bench.app.playback.time();
    bench.frame(Vec::new());
    assert!(bench.app.playback.time() > before);
    bench.press(Key::Space);
    assert!(!bench.app.playback.playing);
    bench.press(Key::Home);
    for frame in 1..4 {
        bench.press(Key::ArrowRight);
        bench.rest();
        assert_eq!(bench.shown().request.frame, frame);
    }
    // A frame that can't be read is told, and the last picture stays.
    bench.press(Key::ArrowRight);
    bench.rest();
    let message = bench.app.message.as_ref().expect("an error");
    assert!(message.is_error && message.text.contains("frame 4 is damaged"));
    assert_eq!(bench.shown().request.frame, 3);
    bench.press(Key::ArrowLeft);
    bench.rest();
    assert!(bench.app.message.is_none());
}

#[test]
fn the_captured_picture_stands_beside() {
    let mut bench = Bench::new(with_cameras());
    bench.press(Key::Space);
    bench.press(Key::Home);
    // The held-out camera is looked through first.
    assert_eq!(bench.app.through, Some(1));
    bench.press(Key::M);
    assert_eq!(bench.app.captured, CapturedView::Beside);
    bench.rest();
    assert!(bench.shown().beside.is_none());
    bench.press(Key::CloseBracket);
    bench.rest();
    assert_eq!(bench.app.through, Some(0));
    let drawn = bench.shown();
    assert_eq!(drawn.request.camera, camera(-1.0));
    let beside = drawn.beside.as_ref().expect("a captured picture");
    // The captured picture is black: the difference is the drawn one.
    assert_eq!(beside.difference.rgb(), rgb(drawn));
    assert!(beside.psnr > 5.0 && beside.psnr < 60.0);
    let asked: Vec<String> = bench.asked.try_iter().collect();
    assert!(asked.contains(&"captured 0 at 0".to_string()), "{asked:?}");
    for view in [
        CapturedView::Slider,
        CapturedView::Difference,
        CapturedView::Hidden,
    ] {
        bench.press(Key::M);
        bench.rest();
        assert_eq!(bench.app.captured, view);
    }
    // Who moves looks through no camera any longer.
    bench.press(Key::W);
    assert_eq!(bench.app.through, None);
}

#[test]
fn pictures_and_paths_are_written_by_the_host() {
    let mut bench = Bench::new(still());
    bench.rest();
    bench.press_shift(Key::P);
    assert!(
        bench.app.message.as_ref().is_some_and(|m| m.is_error),
        "no keyframes yet"
    );
    bench.press(Key::K);
    bench.press(Key::D);
    bench.press(Key::K);
    // As fast as within one frame, Shift let go again.
    let key = |modifiers| Event::Key {
        key: Key::P,
        physical_key: None,
        pressed: true,
        repeat: false,
        modifiers,
    };
    bench.frame(vec![
        key(Modifiers::SHIFT),
        Event::ModifiersChanged(Modifiers::NONE),
    ]);
    bench.press_shift(Key::V);
    bench.press(Key::P);
    bench.rest();
    let asked: Vec<String> = bench.asked.try_iter().collect();
    assert_eq!(
        asked[..2],
        ["path of 61".to_string(), "video of 61".to_string()]
    );
    assert!(asked[2].starts_with("picture "), "{asked:?}");
    assert_eq!(
        bench.app.message.as_ref().map(|m| m.text.as_str()),
        Some("written: a.png")
    );
    bench.press_shift(Key::K);
    assert!(bench.app.keyframes.is_empty());
}

#[test]
fn another_file_takes_the_contents_place() {
    let mut bench = Bench::new(with_cameras());
    bench.app.ask(crate::worker::Task::Open("b.ply".into()));
    bench.rest();
    bench.rest();
    let opened = bench.app.opened.as_ref().expect("a content");
    assert_eq!(
        (opened.name.as_str(), opened.n_frames, opened.cameras.len()),
        ("b.ply", 1, 0)
    );
    assert_eq!(opened.counts, (3, 0));
    assert_eq!(bench.shown().request.frame, 0);
    bench.press(Key::CloseBracket);
    assert!(
        bench
            .app
            .message
            .as_ref()
            .is_some_and(|m| m.text.contains("no cameras"))
    );
}

#[test]
fn a_program_without_a_display_has_no_window() {
    let with = |set: &'static str, value: &'static str| {
        super::has_display(move |name| (name == set).then(|| value.into()))
    };
    assert!(with("DISPLAY", ":0") && with("WAYLAND_DISPLAY", "wayland-0"));
    assert!(!with("DISPLAY", "") && !with("HOME", "/root"));
}

/// A window on a run shows its newest scene, and closes when the run says so.
#[test]
fn a_scene_that_trains_is_drawn_anew_with_each_copy() {
    let live = Live::new();
    let source = Source::Live(live.clone(), Device::flex());
    let mut bench = Bench::unopened(Content::new("run", source, 3));
    bench.frame(Vec::new());
    assert!(bench.app.opened.is_none() && live.is_wanted());
    let mut pictures = Vec::new();
    for x in [0.0, 0.6] {
        live.show(&scene(x)).expect("copied");
        live.tell(format!("at {x}"));
        assert!(!live.is_wanted());
        while !live.is_wanted() || bench.app.shown.is_none() {
            bench.reply();
        }
        bench.rest();
        let drawn = bench.shown();
        assert_eq!(drawn.counts, (3, 0));
        let picture = scene(x).render(&drawn.request.camera, 0.0);
        let picture = dash_model::Picture::of(picture.expect("renders")).expect("copied");
        assert_eq!(rgb(drawn), dash_model::rgb8(&picture.rgb));
        assert_eq!(bench.app.line(), Some(format!("at {x}")));
        pictures.push(rgb(drawn));
    }
    assert_ne!(pictures[0], pictures[1]);
    live.close();
    let ctx = bench.ctx.clone();
    let output = ctx.run_ui(RawInput::default(), |ui| layout::show(ui, &mut bench.app));
    let mut viewports = output.viewport_output.values();
    assert!(viewports.any(|viewport| viewport.commands.contains(&ViewportCommand::Close)));
    live.closed();
    assert!(!live.is_wanted());
}
