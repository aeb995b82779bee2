//! The player of a web page: what JavaScript calls.
//!
//! A page's parts (see [`crate::page`]) come one after the other; each adds Gaussians. Those of a window of time are asked for
//! when the clip comes near it. Nothing here waits for the device: a
//! picture is asked for, and its bytes arrive later.

use burn::tensor::Device;
use dash_kernels::Camera;
use dash_model::{DynamicScene, ModelError};
use glam::DVec3;
use js_sys::{Promise, Uint8ClampedArray};
use wasm_bindgen::prelude::*;
use wasm_bindgen_futures::future_to_promise;

use crate::draw::{Faded, ViewLayer, show_faded};
use crate::navigator::Navigator;
use crate::pace::Pace;
use crate::page::{About, Arrived, PartName, joined};
use crate::playback::Playback;
use crate::speed::SpeedColors;

/// A scene, an eye and a clip.
#[wasm_bindgen]
pub struct Player {
    device: Device,
    about: About,
    arrived: Arrived,
    /// Parts of the scene that is to come.
    next: Option<DynamicScene>,
    eye: Navigator,
    clip: Playback,
    layer: ViewLayer,
    background: Option<[f32; 3]>,
    pace: Pace,
}

fn told(error: impl std::fmt::Display) -> JsError {
    JsError::new(&error.to_string())
}

#[wasm_bindgen]
impl Player {
    /// Takes the browser's GPU for the scene that `about` (JSON) describes.
    ///
    /// # Errors
    /// When there is no GPU, or `about` is none of this player's.
    pub async fn start(about: &str) -> Result<Player, JsError> {
        std::panic::set_hook(Box::new(|panic| {
            web_sys::console::error_1(&panic.to_string().into());
        }));
        let about = About::read(about).map_err(told)?;
        let device = Device::wgpu_options().init_async().await.map_err(told)?;
        let focus = DVec3::from(about.focus);
        let mut eye = Navigator::new(focus, 2.0 * about.radius);
        if let Some(first) = about.cameras.first() {
            eye.look_through(&first.camera(), focus);
        }
        eye.set_home();
        Ok(Self {
            device,
            arrived: Arrived::default(),
            next: None,
            eye,
            clip: Playback::new(about.n_frames, about.frame_rate),
            layer: ViewLayer::Full,
            background: None,
            pace: Pace::default(),
            about,
        })
    }

    /// Adds the part that was wanted: its name, its description (JSON) and its tensors.
    ///
    /// # Errors
    /// When the part is damaged, or does not fit the device.
    pub fn add(&mut self, name: &str, description: &[u8], tensors: &[u8]) -> Result<(), JsError> {
        let PartName { owner, .. } = name.parse().map_err(|e: String| JsError::new(&e))?;
        let part = DynamicScene::from_bytes(description, tensors, &self.device).map_err(told)?;
        self.arrived.add(owner, part);
        Ok(())
    }

    /// The part that the present picture needs next, or the window behind it; the names of its files begin with it. Windows
    /// that are farthest are dropped where there are many.
    pub fn wanted(&mut self) -> Option<String> {
        let present = self.windows();
        self.arrived.tidy(&self.about, &present);
        let wanted = self.arrived.wanted(&self.about, &present);
        wanted.map(|name| name.to_string())
    }

    /// Whether something of all windows that the present picture needs is here.
    pub fn ready(&self) -> bool {
        self.windows()
            .iter()
            .all(|&window| self.arrived.has(window))
    }

    /// Adds a part to the scene that [`Player::change`] shows.
    ///
    /// # Errors
    /// As [`Player::add`].
    pub fn add_to_next(&mut self, description: &[u8], tensors: &[u8]) -> Result<(), JsError> {
        let part = DynamicScene::from_bytes(description, tensors, &self.device).map_err(told)?;
        self.next = Some(match self.next.take() {
            None => part,
            Some(scene) => joined(scene, part),
        });
        Ok(())
    }

