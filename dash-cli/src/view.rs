//! `dash view`: a window on a run, or on files of Gaussians.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use burn::tensor::Device;
use clap::Args;
use dash_kernels::Camera;
use dash_model::{DynamicScene, TimeWindows, rgb8};
use dash_train::cameras::{CameraEntry, focus_point, write_cameras};
use dash_train::dataset::{Dataset, Partition, View};
use dash_train::device::DeviceChoice;
use dash_train::render::{PictureLayer, RenderJob, Shot, write_video};
use dash_train::train::{DataConfig, RunFolder};
use dash_train::video::write_png;
use dash_train::windows::{WindowedClip, Windows};
use dash_train::{SplatClip, splat_scene};
use dash_view::camera_path::PathCamera;
use dash_view::draw::Frame;
use dash_view::{
    Content, FRAME_RATE, FrameSource, Host, NamedCamera, Screen, Source, ViewError, WindowSource,
    open_window,
};

use crate::Shared;
use crate::data::dataset_of;
use crate::failure::Failure;
use crate::values;

/// Frames of the time line where the dataset, which would say, is gone.
const UNKNOWN_FRAMES: usize = 101;
/// Where pictures, paths and videos go in a run's folder.
const OUT: &str = "view";

/// Look at a scene in a window: play, orbit, layers, captured pictures beside
#[derive(Args)]
#[command(after_help = "Examples:
  dash view runs/room
  dash view room_at_half.ply
  dash view out/plys --fps 15
  dash view room.4dgs

A folder of files is played, one a frame, in the order of their numbers. Press ? in the window for its keys.
Pictures, camera paths and videos that are saved go to RUN/view; of a file, to the folder that the command runs in. A saved path
is a file for dash render --cameras.")]
pub struct ViewArgs {
    /// A run's folder, that of a long clip's windows, a file of Gaussians (.ply, .spz, .splat, .glb, .4dgs), or a folder of them
    #[arg(value_name = "RUN|FILE|FOLDER")]
    scene: PathBuf,
    /// Where the run's dataset is, if it was moved
    #[arg(long, value_name = "DIR")]
    dataset: Option<PathBuf>,
    /// Frames per second [default: as recorded, where the run's videos tell; a .4dgs's own; else 30]
    #[arg(long, value_name = "N", value_parser = values::frame_rate)]
    fps: Option<f64>,
}

pub fn run(args: &ViewArgs, shared: &Shared) -> Result<String, Failure> {
    let (device, screen) = device_and_screen(shared.device.unwrap_or_default())?;
    let mut desk = Desk::new(device, args.fps);
    let content = desk.content(&args.scene, args.dataset.as_deref())?;
    let name = content.name.clone();
    open_window(content, Box::new(desk), screen)
        .map_err(|error| Failure::new(error.to_string()))?;
    Ok(format!("{name}: closed"))
}

/// The device that draws the scene, and, where wgpu serves it, the same for the window.
fn device_and_screen(choice: DeviceChoice) -> Result<(Device, Option<Screen>), Failure> {
    match choice.adapter() {
        Some(adapter) => {
            let shared = Screen::open(adapter);
            let (device, screen) = shared.map_err(|error| Failure::new(error.to_string()))?;
            Ok((device, Some(screen)))
        }
        None => Ok((choice.device()?, None)),
    }
}

/// What the window asks of datasets and files.
pub struct Desk {
    device: Device,
    /// Frames per second, where they are not what a file says.
    fps: Option<f64>,
    /// Where files are written.
    out: PathBuf,
    captured: Option<Captured>,
}

/// The captured pictures of a run's dataset.
struct Captured {
    dataset: Arc<Dataset>,
    /// The views of each camera, by their place in the dataset.
    by_camera: Vec<Vec<usize>>,
}

impl Desk {
    pub fn new(device: Device, fps: Option<f64>) -> Self {
        Self {
            device,
            fps,
            out: PathBuf::new(),
            captured: None,
        }
    }

    /// That of a run while it trains.
    pub fn of_run(run: &Path, dataset: Arc<Dataset>, device: Device) -> Self {
        Self {
            out: run.join(OUT),
            captured: Some(Captured::of(dataset)),
            ..Self::new(device, None)
        }
    }

    /// What there is to see of a run, a file or a folder of files.
    pub fn content(&mut self, path: &Path, elsewhere: Option<&Path>) -> Result<Content, Failure> {
        let are_windows = Windows::are_in(path);
        let is_run = path.join("config.toml").is_file() || are_windows;
        if !is_run && elsewhere.is_some() {
            return Err(Failure::usage(format!(
                "--dataset: expected a run to go with it, found {}; leave it out",
                path.display()
            )));
        }
        let mut content = match is_run {
            true if are_windows => self.windows(path, elsewhere)?,
            true => self.run(path, elsewhere)?,
            false => self.splats(path)?,
        };
        content.frame_rate = self.fps.unwrap_or(content.frame_rate);
        Ok(content)
    }

