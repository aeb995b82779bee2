//! `dash render`: pictures or a video of a run or of files of Gaussians.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use clap::Args;
use dash_train::cameras::{CameraFile, DatasetTerms};
use dash_train::render::{
    FRAME_RATE, PictureFormat, PictureLayer, RenderJob, Shot, at_times, file_shots, spiral_shots,
    test_shots, write_pictures, write_video,
};
use dash_train::train::{DataConfig, RunFolder};
use dash_train::windows::{WindowedClip, Windows};
use dash_train::{SceneOverTime, SplatClip};

use crate::Shared;
use crate::data::dataset_of;
use crate::failure::Failure;
use crate::progress::Progress;
use crate::values::{self, Color};

/// Cameras on the spiral path when --frames does not say how many.
const SPIRAL_CAMERAS: usize = 60;
/// Extensions of videos of kinds that are not written.
const OTHER_VIDEOS: [&str; 6] = ["mov", "mkv", "webm", "avi", "gif", "m4v"];

/// Render pictures or a video of a run, or of files of Gaussians
#[derive(Args)]
#[command(after_help = "Examples:
  dash render runs/room --cameras test --out out/pictures
  dash render runs/room --cameras spiral --frames 90 --out out/room.mp4
  dash render runs/room --cameras cameras.json --time 0.5 --layers full,dynamic,depth --out out/half
  dash render room_at_half.ply --cameras cameras.json --out out/ply
  dash render room.4dgs --cameras cameras.json --frames 60 --out room.mp4

Pictures are OUT/LAYER/NNNN_CAMERA.png, or NNNN_IMAGE.png for test views of a transforms.json; OUT/cameras.json
lists their poses, intrinsics and times. PNG: values clamped to [0, 1]; depth is scaled per picture,
the nearest surface white, the farthest black, black where there is none. EXR: values as rendered,
depth in world units: the mean of the Gaussians' along the camera's axis, weighted as they are blended, 0 where
there is nearly nothing.

--cameras F.json is the cameras.json of 3DGS, with optional id, img_name, cx, cy and time, or a transforms*.json
of NeRF, D-NeRF, Blender or nerfstudio. Pictures of the latter have the size that it states (w, h), also where
the run's dataset was loaded with --downscale; else that of the dataset's pictures as loaded, else that of the
image that file_path names. Its times are those of the run's dataset; for a file of Gaussians they are from 0 to 1.")]
pub struct RenderArgs {
    /// A run's folder, that of a long clip's windows, a file of Gaussians (.ply, .spz, .splat, .glb, .4dgs), or a folder of
    /// them, one for each frame
    #[arg(value_name = "RUN|FILE|FOLDER")]
    scene: PathBuf,
    /// test (the dataset's test views), spiral (a path around them), or a file: cameras.json or
    /// transforms*.json [default: test; a file of Gaussians needs one]
    #[arg(long, value_name = "F.json|test|spiral")]
    cameras: Option<String>,
    /// Where the run's dataset is, if it was moved
    #[arg(long, value_name = "DIR")]
    dataset: Option<PathBuf>,
    /// One instant for every camera, from 0 to 1; otherwise the views' own times
    #[arg(long, value_name = "T", value_parser = values::time, conflicts_with = "frames")]
    time: Option<f32>,
    /// Times from 0 to 1 for each camera; on a spiral, the cameras along it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    frames: Option<u32>,
    /// Folder to make, or an .mp4 file (needs ffmpeg) [default: RUN/renders]
    #[arg(long, value_name = "DIR|FILE.mp4")]
    out: Option<PathBuf>,
    /// What to show; a video shows one
    #[arg(long, value_enum, value_delimiter = ',', default_value = "full")]
    layers: Vec<PictureLayer>,
    /// Of a video: frames per second [default: test views play as recorded, where their videos tell; else 30]
    #[arg(long, value_name = "N", value_parser = values::frame_rate)]
    fps: Option<f64>,
    /// File format of pictures
    #[arg(long, value_enum, default_value = "png")]
    format: PictureFormat,
    /// Colour behind everything, each from 0 to 1 [default: the run's; black for a file]
    #[arg(long, value_name = "R,G,B")]
    background: Option<Color>,
}

/// What is rendered.
enum Source {
    Run(RunFolder),
    File(PathBuf),
    Windows(PathBuf, Box<Windows>),
}

impl Source {
    fn of(path: &Path) -> Result<Self, Failure> {
        Ok(if Windows::are_in(path) {
            Self::Windows(path.to_path_buf(), Box::new(Windows::read(path)?))
        } else if values::is_clip(path) {
            Self::File(path.to_path_buf())
        } else {
            Self::Run(RunFolder::open(path)?)
        })
    }

    /// The data that it was trained on; `None` of a file of Gaussians.
    fn data(&self) -> Result<Option<DataConfig>, Failure> {
        Ok(match self {
            Self::Run(run) => Some(run.config()?.data),
            Self::Windows(_, windows) => Some(windows.data.clone()),
            Self::File(_) => None,
        })
    }
}