    /// Shows the next scene.
    pub fn change(&mut self) {
        if let Some(next) = self.next.take() {
            self.arrived.replace(next);
        }
    }

    /// The windows of the present picture, and their shares.
    fn present(&self) -> Vec<(usize, f32)> {
        self.about.times.shares(self.clip.time())
    }

    fn windows(&self) -> Vec<usize> {
        self.present().iter().map(|(window, _)| *window).collect()
    }

    /// Draws the present scene; a promise of its pixels, RGBA, rows first.
    ///
    /// # Errors
    /// When nothing is there yet, or a kernel refuses its input.
    pub fn draw(&mut self, width: usize, height: usize) -> Result<Promise, JsError> {
        let camera = self.eye.camera(width.max(1), height.max(1));
        self.draw_from(&camera)
    }

    /// Draws from a camera of the page, at its own size.
    ///
    /// # Errors
    /// As [`Player::draw`], and when there is no such camera.
    pub fn draw_camera(&mut self, index: usize) -> Result<Promise, JsError> {
        let camera = self.about.cameras.get(index);
        let camera = camera.ok_or_else(|| JsError::new("the page has no such camera"))?;
        self.draw_from(&camera.camera())
    }

    fn draw_from(&mut self, camera: &Camera) -> Result<Promise, JsError> {
        let (present, time) = (self.present(), self.clip.time());
        let (arrived, about) = (&mut self.arrived, &self.about);
        let times = &about.times;
        let part = |(window, share): (usize, f32)| {
            let mut scene = arrived.scene(about, window)?;
            let own = scene.settings.background;
            scene.settings.background = self.background.unwrap_or(own);
            Some(Faded {
                scene,
                time: times.local(window, time),
                duration: times.duration(window),
                share,
            })
        };
        let parts: Option<Vec<Faded>> = present.into_iter().map(part).collect();
        let parts = parts.ok_or_else(|| JsError::new("nothing of the scene is here yet"))?;
        let colors = SpeedColors::new(self.about.fastest, self.about.n_frames);
        let shown = show_faded(&parts, camera, self.layer, &colors).map_err(told)?;
        Ok(future_to_promise(async move {
            let rgba = shown.rgba().await.map_err(|e: ModelError| told(e))?;
            Ok(Uint8ClampedArray::from(rgba.as_slice()).into())
        }))
    }

    /// Width and height of the next picture.
    pub fn size(&self, width: usize, height: usize, moving: bool) -> Vec<usize> {
        self.pace.size([width, height], moving).to_vec()
    }

    /// Takes in how long a picture of `width` x `height` took.
    pub fn saw(
        &mut self,
        width: usize,
        height: usize,
        full_width: usize,
        full_height: usize,
        secs: f64,
    ) {
        self.pace
            .saw([width, height], [full_width, full_height], secs);
    }

    /// Rotates the scene, radians.
    pub fn orbit(&mut self, yaw: f64, pitch: f64) {
        self.eye.orbit(yaw, pitch);
    }

    /// Looks around, radians.
    pub fn turn(&mut self, yaw: f64, pitch: f64) {
        self.eye.turn(yaw, pitch);
    }

    /// Moves the scene, in heights of the picture.
    pub fn pan(&mut self, right: f64, down: f64) {
        self.eye.pan(right, down);
    }

    /// Changes the distance by a factor.
    pub fn zoom(&mut self, factor: f64) {
        self.eye.zoom(factor);
    }

    /// Moves the eye, in distances to the point that it looks at.
    pub fn fly(&mut self, right: f64, down: f64, forward: f64) {
        self.eye.fly(right, down, forward);
    }

    /// The eye returns to where it began.
    pub fn reset(&mut self) {
        self.eye.reset();
    }