    fn run(&mut self, path: &Path, elsewhere: Option<&Path>) -> Result<Content, Failure> {
        let run = RunFolder::open(path)?;
        let scene = run.scene(&self.device)?;
        let n_frames = if scene.counts().1 == 0 {
            1
        } else {
            UNKNOWN_FRAMES
        };
        let content = Content::new(&name_of(path), Source::Scene(Box::new(scene)), n_frames);
        self.with_cameras(content, path, (&run.config()?.data, elsewhere))
    }

    fn windows(&mut self, path: &Path, elsewhere: Option<&Path>) -> Result<Content, Failure> {
        let clip = WindowedClip::open(path, &self.device)?;
        let (n_frames, data) = (clip.windows().n_frames, clip.windows().data.clone());
        let source = Source::Windows(Box::new(ClipWindows(clip)));
        let content = Content::new(&name_of(path), source, n_frames);
        self.with_cameras(content, path, (&data, elsewhere))
    }

    /// The content with the cameras of the data that it was trained on, where these are there.
    fn with_cameras(
        &mut self,
        content: Content,
        path: &Path,
        (data, elsewhere): (&DataConfig, Option<&Path>),
    ) -> Result<Content, Failure> {
        self.out = path.join(OUT);
        if elsewhere.is_none() && !data.dataset.is_dir() {
            tracing::warn!(
                "{}: the run's dataset is not there: no cameras and no captured pictures; if it was moved, say \
                 where it is with --dataset DIR",
                data.dataset.display()
            );
            self.captured = None;
            return Ok(content);
        }
        let captured = Captured::of(Arc::new(dataset_of(data, elsewhere, true)?));
        let cameras = named(&captured.dataset, &captured.by_camera);
        let poses: Vec<Camera> = cameras.iter().map(|c| c.camera.clone()).collect();
        let n_frames = captured.dataset.n_frames;
        let frame_rate = captured.dataset.frame_rate.unwrap_or(content.frame_rate);
        self.captured = Some(captured);
        Ok(Content {
            focus: Some(focus_point(&poses)),
            cameras,
            n_frames,
            frame_rate,
            ..content
        })
    }

    fn splats(&mut self, path: &Path) -> Result<Content, Failure> {
        let name = name_of(path);
        let content = match path.is_dir() || SplatClip::is_motions(path) {
            true => {
                let clip = SplatClip::open(path, &self.device)?;
                let (n_frames, own) = (clip.n_frames(), clip.frame_rate());
                Content {
                    frame_rate: own.unwrap_or(FRAME_RATE),
                    ..Content::new(&name, Source::Frames(Box::new(Frames(clip))), n_frames)
                }
            }
            false if values::is_splat_file(path) => {
                let scene = splat_scene(path, &self.device)?;
                Content::new(&name, Source::Scene(Box::new(scene)), 1)
            }
            false if !path.exists() => {
                return Err(Failure::new(format!(
                    "{}: expected a run, a file of Gaussians or a folder of them, found nothing; check the path",
                    path.display()
                )));
            }
            false => {
                return Err(Failure::usage(format!(
                    "{}: expected a run's folder, a file of Gaussians (.ply, .spz, .splat, .glb, .4dgs), or a folder of them",
                    path.display()
                )));
            }
        };
        (self.out, self.captured) = (PathBuf::from("."), None);
        Ok(content)
    }

    /// A name that is not taken, in the folder of what is written.
    fn free(&self, kind: &str, extension: &str) -> Result<PathBuf, ViewError> {
        std::fs::create_dir_all(&self.out).map_err(|error| {
            ViewError::Host(format!("{}: cannot create it: {error}", self.out.display()))
        })?;
        let names = (0..).map(|k| self.out.join(format!("{kind}_{k:04}.{extension}")));
        let mut free = names.filter(|path| !path.exists());
        Ok(free.next().expect("numbers do not end"))
    }
}

impl Captured {
    fn of(dataset: Arc<Dataset>) -> Self {
        let by_camera = by_camera(&dataset);
        Self { dataset, by_camera }
    }

    /// The view of a camera nearest to a time, within half a frame.
    fn view(&self, camera: usize, time: f32) -> Option<&View> {
        let half_frame = 0.5 / self.dataset.n_frames.saturating_sub(1).max(1) as f32;
        let off = |view: &View| (view.time - time).abs();
        let views = self.by_camera.get(camera)?.iter();
        let views = views.map(|&place| &self.dataset.views[place]);
        let nearest = views.min_by(|a, b| off(a).total_cmp(&off(b)))?;
        (off(nearest) <= 1.01 * half_frame).then_some(nearest)
    }
}