pub fn run(args: &RenderArgs, shared: &Shared) -> Result<String, Failure> {
    if let Some(out) = &args.out {
        refuse_other_videos(out)?;
    }
    let source = Source::of(&args.scene)?;
    let out = match (&args.out, &source) {
        (Some(out), _) => out.clone(),
        (None, Source::Run(run)) => run.root().join("renders"),
        (None, Source::Windows(folder, _)) => folder.join("renders"),
        (None, Source::File(_)) => {
            return Err(Failure::usage(
                "a file of Gaussians has no folder for renders: give --out DIR",
            ));
        }
    };
    let layers: Vec<PictureLayer> = args
        .layers
        .iter()
        .copied()
        .collect::<BTreeSet<_>>()
        .into_iter()
        .collect();
    let video = values::has_extension(&out, "mp4");
    if args.fps.is_some() && !video {
        return Err(Failure::usage(format!(
            "--fps: expected a video to go with it, found --out {}; name an .mp4, or leave --fps out",
            out.display()
        )));
    }
    if video && layers.len() != 1 {
        return Err(Failure::usage(format!(
            "--layers: {} holds one layer, found {}; give one, or a folder to --out",
            out.display(),
            layers.len()
        )));
    }
    let device = shared.device.unwrap_or_default().device()?;
    let background = args.background.map(|Color(background)| background);
    let scene: Box<dyn SceneOverTime> = match &source {
        Source::Run(run) => {
            let mut scene = run.scene(&device)?;
            scene.settings.background = background.unwrap_or(scene.settings.background);
            Box::new(scene)
        }
        Source::File(path) => {
            let mut clip = SplatClip::open(path, &device)?;
            clip.set_background(background.unwrap_or_default());
            Box::new(clip)
        }
        Source::Windows(folder, _) => {
            let mut clip = WindowedClip::open(folder, &device)?;
            if let Some(background) = background {
                clip.set_background(background);
            }
            Box::new(clip)
        }
    };
    let (shots, own_rate) = shots(args, &source)?;
    let mut progress = Progress::new(shots.len(), shared);
    let job = RenderJob {
        scene: &*scene,
        shots: &shots,
        on_shot: &mut |done| progress.at(done, || "pictures".into()),
    };
    let written = match (video, layers.as_slice()) {
        (true, &[layer]) => {
            let frame_rate = args.fps.or(own_rate).unwrap_or(FRAME_RATE);
            write_video(job, layer, frame_rate, &out)
        }
        _ => write_pictures(job, &layers, args.format, &out),
    };
    progress.finish();
    written?;
    Ok(format!(
        "{}: {} pictures",
        out.display(),
        shots.len() * layers.len()
    ))
}

/// Refuses a name under which nobody would expect a folder of pictures.
fn refuse_other_videos(out: &Path) -> Result<(), Failure> {
    let is_other = |extension: &&&str| values::has_extension(out, extension);
    match OTHER_VIDEOS.iter().find(is_other) {
        Some(extension) => Err(Failure::usage(format!(
            "--out {}: expected a folder or a name that ends in .mp4, found .{extension}, which is not \
             written; render an .mp4 and convert it",
            out.display()
        ))),
        None => Ok(()),
    }
}

/// What to draw, and how many of these make a second of the recording, where that is known.
fn shots(args: &RenderArgs, source: &Source) -> Result<(Vec<Shot>, Option<f64>), Failure> {
    let named = args.cameras.as_deref().unwrap_or("test");
    let elsewhere = args.dataset.as_deref();
    let frames = args.frames.map(|n| n as usize);
    let data = source.data()?;
    let path = args.scene.display();
    let mut own_rate = None;
    let shots = match (named, &data) {
        ("test" | "spiral", None) => {
            return Err(Failure::usage(format!(
                "--cameras {named}: {path} names no dataset to take cameras from; give a file of cameras"
            )));
        }
        (_, None) if elsewhere.is_some() => {
            return Err(Failure::usage(format!(
                "--dataset: expected a run to go with it, found {path}; leave it out"
            )));
        }
        ("spiral", Some(data)) => {
            let dataset = dataset_of(data, elsewhere, true)?;
            let mut shots = spiral_shots(&dataset, frames.unwrap_or(SPIRAL_CAMERAS));
            if let Some(time) = args.time {
                shots.iter_mut().for_each(|shot| shot.time = time);
            }
            return Ok((shots, None));
        }
        ("test", Some(data)) => {
            let dataset = dataset_of(data, elsewhere, true)?;
            own_rate = match (args.time, frames) {
                (Some(_), _) => None,
                (None, n) => dataset.frame_rate_of(n.unwrap_or(dataset.n_frames)),
            };
            let shots = test_shots(&dataset);
            if shots.is_empty() {
                return Err(Failure::new(format!(
                    "{}: expected test views, found none; give --cameras spiral or a file of cameras",
                    dataset.root.display()
                )));
            }
            shots
        }
        (name, _) if !name.contains('.') && !Path::new(name).exists() => {
            return Err(Failure::usage(format!(
                "--cameras {name}: expected test, spiral or a file of cameras, found no file of this name"
            )));
        }
        (file, data) => {
            let file = CameraFile::read(Path::new(file))?;
            let terms = match data {
                Some(data) if file.is_transforms() => terms(data, elsewhere)?,
                _ => None,
            };
            file_shots(file, terms.as_ref())?
        }
    };
    let shots = match (args.time, frames) {
        (Some(time), _) => {
            let mut shots = at_times(&shots, 1);
            shots.iter_mut().for_each(|shot| shot.time = time);
            shots
        }
        (None, Some(n)) => at_times(&shots, n),
        (None, None) => shots,
    };
    Ok((shots, own_rate))
}

/// What the run's dataset says to a `transforms*.json`; nothing where it is gone.
fn terms(data: &DataConfig, elsewhere: Option<&Path>) -> Result<Option<DatasetTerms>, Failure> {
    if elsewhere.is_none() && !data.dataset.is_dir() {
        tracing::warn!(
            "{}: the run's dataset is not there: times are taken to be from 0 to 1; if it was moved, say where \
             it is with --dataset DIR",
            data.dataset.display()
        );
        return Ok(None);
    }
    let dataset = dataset_of(data, elsewhere, true)?;
    Ok(Some(DatasetTerms::of(&dataset, data.downscale)))
}
