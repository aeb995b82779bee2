//! `dash export`: a scene for other programs: instants as files of Gaussians, a clip, or a web page.

use std::fs;
use std::path::{Path, PathBuf};

use burn::tensor::Device;
use clap::Args;
use dash_kernels::Camera;
use dash_model::unfinished::Unfinished;
use dash_model::{DynamicScene, Layer, ModelError, SplatFormat, write_splats};
use dash_train::metrics::psnr;
use dash_train::render::{Picture, render_over_time, test_shots};
use dash_train::train::{DataConfig, RunFolder};
use dash_train::windows::{WindowedClip, Windows};
use dash_train::{SceneOverTime, SplatClip, rows_at};

use crate::Shared;
use crate::data::dataset_of;
use crate::failure::Failure;
use crate::summary::bytes;
use crate::values;

/// Cameras and times at which a file is compared.
const COMPARED: usize = 4;
/// Digits of the names of files.
const DIGITS: usize = 4;
#[cfg(feature = "fourdgs")]
/// How far Gaussians of a clip may be off, of the scene's diagonal: half a pixel of a picture of 1,000.
const MAX_ERROR: f64 = 0.0005;

/// Write the scene for other programs: an instant, several, the whole clip, or a web page
#[derive(Args)]
#[command(after_help = "Examples:
  dash export runs/room --time 0.5 --out room_at_half.ply
  dash export runs/room --time 0.5 --out room_at_half.spz
  dash export runs/room --frames 60 --out out/plys
  dash export runs/room --out room.4dgs
  dash export runs/room --web out/page

