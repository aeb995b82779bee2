//! What the thread does.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::Sender;
use std::sync::{Arc, PoisonError};
use std::time::Instant;

use burn::module::Module;
use dash_model::{DynamicScene, TimeWindows};

use super::{Beside, Drawn, DrawnPicture, Opened, Reply, Request, Shared, Task};
use crate::content::{Host, NamedCamera, Source};
use crate::draw::{Faded, Shown, ViewLayer, show, show_faded};
use crate::middle::middle_of;
use crate::speed::SpeedColors;
use crate::tracks::Tracks;
use crate::{FrameSource, Screen, ViewError, WindowSource};

/// A content without its source.
pub(super) struct Described {
    pub name: String,
    pub frame_rate: f64,
    pub cameras: Vec<NamedCamera>,
    pub focus: Option<[f64; 3]>,
}

/// What the thread works with.
pub(super) struct Studio {
    pub source: Source,
    pub n_frames: usize,
    /// The scene of the last frame of a source of frames, or of the last window; the last copy of a scene that trains.
    pub shown: Option<(usize, DynamicScene)>,
    /// What is to be described once there is a scene.
    pub content: Option<Described>,
    pub tracks: Option<Option<Arc<Tracks>>>,
    /// The fastest speed of windows, once it is asked for.
    pub fastest: Option<f32>,
    pub host: Box<dyn Host>,
    /// The GPU that shows what is drawn, where that is one that Burn shares.
    pub screen: Option<Screen>,
    pub replies: Sender<Reply>,
    pub wake: Box<dyn Fn() + Send>,
}

impl Studio {
    pub fn run(mut self, content: Described, shared: &Shared) {
        match self.source {
            Source::Live(..) => self.content = Some(content),
            Source::Scene(_) | Source::Frames(_) | Source::Windows(_) => {
                self.attempt(|studio| studio.describe(content));
            }
        }
        loop {
            let mut wanted = shared.wanted();
            while !wanted.over && wanted.picture.is_none() && wanted.tasks.is_empty() {
                wanted.is_idle = true;
                shared.idled.notify_all();
                wanted = shared
                    .changed
                    .wait(wanted)
                    .unwrap_or_else(PoisonError::into_inner);
            }
            wanted.is_idle = false;
            if wanted.over {
                return;
            }
            let (picture, task) = (wanted.picture.take(), wanted.tasks.pop_front());
            drop(wanted);
            if let Some(task) = task {
                self.attempt(|studio| studio.carry_out(task));
            }
            if let Some(request) = picture {
                self.attempt(|studio| studio.draw(request).map(|drawn| Reply::Drawn(drawn.into())));
            }
        }
    }

    /// Replies with what `work` makes, with why it failed, or with what it panicked with.
    fn attempt(&mut self, work: impl FnOnce(&mut Self) -> Result<Reply, ViewError>) {
        let reply = match catch_unwind(AssertUnwindSafe(|| work(self))) {
            Ok(Ok(reply)) => reply,
            Ok(Err(error)) => Reply::Failed(error.to_string()),
            Err(panic) => Reply::Failed(told(&*panic)),
        };
        // Nobody listens once the window is closed.
        let _ = self.replies.send(reply);
        (self.wake)();
    }

    fn describe(&mut self, content: Described) -> Result<Reply, ViewError> {
        let n_frames = self.n_frames;
        let scene = self.scene(0)?;
        let (middle, radius) = middle_of(scene)?;
        Ok(Reply::Opened(Box::new(Opened {
            name: content.name,
            n_frames,
            frame_rate: content.frame_rate,
            cameras: content.cameras,
            focus: content.focus.unwrap_or(middle),
            radius,
            counts: scene.counts(),
            bytes: scene.num_params() * size_of::<f32>(),
        })))
    }

    fn carry_out(&mut self, task: Task) -> Result<Reply, ViewError> {
        match task {
            Task::Open(path) => {
                let content = self.host.open(&path)?;
                (self.source, self.n_frames) = (content.source, content.n_frames);
                (self.shown, self.tracks, self.fastest) = (None, None, None);
                self.describe(Described {
                    name: content.name,
                    frame_rate: content.frame_rate,
                    cameras: content.cameras,
                    focus: content.focus,
                })
            }
            Task::Begin => {
                let content = self.content.take();
                let none = || ViewError::Host("it is open already".into());
                self.describe(content.ok_or_else(none)?)
            }
            Task::Track => Ok(Reply::Tracks(self.tracks()?)),
            Task::SavePicture(request) => {
                let frame = self.show(&request)?.frame()?;
                Ok(Reply::Saved(self.host.save_picture(&frame)?))
            }
            Task::SavePath(path) => Ok(Reply::Saved(self.host.save_path(&path)?)),
            Task::RenderPath(path) => match &self.source {
                Source::Scene(scene) => Ok(Reply::Saved(self.host.render_path(scene, &path)?)),
                Source::Live(..) => {
                    let (_, scene) = self.shown.as_ref().ok_or_else(nothing_yet)?;
                    Ok(Reply::Saved(self.host.render_path(scene, &path)?))
                }
                Source::Frames(_) | Source::Windows(_) => Err(ViewError::Host(
                    "a path is rendered of one scene, not of windows of time nor of a file for each frame; save it, and \
                     give the file to `dash render`"
                        .into(),
                )),
            },
        }
    }

