//! The thread that draws.
//!
//! Requests for pictures replace each other: only the newest is drawn. Other work is done in order.

mod studio;

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use dash_kernels::Camera;
use eframe::wgpu;

pub use crate::beside::Beside;
use crate::camera_path::PathCamera;
use crate::content::{Content, Host, NamedCamera, Source};
use crate::draw::{Frame, ViewLayer};
use crate::tracks::Tracks;
use crate::{Live, Screen, ViewError};
use studio::{Described, Studio};

/// A picture that is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// The eye, at the picture's size.
    pub camera: Camera,
    /// In [0, 1] over the clip.
    pub time: f32,
    /// The frame nearest to that time.
    pub frame: usize,
    /// The copy of a scene that trains, 0 of one that does not.
    pub version: usize,
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
    /// Opens the scene that trains, once there is a first copy.
    Begin,
    /// Opens a file or a folder in place of the content.
    Open(PathBuf),
    /// Follows the dynamic Gaussians over the clip.
    Track,
    /// Draws a picture once more and saves it.
    SavePicture(Box<Request>),
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
    pub picture: DrawnPicture,
    /// How long it took.
    pub secs: f64,
    /// The captured picture, where one was asked for and is there.
    pub beside: Option<Beside>,
    /// Static and dynamic Gaussians.
    pub counts: (usize, usize),
}

/// Where a drawn picture is.
#[derive(Debug, Clone)]
pub enum DrawnPicture {
    /// In host memory.
    Host(Frame),
    /// On the GPU that shows it.
    Texture(wgpu::Texture),
}

impl DrawnPicture {
    /// Width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        match self {
            Self::Host(frame) => [frame.width, frame.height],
            Self::Texture(texture) => [texture.width() as usize, texture.height() as usize],
        }
    }
}

/// The thread; it ends when this is dropped.
pub struct Worker {
    shared: Arc<Shared>,
    replies: Receiver<Reply>,
    live: Option<Arc<Live>>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    wanted: Mutex<Wanted>,
    changed: Condvar,
    idled: Condvar,
}

#[derive(Default)]
struct Wanted {
    picture: Option<Request>,
    tasks: VecDeque<Task>,
    over: bool,
    /// Whether the thread waits for work.
    is_idle: bool,
}

impl Shared {
    fn wanted(&self) -> MutexGuard<'_, Wanted> {
        self.wanted.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Worker {
    /// Starts the thread; `wake` is called after each reply. Pictures stay on `screen` where the scene is there, unless a
    /// captured one stands beside.
    ///
    /// # Errors
    /// When the system can't start a thread.
    pub fn start(
        content: Content,
        host: Box<dyn Host>,
        screen: Option<Screen>,
        wake: impl Fn() + Send + 'static,
    ) -> Result<Self, ViewError> {
        let shared = Arc::new(Shared::default());
        let (sender, replies) = channel();
        let live = match &content.source {
            Source::Live(live, _) => Some(live.clone()),
            Source::Scene(_) | Source::Frames(_) | Source::Windows(_) => None,
        };
        let studio = Studio {
            source: content.source,
            n_frames: content.n_frames,
            shown: None,
            content: None,
            tracks: None,
            fastest: None,
            host,
            screen,
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
            live,
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

    /// The scene that trains meanwhile, where it is one.
    pub fn live(&self) -> Option<&Arc<Live>> {
        self.live.as_ref()
    }

    /// Waits until all that was asked for is done.
    #[cfg(test)]
    pub(crate) fn wait_until_idle(&self) {
        let wanted = self.shared.wanted();
        let works = |w: &mut Wanted| !w.is_idle || w.picture.is_some() || !w.tasks.is_empty();
        let idle = self.shared.idled.wait_while(wanted, works);
        drop(idle.unwrap_or_else(PoisonError::into_inner));
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