/// The views of each camera that has any, by their place in the dataset.
fn by_camera(dataset: &Dataset) -> Vec<Vec<usize>> {
    let mut by_camera: Vec<Vec<usize>> = Vec::new();
    for (place, view) in dataset.views.iter().enumerate() {
        if by_camera.len() <= view.camera_index {
            by_camera.resize(view.camera_index + 1, Vec::new());
        }
        by_camera[view.camera_index].push(place);
    }
    by_camera.retain(|views| !views.is_empty());
    by_camera
}

fn named(dataset: &Dataset, by_camera: &[Vec<usize>]) -> Vec<NamedCamera> {
    let named = |views: &Vec<usize>| {
        let view = &dataset.views[views[0]];
        let is_one_of_many = views.len() == 1 && dataset.n_frames > 1;
        NamedCamera {
            name: match is_one_of_many {
                true => view.name.clone(),
                false => view.camera_name.clone(),
            },
            camera: view.camera.clone(),
            time: is_one_of_many.then_some(view.time),
            held_out: view.partition == Partition::Test,
        }
    };
    by_camera.iter().map(named).collect()
}

/// The cameras of a dataset.
pub fn named_cameras(dataset: &Dataset) -> Vec<NamedCamera> {
    named(dataset, &by_camera(dataset))
}

fn name_of(path: &Path) -> String {
    let name = path.file_name().unwrap_or(path.as_os_str());
    name.to_string_lossy().into_owned()
}

/// Gaussians from files, frame by frame.
struct Frames(SplatClip);

impl FrameSource for Frames {
    fn scene(&mut self, frame: usize) -> Result<DynamicScene, ViewError> {
        self.0.frame(frame).map_err(told)
    }
}

/// The windows of a long clip.
struct ClipWindows(WindowedClip);

impl WindowSource for ClipWindows {
    fn times(&self) -> &TimeWindows {
        self.0.times()
    }

    fn scene(&self, window: usize) -> Result<DynamicScene, ViewError> {
        self.0.scene(window).map_err(told)
    }
}

fn told(error: dash_train::Error) -> ViewError {
    ViewError::Host(Failure::from(error).line())
}

impl Host for Desk {
    fn captured(&mut self, camera: usize, time: f32) -> Result<Option<Vec<u8>>, ViewError> {
        let view = self
            .captured
            .as_ref()
            .and_then(|captured| captured.view(camera, time));
        let background = self
            .captured
            .as_ref()
            .and_then(|captured| captured.dataset.background);
        let rgb = view.map(|view| view.rgb(background.unwrap_or_default()));
        Ok(rgb.transpose().map_err(told)?.map(|rgb| rgb8(&rgb)))
    }

    fn open(&mut self, path: &Path) -> Result<Content, ViewError> {
        self.content(path, None)
            .map_err(|failure| ViewError::Host(failure.line()))
    }

    fn save_picture(&mut self, frame: &Frame) -> Result<PathBuf, ViewError> {
        let path = self.free("picture", "png")?;
        write_png(&path, frame.width, frame.height, &frame.rgb()).map_err(told)?;
        Ok(path)
    }

    fn save_path(&mut self, path: &[PathCamera]) -> Result<PathBuf, ViewError> {
        let entry = |(index, at): (usize, &PathCamera)| CameraEntry {
            id: index as u64,
            img_name: format!("path{index:04}"),
            camera: at.camera.clone(),
            time: Some(f64::from(at.time)),
        };
        let entries: Vec<CameraEntry> = path.iter().enumerate().map(entry).collect();
        let file = self.free("path", "json")?;
        write_cameras(&file, &entries).map_err(told)?;
        Ok(file)
    }

    fn render_path(
        &mut self,
        scene: &DynamicScene,
        path: &[PathCamera],
    ) -> Result<PathBuf, ViewError> {
        let shot = |at: &PathCamera| Shot {
            camera_name: "path".into(),
            name: "path".into(),
            camera: at.camera.clone(),
            time: at.time,
        };
        let shots: Vec<Shot> = path.iter().map(shot).collect();
        let file = self.free("path", "mp4")?;
        let job = RenderJob {
            scene,
            shots: &shots,
            on_shot: &mut |_| {},
        };
        write_video(
            job,
            PictureLayer::Full,
            self.fps.unwrap_or(FRAME_RATE),
            &file,
        )
        .map_err(told)?;
        Ok(file)
    }
}
