//! `dash info`: what a run, a dataset or a file of Gaussians holds.

use std::path::{Path, PathBuf};

use burn::tensor::Device;
use clap::Args;
use dash_kernels::splats::NEAR_PLANE;
use dash_model::{SplatFile, is_splat_ply, read_splats};
use dash_train::dataset::{Dataset, FrameRange, Layout, LoadOptions, Partition, load};
use dash_train::evaluate::storage_bytes;

use dash_train::SplatClip;
use dash_train::ply::{PointCloud, read_points};
use dash_train::results::read_results;
use dash_train::train::paper::Decomposition;
use dash_train::train::{Decision, RunFolder, StageEnds, TrainConfig};

use crate::Shared;
use crate::configuration::name;
use crate::failure::Failure;
use crate::summary::{Table, add_scores, bytes, duration, listed};
use crate::values;

/// Say what a run, a dataset or a file of Gaussians holds
#[derive(Args)]
#[command(
    after_help = "Examples:\n  dash info runs/room\n  dash info out/room\n  dash info room_at_half.ply"
)]
pub struct InfoArgs {
    /// A run's folder, a dataset's folder, a file of Gaussians (.ply, .spz, .splat, .glb, .4dgs), a folder of these, or a PLY of
    /// points
    path: PathBuf,
    /// Force the dataset's layout instead of recognising it by its files
    #[arg(long, value_enum)]
    layout: Option<Layout>,
    /// Of a dataset, the frames to look at, such as 151-200, or all, as `dash train` takes them
    #[arg(long, value_name = "FIRST-LAST")]
    frames: Option<FrameRange>,
}

pub fn run(args: &InfoArgs, shared: &Shared) -> Result<String, Failure> {
    let path = &args.path;
    let table = if values::is_splat_file(path) {
        file(path)?
    } else if values::is_clip(path) {
        clip(path, &shared.device.unwrap_or_default().device()?)?
    } else if path.join("config.toml").is_file() {
        finished_or_not(
            &RunFolder::open(path)?,
            &shared.device.unwrap_or_default().device()?,
            shared.verbose,
        )?
    } else {
        let options = LoadOptions {
            layout: args.layout,
            frames: args.frames,
            on_demand: true,
            ..Default::default()
        };
        dataset(&load(path, &options)?)
    };
    Ok(table.text())
}

fn finished_or_not(run: &RunFolder, device: &Device, verbose: bool) -> Result<Table, Failure> {
    let config = run.config()?;
    let mut table = Table::default();
    table
        .row("run", run.root().display())
        .row("dataset", config.data.dataset.display())
        .row("preset", name(config.train.preset))
        .row("device", &config.data.device);
    if config.data.downscale != 1.0 {
        table.row("downscale", config.data.downscale);
    }
    settings(&mut table, &config.train, config.stage_ends);
    let log = run.log()?;
    if let Some(last) = log.last() {
        let text = format!(
            "{} of {} steps, {}, training PSNR {:.2} dB",
            last.step,
            config.train.iterations,
            duration(last.seconds),
            last.train_psnr
        );
        table.row("trained", text);
        let validation = log.iter().rev().find_map(|line| line.validation_psnr);
        if let Some(psnr) = validation {
            table.row("validation PSNR", format!("{psnr:.2} dB"));
        }
    }
    if !run.scene_path().join("scene.json").is_file() {
        table.row(
            "scene",
            "not finished; continue with `dash train DATASET --out RUN --resume`",
        );
        return Ok(table);
    }
    let scene = run.scene(device)?;
    let (n_static, n_dynamic) = scene.counts();
    table.row(
        "scene",
        format!(
            "{n_static} static and {n_dynamic} dynamic Gaussians, SH degree {}, {}",
            scene.settings.sh_degree,
            bytes(storage_bytes(&run.scene_path())?)
        ),
    );
    let (left_out, kept): (Vec<&Decision>, Vec<&Decision>) = config
        .decisions
        .iter()
        .partition(|decision| decision.left_out);
    if !config.decisions.is_empty() {
        let all = config.decisions.len();
        let text = format!(
            "{} of {all} parts that were tried; -v lists them",
            left_out.len()
        );
        table.row("left out", text);
    }
    if verbose {
        for (name, decisions) in [("left out", left_out), ("kept", kept)] {
            for decision in decisions {
                table.row(name, told(decision));
            }
        }
    }
    if let Some(results) = read_results(run)? {
        add_scores(&mut table, &results);
    }
    Ok(table)
}

/// What a decision was about, and what was measured.
fn told(decision: &Decision) -> String {
    let measured = [
        decision
            .db
            .map(|db| format!("without it {db:+.3} dB at step {}", decision.step)),
        decision
            .moving_db
            .map(|db| format!("{db:+.3} dB where something moves")),
        decision
            .bytes
            .map(|size| format!("{} on disk", bytes(size))),
        decision
            .millis
            .map(|millis| format!("{millis:+.2} ms a view")),
    ];
    let measured: Vec<String> = measured.into_iter().flatten().collect();
    match measured.is_empty() {
        true => format!("{}: {}", decision.part, decision.reason),
        false => format!(
            "{} ({}): {}",
            decision.part,
            measured.join(", "),
            decision.reason
        ),
    }
}