The name's ending says the format:
  .ply    standard 3DGS, all values: SuperSplat, gsplat, the authors' viewers
  .spz    Niantic's, rounded, about a tenth of a PLY: SuperSplat, Spark, PlayCanvas, Scaniverse
  .splat  32 bytes a Gaussian, one colour for all directions: viewers in browsers
  .glb    glTF with KHR_gaussian_splatting, all values: PlayCanvas, Babylon.js, Cesium
  .4dgs   the whole clip in one file that players seek in (https://4dgs.dev); --max-error says how closely it is followed
With --frames --out is a folder, of PLY files unless --format says another. dash render, info and view read all of these.

With --web the scene is a web page that plays it: put the folder on any web server, or, with --single-file, send the one
HTML file. The page's keys stand under its ? button; ?time=0.5&camera=cam03&layer=depth&autoplay=0 in its address sets how it begins.

How near a file is to the scene is measured on held-out cameras, where the run's dataset is there.

A run has a near plane: Gaussians nearer to a camera than anything that was seen are not drawn. Only a PLY names it, in
a comment, which dash render FILE.ply heeds. Other viewers may show floaters before the training cameras. There are as many f_rest_* columns as the scene's degree of colours
needs (0, 9, 24 or 45); the viewers of the 3DGS authors read 45 only: --sh-degree 3.")]
pub struct ExportArgs {
    /// A run's folder, or that of a long clip's windows
    run: PathBuf,
    /// The instant, from 0 (the clip's start) to 1 (its end)
    #[arg(long, value_name = "T", value_parser = values::time)]
    time: Option<f32>,
    /// So many instants, evenly from the clip's start to its end, a file each; of a .4dgs the instants that it follows
    /// [default of a .4dgs: the dataset's frames]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..), conflicts_with = "time")]
    frames: Option<u16>,
    /// File to write, one that exists is replaced; with --frames a folder to make
    #[arg(long, value_name = "FILE|DIR", required_unless_present_any = INSTEAD_OF_OUT)]
    out: Option<PathBuf>,
    /// Format of the files, with --frames [default: ply]
    #[arg(long, value_name = "FORMAT", value_parser = format, requires = "frames")]
    format: Option<SplatFormat>,
    /// Colour coefficients up to this degree, zeros where the scene has none [default: the scene's degree]
    #[arg(long, value_name = "0..3", value_parser = clap::value_parser!(u8).range(0..=3))]
    sh_degree: Option<u8>,
    /// Of a .4dgs or a web page: frames per second [default: as recorded, where videos tell; else 30]
    #[arg(long, value_name = "N", value_parser = values::frame_rate)]
    fps: Option<f64>,
    /// Of a .4dgs: how far a Gaussian's centre, or an end of its axes, may be off, as a share of the scene's diagonal [default: 0.0005]
    #[arg(long, value_name = "SHARE", value_parser = max_error)]
    max_error: Option<f64>,
    #[cfg(feature = "view")]
    #[command(flatten)]
    web: crate::web::WebArgs,
}

/// Options that stand in for `--out`.
const INSTEAD_OF_OUT: &[&str] = if cfg!(feature = "view") {
    &["web"]
} else {
    &[]
};

fn format(text: &str) -> Result<SplatFormat, String> {
    let found = SplatFormat::ALL
        .into_iter()
        .find(|format| format.extension() == text);
    found.ok_or_else(|| format!("expected {}, found `{text}`", listed("")))
}

/// The formats, each after `dot`.
fn listed(dot: &str) -> String {
    SplatFormat::ALL
        .map(|format| format!("{dot}{format}"))
        .join(", ")
}

pub fn run(args: &ExportArgs, shared: &Shared) -> Result<String, Failure> {
    #[cfg(feature = "view")]
    if let Some(out) = &args.web.web {
        return crate::web::run(&args.run, out, &args.web, args.fps, shared);
    }
    let out = args.out.as_ref().expect("clap asks for it");
    if SplatClip::is_motions(out) {
        return clip(args, out, shared);
    }
    for (option, is_given) in [
        ("--fps", args.fps.is_some()),
        ("--max-error", args.max_error.is_some()),
    ] {
        if is_given {
            return Err(Failure::usage(format!(
                "{option}: expected a clip to go with it, found {}; leave it out, or name a .4dgs",
                out.display()
            )));
        }
    }
    if args.frames.is_none() && SplatFormat::of(out).is_none() {
        return Err(Failure::usage(format!(
            "--out {}: expected a name that ends in one of {}",
            out.display(),
            listed(".") + ", .4dgs"
        )));
    }
    if args.time.is_none() && args.frames.is_none() {
        return Err(Failure::usage(format!(
            "--out {}: expected the instant with it; give --time T, from 0 to 1, or --frames N",
            out.display()
        )));
    }
    let device = shared.device.unwrap_or_default().device()?;
    let (found, data) = shown(&args.run, &device)?;
    let scene = found.over_time();
    let export = Export {
        run: &args.run,
        scene,
        sh_degree: args.sh_degree.map(usize::from),
    };
    let (first, time, size, what) = match args.frames {
        None => {
            let time = args.time.unwrap_or(0.0);
            let n = export.write(time, out)?;
            let drawn = scene.drawn_at(time)?;
            let counts = drawn.iter().map(|part| part.scene.counts());
            let (n_static, n_dynamic) = counts.fold((0, 0), |sum, n| (sum.0 + n.0, sum.1 + n.1));
            let what =
                format!("{n} Gaussians ({n_static} static, {n_dynamic} dynamic) at time {time}");
            (out.clone(), time, size_of(out)?, what)
        }
        Some(n_frames) => {
            let n_frames = usize::from(n_frames);
            let format = args.format.unwrap_or(SplatFormat::Ply);
            export.write_all(n_frames, format, out)?;
            let names = (0..n_frames).map(|frame| out.join(name(frame, format)));
            let size = names
                .clone()
                .map(|path| size_of(&path))
                .sum::<Result<u64, _>>()?;
            let what = format!("{n_frames} files, {format}");
            (out.join(name(0, format)), 0.0, size, what)
        }
    };
    let file = SplatClip::open(&first, &device)?;
    let near = fidelity(scene, &file, &[time], &held_out(&data)?)?;
    Ok(format!("{}: {what}, {}{near}", out.display(), bytes(size)))
}

fn name(frame: usize, format: SplatFormat) -> String {
    format!("{frame:0DIGITS$}.{format}")
}

fn size_of(path: &Path) -> Result<u64, Failure> {
    let found = fs::metadata(path).map_err(|e| ModelError::io(path, "read", e))?;
    Ok(found.len())
}

struct Export<'a> {
    run: &'a Path,
    scene: &'a dyn SceneOverTime,
    sh_degree: Option<usize>,
}