    fn draw(&mut self, request: Request) -> Result<Drawn, ViewError> {
        let start = Instant::now();
        let shown = self.show(&request)?;
        // What stands beside a captured picture is compared with it on the host.
        let texture = match (&self.screen, request.beside) {
            (Some(screen), None) => screen.texture(&shown)?,
            _ => None,
        };
        let picture = match texture {
            Some(texture) => DrawnPicture::Texture(texture),
            None => DrawnPicture::Host(shown.frame()?),
        };
        let secs = start.elapsed().as_secs_f64();
        let captured = match request.beside {
            Some(camera) => self.host.captured(camera, request.time)?,
            None => None,
        };
        let beside = match (&picture, captured) {
            // Of another size it is of another camera.
            (DrawnPicture::Host(frame), Some(rgb))
                if rgb.len() == 3 * frame.width * frame.height =>
            {
                Some(Beside::of(frame, &rgb))
            }
            _ => None,
        };
        Ok(Drawn {
            counts: self.scene(request.frame)?.counts(),
            request,
            picture,
            secs,
            beside,
        })
    }

    /// A picture that is on its way.
    fn show(&mut self, request: &Request) -> Result<Shown, ViewError> {
        // Of a scene that trains, tracks are of the newest copy.
        self.scene(request.frame)?;
        let colors = match request.layer {
            ViewLayer::Speed => SpeedColors::new(self.fastest()?, self.n_frames),
            _ => SpeedColors::new(0.0, 1),
        };
        if let Source::Windows(windows) = &self.source {
            let parts = parts(&**windows, request)?;
            return Ok(show_faded(&parts, &request.camera, request.layer, &colors)?);
        }
        let scene = self.scene(request.frame)?;
        let own = scene.settings.background;
        scene.settings.background = request.background.unwrap_or(own);
        let shown = show(scene, &request.camera, request.time, request.layer, &colors);
        scene.settings.background = own;
        Ok(shown?)
    }

    /// The scene at a frame.
    fn scene(&mut self, frame: usize) -> Result<&mut DynamicScene, ViewError> {
        let frames: &mut Box<dyn FrameSource> = match &mut self.source {
            Source::Scene(scene) => return Ok(scene),
            Source::Frames(frames) => frames,
            Source::Windows(windows) => {
                let last = self.n_frames.saturating_sub(1).max(1);
                let window = main_window(windows.times(), frame as f32 / last as f32);
                let known = self.shown.take().filter(|(known, _)| *known == window);
                let shown = match known {
                    Some(shown) => shown,
                    None => (window, windows.scene(window)?),
                };
                return Ok(&mut self.shown.insert(shown).1);
            }
            Source::Live(live, device) => {
                if let Some([json, tensors]) = live.take() {
                    let scene = DynamicScene::from_bytes(&json, &tensors, device)?;
                    (self.shown, self.tracks) = (Some((0, scene)), None);
                }
                let (_, scene) = self.shown.as_mut().ok_or_else(nothing_yet)?;
                return Ok(scene);
            }
        };
        let known = self.shown.take().filter(|(known, _)| *known == frame);
        let shown = match known {
            Some(shown) => shown,
            None => (frame, frames.scene(frame)?),
        };
        Ok(&mut self.shown.insert(shown).1)
    }

    /// The speed that is shown as the fastest, world units over the clip; that of windows is one of the first shown.
    fn fastest(&mut self) -> Result<f32, ViewError> {
        let Source::Windows(windows) = &self.source else {
            return Ok(self.tracks()?.map_or(0.0, |tracks| tracks.fastest));
        };
        if let Some(fastest) = self.fastest {
            return Ok(fastest);
        }
        let Some((window, scene)) = &self.shown else {
            return Ok(0.0);
        };
        let duration = windows.times().duration(*window);
        let tracks = Tracks::of(scene, (duration * self.n_frames as f32) as usize)?;
        let fastest = tracks.map_or(0.0, |tracks| tracks.fastest / duration);
        Ok(*self.fastest.insert(fastest))
    }

    fn tracks(&mut self) -> Result<Option<Arc<Tracks>>, ViewError> {
        if let Some(tracks) = &self.tracks {
            return Ok(tracks.clone());
        }
        let scene = match &self.source {
            Source::Scene(scene) => Some(&**scene),
            Source::Live(..) => self.shown.as_ref().map(|(_, scene)| scene),
            Source::Frames(_) | Source::Windows(_) => None,
        };
        let tracks = match scene {
            Some(scene) => Tracks::of(scene, self.n_frames)?.map(Arc::new),
            None => None,
        };
        Ok(self.tracks.insert(tracks).clone())
    }
}

/// The scenes that a picture of windows shows.
fn parts(windows: &dyn WindowSource, request: &Request) -> Result<Vec<Faded>, ViewError> {
    let shares = windows.times().shares(request.time).into_iter();
    shares
        .map(|(window, share)| {
            let mut scene = windows.scene(window)?;
            let own = scene.settings.background;
            scene.settings.background = request.background.unwrap_or(own);
            let times = windows.times();
            Ok(Faded {
                scene,
                time: times.local(window, request.time),
                duration: times.duration(window),
                share,
            })
        })
        .collect()
}

/// The window that has the largest share at a time.
fn main_window(times: &TimeWindows, time: f32) -> usize {
    let shares = times.shares(time).into_iter();
    let largest = shares.max_by(|a, b| a.1.total_cmp(&b.1));
    largest.map_or(0, |(window, _)| window)
}

fn nothing_yet() -> ViewError {
    ViewError::Host("the run has no scene yet".into())
}

/// What a panic says.
fn told(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or(panic.downcast_ref::<&str>().copied());
    text.unwrap_or("drawing failed").to_string()
}