fn settings(table: &mut Table, config: &TrainConfig, ends: Option<StageEnds>) {
    // A short run may have moved them.
    let ends = ends.unwrap_or_else(|| {
        let [warmup, decomposition] = config.method.stages.map(|share| config.step_at(share));
        StageEnds {
            warmup,
            decomposition,
        }
    });
    let (warmup, found, end) = (ends.warmup, ends.decomposition, config.iterations);
    let stages = match config.method.decomposition {
        Decomposition::None => format!("static 3DGS to step {end}"),
        Decomposition::Moving => {
            format!("warm-up to step {warmup}, decomposition to {found}, 4D to {end}")
        }
        Decomposition::AllWithMotion => {
            format!(
                "warm-up to step {warmup}, coarse motion to {found}, then everything in 4D to {end}"
            )
        }
        Decomposition::All => {
            format!("warm-up to step {warmup}, then everything in 4D to {end}")
        }
    };
    table.row("seed", config.seed).row("stages", stages);
}

fn dataset(dataset: &Dataset) -> Table {
    let mut table = Table::default();
    let sizes: std::collections::BTreeSet<(usize, usize)> = dataset
        .views
        .iter()
        .map(|view| (view.camera.width, view.camera.height))
        .collect();
    let sizes: Vec<String> = sizes.iter().map(|(w, h)| format!("{w}x{h}")).collect();
    let times = dataset
        .views
        .iter()
        .map(|view| view.time)
        .fold([1.0_f32, 0.0], |[low, high], time| {
            [low.min(time), high.max(time)]
        });
    let held_out: std::collections::BTreeSet<&str> = dataset
        .views_of(Partition::Test)
        .map(|view| view.camera_name.as_str())
        .collect();
    let held_out: Vec<&str> = held_out.into_iter().collect();
    table
        .row("dataset", &dataset.name)
        .row("layout", dataset.layout)
        .row("cameras", dataset.n_cameras)
        .row(
            "frames",
            if dataset.is_static() {
                "1 (static)".into()
            } else {
                dataset.n_frames.to_string()
            },
        )
        .row("times", format!("{} to {}", times[0], times[1]))
        .row(
            "views",
            format!(
                "{} to train on, {} to test",
                dataset.views_of(Partition::Train).count(),
                dataset.views_of(Partition::Test).count()
            ),
        )
        .row("test cameras", listed(&held_out))
        .row("size", listed(&sizes))
        .row("images, decoded", bytes(dataset.image_bytes()))
        .row(
            "points",
            dataset
                .points
                .as_ref()
                .map_or("none".into(), |points| points.len().to_string()),
        );
    if let Some(background) = dataset.background {
        table.row(
            "background",
            format!("{background:?} behind transparent pixels"),
        );
    }
    table
}

fn file(path: &Path) -> Result<Table, Failure> {
    let mut table = Table::default();
    table.row("file", path.display());
    match read_splats(path) {
        Ok(file) => splats(&mut table, &file),
        Err(damaged) if !values::has_extension(path, "ply") || is_splat_ply(path) => {
            return Err(damaged.into());
        }
        // A file without the columns of Gaussians may hold plain points.
        Err(not_splats) => match read_points(path) {
            Ok(points) => cloud(&mut table, &points),
            Err(_) => return Err(not_splats.into()),
        },
    }
    Ok(table)
}

/// A `.4dgs`, or a folder of files of Gaussians.
fn clip(path: &Path, device: &Device) -> Result<Table, Failure> {
    let clip = SplatClip::open(path, device)?;
    let first = clip.frame(0)?;
    let mut table = Table::default();
    table
        .row("clip", path.display())
        .row("frames", clip.n_frames());
    if let Some(rate) = clip.frame_rate() {
        table.row("frames per second", rate);
    }
    table
        .row("Gaussians, first frame", first.counts().0)
        .row("SH degree", first.settings.sh_degree);
    Ok(table)
}

fn splats(table: &mut Table, file: &SplatFile) {
    let rows = &file.rows;
    table
        .row("Gaussians", rows.len())
        .row("SH degree", rows.sh_degree());
    if file.left_out.count() > 0 {
        table.row("left out", file.left_out);
    }
    if file.near_plane != NEAR_PLANE {
        table.row("near plane", file.near_plane);
    }
    add_box(table, &rows.means);
}

fn cloud(table: &mut Table, points: &PointCloud) {
    table.row("points", points.len());
    add_box(table, &points.positions);
}

fn add_box(table: &mut Table, positions: &[[f32; 3]]) {
    if positions.is_empty() {
        return;
    }
    let extreme = |pick: fn(f32, f32) -> f32| -> [f32; 3] {
        std::array::from_fn(|axis| {
            positions
                .iter()
                .map(|p| p[axis])
                .fold(positions[0][axis], pick)
        })
    };
    table
        .row("from", format!("{:?}", extreme(f32::min)))
        .row("to", format!("{:?}", extreme(f32::max)));
}
