//! The thread that draws.
//!
//! Requests for pictures replace each other: only the newest is drawn. Other work is done in order.

use std::any::Any;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use burn::module::Module;
use dash_kernels::Camera;
use dash_model::DynamicScene;

pub use crate::beside::Beside;
use crate::camera_path::PathCamera;
use crate::content::{Content, Host, NamedCamera, Source};
use crate::draw::{Frame, ViewLayer, draw};
use crate::middle::middle_of;
use crate::speed::SpeedColors;
use crate::tracks::Tracks;
use crate::{FrameSource, ViewError};

/// A picture that is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// The eye, at the picture's size.
    pub camera: Camera,
    /// In [0, 1] over the clip.
    pub time: f32,
    /// The frame nearest to that time.
    pub frame: usize,
    /// What it shows.
    pub layer: ViewLayer,
    /// Colour behind everything; the scene's own where `None`.
    pub background: Option<[f32; 3]>,
    /// The camera of the content whose captured picture stands beside.
    pub beside: Option<usize>,
}

/// Other work.
#[derive(Debug)]
pub enum Task {
    /// Opens a file or a folder in place of the content.
    Open(PathBuf),
    /// Follows the dynamic Gaussians over the clip.
    Track,
    /// Saves a picture.
    SavePicture(Box<Frame>),
    /// Saves a path of cameras.
    SavePath(Vec<PathCamera>),
    /// Renders a path of cameras as a video.
    RenderPath(Vec<PathCamera>),
}

/// What the thread has done.
pub enum Reply {
    /// The content is another, or the first.
    Opened(Box<Opened>),
    /// A picture.
    Drawn(Box<Drawn>),
    /// The way of the dynamic Gaussians; `None` where nothing is dynamic.
    Tracks(Option<Arc<Tracks>>),
    /// Something was written.
    Saved(PathBuf),
    /// Something failed.
    Failed(String),
}

/// What is known of a content without its Gaussians.
#[derive(Debug, Clone)]
pub struct Opened {
    /// Its name.
    pub name: String,
    /// Frames of the clip.
    pub n_frames: usize,
    /// Frames per second at speed 1.
    pub frame_rate: f64,
    /// Cameras to look through.
    pub cameras: Vec<NamedCamera>,
    /// The point to orbit.
    pub focus: [f64; 3],
    /// The distance from there within which half of the Gaussians are, world units.
    pub radius: f64,
    /// Static and dynamic Gaussians.
    pub counts: (usize, usize),
    /// Values of the scene's parameters, in bytes.
    pub bytes: usize,
}

/// A picture that is drawn.
#[derive(Debug, Clone)]
pub struct Drawn {
    /// What was asked for.
    pub request: Request,
    /// The picture.
    pub frame: Frame,
    /// How long it took.
    pub secs: f64,
    /// The captured picture, where one was asked for and is there.
    pub beside: Option<Beside>,
}

/// The thread; it ends when this is dropped.
pub struct Worker {
    shared: Arc<Shared>,
    replies: Receiver<Reply>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    wanted: Mutex<Wanted>,
    changed: Condvar,
}

#[derive(Default)]
struct Wanted {
    picture: Option<Request>,
    tasks: VecDeque<Task>,
    over: bool,
}

