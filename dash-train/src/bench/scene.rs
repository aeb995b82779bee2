//! Times of a whole scene as large as a trained one: rendering it, and training it further.
//!
//! Gaussians of about three pixels fill a ball, seen by cameras on a circle; a fifth of them is dynamic. No error is
//! measured, because every operation of the picture has a reference of its own.

use std::sync::Arc;

use burn::tensor::Device;
use dash_kernels::{Camera, counts};
use dash_model::{
    DeformationField, DynamicPart, DynamicScene, GaussianRows, Gaussians, SpaceBox,
    TrajectoryBasis, logit,
};
use rand::Rng;
use rand_pcg::Pcg64;

use super::{Asked, Bench, Measurement, Op, Pass, Target, Timing, generator, time};
use crate::Error;
use crate::dataset::{Dataset, Layout, View};
use crate::numbers::standard_normal;
use crate::train::paper::Trajectories;
use crate::train::{Keep, Preset, TrainConfig, Trainer};

/// Pixels of the pictures that a run is set up with.
const SMALL: [usize; 2] = [32, 24];
const CAMERAS: usize = 5;
/// Of the cameras from the middle of the scene, world units.
const DISTANCE: f64 = 4.0;
/// What is nearer to a camera is not drawn, world units.
const NEAR: f64 = 0.2;
/// Of the ball that the scene fills, world units.
const RADIUS: f32 = 2.0;
/// Typical standard deviation of a Gaussian on the screen, pixels, and how its logarithm is spread.
const SIGMA: (f32, f32) = (3.0, 0.6);
/// Of the trajectories over the whole clip, world units.
const MOTION: f32 = 0.1;
/// Steps over which launches and reads are counted.
const COUNTED: usize = 4;
/// Views between one picture and the next: another camera, eight or nine frames on.
const STRIDE: usize = 43;

const NOTE: &str = "`scene`, values: one picture of 1352 x 1014 from other cameras and at other times than the one \
                    before, the device waited for after each; gradients: one step of training in the 4D stage, \
                    between rounds of density control";

/// With the sizes of these presets' fields.
const PRESETS: [(Preset, &str); 3] = [
    (Preset::Quick, "field of quick"),
    (Preset::Default, "field of default"),
    (Preset::Paper, "field of paper"),
];

/// A scene to be made.
#[derive(Debug, Clone, Copy)]
pub(super) struct Made {
    /// Gaussians.
    pub(super) n: usize,
    /// Percent of them that move.
    pub(super) moving: usize,
    /// Pixels of a picture.
    pub(super) size: [usize; 2],
    /// Frames of the clip.
    pub(super) frames: usize,
}

impl Made {
    /// As Neural 3D Video has them, at half size: pictures, and 10 s of frames. A fifth moves.
    pub(super) fn of(n: usize) -> Self {
        Self {
            n,
            moving: 20,
            size: [1352, 1014],
            frames: 300,
        }
    }
}

/// How long a picture and a training step take, and what they ask of the device.
pub(super) struct Taken {
    pub(super) picture: (Timing, Asked),
    pub(super) step: (Timing, Asked),
}

pub(super) fn measure(bench: &mut Bench, target: Target, n: usize) -> Result<(), Error> {
    for (preset, variant) in PRESETS {
        let taken = take_times(preset, Made::of(n), target.device)?;
        taken.add_to(bench, NOTE, |pass| {
            target.measurement(Op::Scene, variant, pass, n)
        });
    }
    Ok(())
}

impl Taken {
    /// Adds both times to measurements that `of` makes of each pass.
    pub(super) fn add_to(self, bench: &mut Bench, note: &str, of: impl Fn(Pass) -> Measurement) {
        let passes = [(Pass::Forward, self.picture), (Pass::Gradient, self.step)];
        for (pass, (time, asked)) in passes {
            bench.add(Measurement {
                time: Some(time),
                asked: Some(asked),
                note: Some(note.into()),
                ..of(pass)
            });
        }
    }
}

/// Times a scene with the field of a preset.
pub(super) fn take_times(preset: Preset, made: Made, device: &Device) -> Result<Taken, Error> {
    let mut config = TrainConfig::preset(preset);
    (config.sh_degree, config.sh_interval) = (3, 0.0);
    config.keep(Keep::All);
    let mut trainer = Trainer::new(config, Arc::new(clip(SMALL, made.frames)), device)?;
    let dataset = Arc::new(clip(made.size, made.frames));
    let still = scene(&trainer, made, device)?;
    let mut turn = 0;
    let pictures = time(Some(device), || {
        turn += STRIDE;
        let view = &dataset.views[turn % dataset.views.len()];
        still.render(&view.camera, view.time)?;
        Ok(())
    })?;
    let (shown, of_picture) = counts::of(|| still.render(&dataset.views[0].camera, 0.5));
    shown?;
    let learning = scene(&trainer, made, &device.clone().autodiff())?;
    trainer.run.continue_with(learning, dataset);
    let steps = time(Some(device), || match trainer.step()?.n_skipped {
        0 => Ok(()),
        _ => Err(Error::DeviceFault(
            "a step of training a sound scene was not finite".into(),
        )),
    })?;
    let (stepped, of_steps) =
        counts::of(|| (0..COUNTED).try_for_each(|_| trainer.step().map(|_| ())));
    stepped?;
    Ok(Taken {
        picture: (pictures, Asked::of(&of_picture, 1)),
        step: (steps, Asked::of(&of_steps, COUNTED)),
    })
}