impl Export<'_> {
    /// Writes one instant; its number of Gaussians.
    fn write(&self, time: f32, path: &Path) -> Result<usize, Failure> {
        let (mut rows, near_plane) = rows_at(self.scene, time)?;
        if let Some(degree) = self.sh_degree {
            let least = rows.sh_degree();
            if degree < least {
                return Err(Failure::usage(format!(
                    "--sh-degree {degree}: {} has colours of degree {least}; expected {least} to 3",
                    self.run.display()
                )));
            }
            rows = rows.with_sh_degree(degree);
        }
        write_splats(path, &rows, near_plane)?;
        Ok(rows.len())
    }

    /// Writes a file for each of so many instants into a folder, which appears when it is complete.
    fn write_all(&self, n_frames: usize, format: SplatFormat, out: &Path) -> Result<(), Failure> {
        if fs::symlink_metadata(out).is_ok() {
            return Err(Failure::new(format!(
                "{}: expected no such folder, found something there; remove it or choose another --out",
                out.display()
            )));
        }
        if let Some(parent) = out.parent().filter(|parent| *parent != Path::new("")) {
            fs::create_dir_all(parent).map_err(|e| ModelError::io(parent, "create", e))?;
        }
        let scratch = Unfinished::folder(out).map_err(|e| ModelError::io(out, "write", e))?;
        for frame in 0..n_frames {
            let time = frame as f64 / n_frames.saturating_sub(1).max(1) as f64;
            self.write(time as f32, &scratch.path().join(name(frame, format)))?;
        }
        scratch
            .finish(|scratch| fs::rename(scratch, out))
            .map_err(|e| ModelError::io(out, "write", e).into())
    }
}

/// What a folder shows over time.
enum Shown {
    Run(Box<DynamicScene>),
    Windows(Box<WindowedClip>),
}

impl Shown {
    fn over_time(&self) -> &dyn SceneOverTime {
        match self {
            Self::Run(scene) => &**scene,
            Self::Windows(clip) => &**clip,
        }
    }
}

/// What a folder shows, and the data that it was trained on.
fn shown(folder: &Path, device: &Device) -> Result<(Shown, DataConfig), Failure> {
    if Windows::are_in(folder) {
        let clip = WindowedClip::open(folder, device)?;
        let data = clip.windows().data.clone();
        return Ok((Shown::Windows(Box::new(clip)), data));
    }
    let run = RunFolder::open(folder)?;
    let scene = Box::new(run.scene(device)?);
    Ok((Shown::Run(scene), run.config()?.data))
}

/// A few of the held-out cameras; none where the dataset is gone.
fn held_out(data: &DataConfig) -> Result<Vec<Camera>, Failure> {
    if !data.dataset.is_dir() {
        return Ok(Vec::new());
    }
    let mut cameras: Vec<Camera> = Vec::new();
    for shot in test_shots(&dataset_of(data, None, true)?) {
        if !cameras.contains(&shot.camera) {
            cameras.push(shot.camera);
        }
    }
    let stride = cameras.len().div_ceil(COMPARED).max(1);
    Ok(cameras.into_iter().step_by(stride).collect())
}

