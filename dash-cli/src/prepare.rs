//! `dash prepare`: a dataset from the recordings of a rig.

use std::path::PathBuf;

use clap::Args;
use dash_train::prepare::{CameraModel, FrameSize, LensChoice, PrepareConfig, prepare};

use crate::failure::Failure;
use crate::values::{CameraList, downscale};

/// Make a dataset from the videos or image folders of a rig of your own (needs ffmpeg for videos, COLMAP for poses and points)
#[derive(Args)]
#[command(
    after_help = "Examples:\n  dash prepare footage data/mine --fps 15 --height 720\n  \
    dash prepare footage data/mine --poses poses_bounds.npy --offsets offsets.json\n  \
    dash prepare footage data/mine --poses transforms.json --random-points 20000\n\n\
    offsets.json says by how many seconds a camera's recording began earlier than the others: {\"cam01\": 0.033}"
)]
pub struct PrepareArgs {
    /// Folder with one video per camera (cam00.mp4, ..), or one folder of images per camera
    input: PathBuf,
    /// Folder to make; must not exist, or be empty
    out: PathBuf,
    /// Frames a second [default: the lowest rate among the recordings]
    #[arg(long, value_name = "F")]
    fps: Option<f64>,
    /// Frames a second of folders of images
    #[arg(long, value_name = "F", default_value_t = 30.0)]
    image_fps: f64,
    /// Make frames at most this many pixels high
    #[arg(long, value_name = "PX", conflicts_with = "downscale")]
    height: Option<usize>,
    /// Divide width and height of frames by this
    #[arg(long, value_name = "K", value_parser = downscale)]
    downscale: Option<f64>,
    /// First second to take
    #[arg(long, value_name = "S")]
    start: Option<f64>,
    /// Last second to take
    #[arg(long, value_name = "S")]
    end: Option<f64>,
    /// JSON file of seconds by camera: frames are taken at the time plus these
    #[arg(long, value_name = "FILE")]
    offsets: Option<PathBuf>,
    /// Known poses: poses_bounds.npy, transforms.json, or the folder of a COLMAP model
    #[arg(long, value_name = "PATH")]
    poses: Option<PathBuf>,
    /// Lens model where poses are to be found
    #[arg(long, value_enum, default_value_t)]
    camera_model: CameraModel,
    /// Whether the cameras share one lens; auto: if their pictures have one size, else one each
    #[arg(long, value_enum, default_value_t)]
    lens: LensChoice,
    /// Write N random points instead of triangulated ones; needs --poses, but not COLMAP
    #[arg(long, value_name = "N")]
    random_points: Option<usize>,
    /// Keep at most N points
    #[arg(long, value_name = "N", default_value_t = 100_000)]
    max_points: usize,
    /// Cameras to hold out, counted from 0 in the order of names; or none
    #[arg(long, value_name = "LIST", default_value = "0")]
    test_cameras: CameraList,
    /// Seed of the random points
    #[arg(long, value_name = "S", default_value_t)]
    seed: u64,
}

pub fn run(args: &PrepareArgs) -> Result<String, Failure> {
    let size = match (args.height, args.downscale) {
        (Some(height), _) => FrameSize::Height(height),
        (None, Some(factor)) => FrameSize::Downscale(factor),
        (None, None) => FrameSize::Recorded,
    };
    let config = PrepareConfig {
        fps: args.fps,
        image_rate: args.image_fps,
        size,
        start: args.start,
        end: args.end,
        offsets: args.offsets.clone(),
        poses: args.poses.clone(),
        camera_model: args.camera_model,
        lens: args.lens,
        random_points: args.random_points,
        max_points: args.max_points,
        test_cameras: args.test_cameras.0.clone(),
        seed: args.seed,
    };
    Ok(prepare(&args.input, &args.out, &config)?.to_string())
}