/// Cameras on a half circle, each with a picture at every frame; all of them are one grey picture.
fn clip([width, height]: [usize; 2], frames: usize) -> Dataset {
    let camera = |index: usize| {
        let angle = std::f64::consts::PI * index as f64 / (CAMERAS - 1) as f64;
        let (sine, cosine) = angle.sin_cos();
        let (w, h) = (width as f64, height as f64);
        Camera::new(w, w, 0.5 * w, 0.5 * h, width, height).look_at(
            [DISTANCE * cosine, -0.3 * DISTANCE, DISTANCE * sine],
            [0.0; 3],
            [0.0, 1.0, 0.0],
        )
    };
    let picture = vec![100; width * height * 3];
    let first = View::from_rgb8("made", camera(0), 0.0, picture);
    let view = |frame: usize, index: usize| View {
        camera_name: format!("cam{index:02}"),
        camera_index: index,
        frame,
        time: frame as f32 / (frames - 1) as f32,
        camera: camera(index),
        name: format!("cam{index:02}/{frame:04}"),
        ..first.clone()
    };
    let views = (0..frames).flat_map(|frame| (0..CAMERAS).map(move |index| (frame, index)));
    Dataset {
        name: "made".into(),
        root: "made".into(),
        layout: Layout::Rig,
        views: views.map(|(frame, index)| view(frame, index)).collect(),
        points: None,
        n_frames: frames,
        n_cameras: CAMERAS,
        stated_span: None,
        frame_rate: None,
        background: None,
    }
}

/// A scene with the settings of a run that has not begun.
fn scene(trainer: &Trainer, made: Made, device: &Device) -> Result<DynamicScene, Error> {
    let mut rng = generator(11);
    let n_dynamic = made.n * made.moving / 100;
    let config = trainer.config();
    let unit = SIGMA.0 * DISTANCE as f32 / made.size[0] as f32;
    let mut dynamic = rows(n_dynamic, unit, config.sh_degree, &mut rng);
    if config.method.trajectories == Trajectories::Polyline {
        let basis = trainer.run().method.basis;
        dynamic.trajectory_width = 3 * basis.len();
        dynamic.trajectories = trajectories(n_dynamic, basis, &mut rng);
    }
    let deformation = &trainer.run().method.field;
    let space = SpaceBox::around(&dynamic.means, 0.0, 0.0);
    let field = DeformationField::new(deformation, space, &mut rng, device)?;
    let mut settings = trainer.scene().settings.clone();
    (settings.sh_degree, settings.near_plane) = (config.sh_degree, NEAR);
    let still = rows(made.n - n_dynamic, unit, config.sh_degree, &mut rng);
    Ok(DynamicScene {
        static_set: Gaussians::from_rows(&still, device),
        dynamic: (n_dynamic > 0).then(|| DynamicPart {
            gaussians: Gaussians::from_rows(&dynamic, device),
            field,
        }),
        settings,
    })
}

/// Gaussians of a typical standard deviation of `unit`, world units.
fn rows(n: usize, unit: f32, sh_degree: usize, rng: &mut Pcg64) -> GaussianRows {
    let in_ball = |rng: &mut Pcg64| loop {
        let place: [f32; 3] = std::array::from_fn(|_| rng.random_range(-1.0f32..1.0));
        if place.iter().map(|x| x * x).sum::<f32>() <= 1.0 {
            return place.map(|x| RADIUS * x);
        }
    };
    let places: Vec<[f32; 3]> = (0..n).map(|_| in_ball(rng)).collect();
    let colors: Vec<[f32; 3]> = (0..n)
        .map(|_| std::array::from_fn(|_| rng.random_range(0.0f32..1.0)))
        .collect();
    let mut rows = GaussianRows::from_points(&places, &colors, sh_degree, unit);
    for scales in &mut rows.log_scales {
        *scales = std::array::from_fn(|_| unit.ln() + SIGMA.1 * standard_normal::<f32>(rng));
    }
    for quat in &mut rows.quats {
        *quat = std::array::from_fn(|_| standard_normal::<f32>(rng));
    }
    for opacity in &mut rows.opacity_logits {
        *opacity = logit(rng.random_range(0.05..0.95));
    }
    rows.sh_rest
        .fill_with(|| 0.05 * standard_normal::<f32>(rng));
    rows
}

fn trajectories(n: usize, basis: TrajectoryBasis, rng: &mut Pcg64) -> Vec<f32> {
    let step = MOTION / (basis.len() as f32).sqrt();
    (0..n * basis.len() * 3)
        .map(|_| step * standard_normal::<f32>(rng))
        .collect()
}