    /// Looks through a camera of the page.
    pub fn look_through(&mut self, index: usize) {
        if let Some(camera) = self.about.cameras.get(index) {
            let focus = DVec3::from(self.about.focus);
            self.eye.look_through(&camera.camera(), focus);
        }
    }

    /// Names of the page's cameras.
    pub fn cameras(&self) -> Vec<String> {
        let names = self.about.cameras.iter().map(|camera| camera.name.clone());
        names.collect()
    }

    /// Width and height of a camera's pictures; the page's first where there is none.
    pub fn camera_size(&self, index: usize) -> Vec<usize> {
        let camera = self.about.cameras.get(index);
        camera.map_or(vec![4, 3], |camera| vec![camera.width, camera.height])
    }

    /// Plays on by so many seconds.
    pub fn advance(&mut self, secs: f64) {
        self.clip.advance(secs);
    }

    /// Plays or stops.
    pub fn toggle(&mut self) {
        self.clip.toggle();
    }

    /// Goes to a time in [0, 1].
    pub fn seek(&mut self, time: f64) {
        self.clip.seek(time);
    }

    /// Stops, and goes on by frames.
    pub fn step(&mut self, frames: i32) {
        self.clip.step(i64::from(frames));
    }

    /// The time in [0, 1].
    #[wasm_bindgen(getter)]
    pub fn time(&self) -> f32 {
        self.clip.time()
    }

    /// The nearest frame.
    #[wasm_bindgen(getter)]
    pub fn frame(&self) -> usize {
        self.clip.frame()
    }

    /// Frames of the clip.
    #[wasm_bindgen(getter)]
    pub fn n_frames(&self) -> usize {
        self.clip.n_frames()
    }

    /// Whether it plays.
    #[wasm_bindgen(getter)]
    pub fn playing(&self) -> bool {
        self.clip.playing
    }

    /// Plays, or stops.
    #[wasm_bindgen(setter)]
    pub fn set_playing(&mut self, playing: bool) {
        if playing != self.clip.playing {
            self.clip.toggle();
        }
    }

    /// Whether the clip begins again at its end.
    #[wasm_bindgen(getter)]
    pub fn looping(&self) -> bool {
        self.clip.looping
    }

    /// Whether the clip begins again at its end.
    #[wasm_bindgen(setter)]
    pub fn set_looping(&mut self, looping: bool) {
        self.clip.looping = looping;
    }

    /// How fast it plays; 1 is as captured.
    #[wasm_bindgen(getter)]
    pub fn speed(&self) -> f64 {
        self.clip.speed
    }

    /// How fast it plays; 1 is as captured.
    #[wasm_bindgen(setter)]
    pub fn set_speed(&mut self, speed: f64) {
        if speed > 0.0 && speed.is_finite() {
            self.clip.speed = speed;
        }
    }

    /// The layer's name.
    #[wasm_bindgen(getter)]
    pub fn layer(&self) -> String {
        self.layer.to_string()
    }

    /// Shows another layer; unknown names change nothing.
    #[wasm_bindgen(setter)]
    pub fn set_layer(&mut self, name: &str) {
        let named = |layer: &ViewLayer| layer.to_string() == name;
        if let Some(layer) = ViewLayer::ALL.into_iter().find(named) {
            self.layer = layer;
        }
    }

    /// A colour behind everything, sRGB in [0, 1].
    pub fn set_background(&mut self, red: f32, green: f32, blue: f32) {
        self.background = Some([red, green, blue]);
    }

    /// Static and dynamic Gaussians of the present picture that are here.
    pub fn counts(&mut self) -> Vec<usize> {
        let (windows, arrived) = (self.windows(), &mut self.arrived);
        let here = windows
            .iter()
            .filter_map(|&window| arrived.scene(&self.about, window));
        let counts = here.map(|scene| scene.counts());
        let (n_static, n_dynamic) = counts.fold((0, 0), |sum, n| (sum.0 + n.0, sum.1 + n.1));
        vec![n_static, n_dynamic]
    }
}