/// How far pictures of a file are from those of the scene, in all pixels together, in words; nothing without cameras.
fn fidelity(
    scene: &dyn SceneOverTime,
    file: &SplatClip,
    times: &[f32],
    cameras: &[Camera],
) -> Result<String, Failure> {
    if cameras.is_empty() {
        return Ok(String::new());
    }
    let (mut own, mut files) = (Vec::new(), Vec::new());
    for &time in times {
        let mut shown = file.scene_at(time)?;
        if let Some(part) = scene.drawn_at(time)?.first() {
            let settings = &part.scene.settings;
            shown.settings.background = settings.background;
            shown.settings.near_plane = settings.near_plane;
        }
        for camera in cameras {
            own.extend(render_over_time(scene, camera, time, Layer::Full)?.rgb);
            files.extend(Picture::of(shown.render(camera, time)?)?.rgb);
        }
    }
    let db = psnr(&own, &files);
    let cameras = match cameras.len() {
        1 => "1 held-out camera".to_string(),
        n => format!("{n} held-out cameras"),
    };
    Ok(format!(
        "; its pictures agree with the scene's own at {db:.1} dB ({cameras})"
    ))
}

fn max_error(text: &str) -> Result<f64, String> {
    let share = text.parse().ok();
    share
        .filter(|share| *share > 0.0 && *share < 1.0)
        .ok_or_else(|| {
            format!("expected a share of the scene's diagonal above 0 and below 1, found `{text}`")
        })
}

/// Writes a `.4dgs`.
#[cfg(feature = "fourdgs")]
fn clip(args: &ExportArgs, out: &Path, shared: &Shared) -> Result<String, Failure> {
    use dash_model::TimeWindows;
    use dash_train::four_dgs::{ClipOptions, write_clip};
    use dash_train::render::FRAME_RATE;

    if args.time.is_some() || args.format.is_some() || args.sh_degree.is_some() {
        return Err(Failure::usage(format!(
            "--out {}: expected a clip, found --time, --format or --sh-degree; leave it out, or name another kind of file",
            out.display()
        )));
    }
    let device = shared.device.unwrap_or_default().device()?;
    let (found, data) = shown(&args.run, &device)?;
    let (n_frames, own_rate) = frames_of(&data, args.frames.map(usize::from))?;
    let options = ClipOptions {
        n_frames,
        frame_rate: args.fps.or(own_rate).unwrap_or(FRAME_RATE),
        max_error: args.max_error.unwrap_or(MAX_ERROR),
    };
    let written = match &found {
        Shown::Run(scene) => {
            let of_clip = |_| Ok((**scene).clone());
            write_clip(out, &TimeWindows::whole(), &of_clip, &options)?
        }
        Shown::Windows(clip) => {
            write_clip(out, clip.times(), &|number| clip.scene(number), &options)?
        }
    };
    let file = SplatClip::open(out, &device)?;
    // At frames, where the motion was followed.
    let last = options.n_frames - 1;
    let frames = (0..COMPARED).map(|k| k * last / (COMPARED - 1));
    let times: Vec<f32> = frames
        .map(|frame| frame as f32 / last.max(1) as f32)
        .collect();
    let near = fidelity(found.over_time(), &file, &times, &held_out(&data)?)?;
    Ok(format!(
        "{}: {} frames, {} static Gaussians, {} dynamic ones in {} pieces, {}{near}",
        out.display(),
        options.n_frames,
        written.n_static,
        written.n_dynamic,
        written.n_pieces,
        bytes(size_of(out)?)
    ))
}

#[cfg(not(feature = "fourdgs"))]
fn clip(_args: &ExportArgs, out: &Path, _shared: &Shared) -> Result<String, Failure> {
    Err(Failure::usage(format!(
        "--out {}: this program was built without the feature `fourdgs`",
        out.display()
    )))
}

/// The frames of a clip, those of its dataset where no number is wanted, and how many make a second of the recording.
#[cfg(feature = "fourdgs")]
fn frames_of(data: &DataConfig, wanted: Option<usize>) -> Result<(usize, Option<f64>), Failure> {
    if !data.dataset.is_dir() {
        if let Some(n_frames) = wanted {
            return Ok((n_frames, None));
        }
        return Err(Failure::usage(format!(
            "{}: the run's dataset, which says how many frames there are, is gone; give --frames N",
            data.dataset.display()
        )));
    }
    let dataset = dataset_of(data, None, true)?;
    let n_frames = wanted.unwrap_or(dataset.n_frames);
    Ok((n_frames, dataset.frame_rate_of(n_frames)))
}