impl Shared {
    fn wanted(&self) -> MutexGuard<'_, Wanted> {
        self.wanted.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Worker {
    /// Starts the thread; `wake` is called after each reply.
    ///
    /// # Errors
    /// When the system can't start a thread.
    pub fn start(
        content: Content,
        host: Box<dyn Host>,
        wake: impl Fn() + Send + 'static,
    ) -> Result<Self, ViewError> {
        let shared = Arc::new(Shared::default());
        let (sender, replies) = channel();
        let studio = Studio {
            source: content.source,
            n_frames: content.n_frames,
            shown: None,
            tracks: None,
            host,
            replies: sender,
            wake: Box::new(wake),
        };
        let content = Described {
            name: content.name,
            frame_rate: content.frame_rate,
            cameras: content.cameras,
            focus: content.focus,
        };
        let theirs = shared.clone();
        let thread = std::thread::Builder::new()
            .name("draw".into())
            .spawn(move || studio.run(content, &theirs))
            .map_err(|e| ViewError::Window(format!("the system cannot start a thread: {e}")))?;
        Ok(Self {
            shared,
            replies,
            thread: Some(thread),
        })
    }

    /// Asks for a picture in place of one that is not begun.
    pub fn draw(&self, request: Request) {
        self.shared.wanted().picture = Some(request);
        self.shared.changed.notify_one();
    }

    /// Asks for other work.
    pub fn ask(&self, task: Task) {
        self.shared.wanted().tasks.push_back(task);
        self.shared.changed.notify_one();
    }

    /// What was done since the last call.
    pub fn replies(&self) -> impl Iterator<Item = Reply> {
        self.replies.try_iter()
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.shared.wanted().over = true;
        self.shared.changed.notify_one();
        if let Some(thread) = self.thread.take() {
            // It reports its own panics.
            let _ = thread.join();
        }
    }
}

/// A content without its source.
struct Described {
    name: String,
    frame_rate: f64,
    cameras: Vec<NamedCamera>,
    focus: Option<[f64; 3]>,
}

/// What the thread works with.
struct Studio {
    source: Source,
    n_frames: usize,
    /// The scene of the last frame of a source of frames.
    shown: Option<(usize, DynamicScene)>,
    tracks: Option<Option<Arc<Tracks>>>,
    host: Box<dyn Host>,
    replies: Sender<Reply>,
    wake: Box<dyn Fn() + Send>,
}

impl Studio {
    fn run(mut self, content: Described, shared: &Shared) {
        self.attempt(|studio| studio.describe(content));
        loop {
            let mut wanted = shared.wanted();
            while !wanted.over && wanted.picture.is_none() && wanted.tasks.is_empty() {
                wanted = shared
                    .changed
                    .wait(wanted)
                    .unwrap_or_else(PoisonError::into_inner);
            }
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
                (self.shown, self.tracks) = (None, None);
                self.describe(Described {
                    name: content.name,
                    frame_rate: content.frame_rate,
                    cameras: content.cameras,
                    focus: content.focus,
                })
            }
            Task::Track => Ok(Reply::Tracks(self.tracks()?)),
            Task::SavePicture(frame) => Ok(Reply::Saved(self.host.save_picture(&frame)?)),
            Task::SavePath(path) => Ok(Reply::Saved(self.host.save_path(&path)?)),
            Task::RenderPath(path) => match &self.source {
                Source::Scene(scene) => Ok(Reply::Saved(self.host.render_path(scene, &path)?)),
                Source::Frames(_) => Err(ViewError::Host(
                    "a path is rendered of one scene, not of a file for each frame".into(),
                )),
            },
        }
    }

    fn draw(&mut self, request: Request) -> Result<Drawn, ViewError> {
        let start = Instant::now();
        let colors = match request.layer {
            ViewLayer::Speed => {
                let fastest = self.tracks()?.map_or(0.0, |tracks| tracks.fastest);
                SpeedColors::new(fastest, self.n_frames)
            }
            _ => SpeedColors::new(0.0, 1),
        };
        let scene = self.scene(request.frame)?;
        let own = scene.settings.background;
        scene.settings.background = request.background.unwrap_or(own);
        let frame = draw(scene, &request.camera, request.time, request.layer, &colors);
        scene.settings.background = own;
        let (frame, secs) = (frame?, start.elapsed().as_secs_f64());
        let captured = match request.beside {
            Some(camera) => self.host.captured(camera, request.time)?,
            None => None,
        };
        // Of another size it is of another camera.
        let captured = captured.filter(|rgb| rgb.len() == frame.rgb.len());
        Ok(Drawn {
            beside: captured.map(|rgb| Beside::of(&frame, rgb)),
            request,
            frame,
            secs,
        })
    }

    /// The scene at a frame.
    fn scene(&mut self, frame: usize) -> Result<&mut DynamicScene, ViewError> {
        let frames: &mut Box<dyn FrameSource> = match &mut self.source {
            Source::Scene(scene) => return Ok(scene),
            Source::Frames(frames) => frames,
        };
        let known = self.shown.take().filter(|(known, _)| *known == frame);
        let shown = match known {
            Some(shown) => shown,
            None => (frame, frames.scene(frame)?),
        };
        Ok(&mut self.shown.insert(shown).1)
    }

    fn tracks(&mut self) -> Result<Option<Arc<Tracks>>, ViewError> {
        if let Some(tracks) = &self.tracks {
            return Ok(tracks.clone());
        }
        let tracks = match &self.source {
            Source::Scene(scene) => Tracks::of(scene, self.n_frames)?.map(Arc::new),
            Source::Frames(_) => None,
        };
        Ok(self.tracks.insert(tracks).clone())
    }
}

/// What a panic says.
fn told(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or(panic.downcast_ref::<&str>().copied());
    text.unwrap_or("drawing failed").to_string()
}
