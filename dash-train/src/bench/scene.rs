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

use super::{Asked, Bench, Measurement, Op, Pass, Target, generator, time};
use crate::Error;
use crate::dataset::{Dataset, Layout, View};
use crate::numbers::standard_normal;
use crate::train::paper::Trajectories;
use crate::train::{Keep, Preset, TrainConfig, Trainer};

/// Pixels of a picture: Neural 3D Video's at half size.
const SIZE: [usize; 2] = [1352, 1014];
/// Pixels of the pictures that a run is set up with.
const SMALL: [usize; 2] = [32, 24];
/// One Gaussian of so many moves.
const ONE_IN: usize = 5;
const CAMERAS: usize = 5;
/// Frames of the clip: 10 s of Neural 3D Video.
const FRAMES: usize = 300;
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

pub(super) fn measure(bench: &mut Bench, target: Target, n: usize) -> Result<(), Error> {
    for (preset, variant) in PRESETS {
        let mut config = TrainConfig::preset(preset);
        (config.sh_degree, config.sh_interval) = (3, 0.0);
        config.keep(Keep::All);
        let mut trainer = Trainer::new(config, Arc::new(clip(SMALL)), target.device)?;
        let dataset = Arc::new(clip(SIZE));
        let still = scene(&trainer, n, target.device)?;
        let mut turn = 0;
        let pictures = time(Some(target.device), || {
            turn += STRIDE;
            let view = &dataset.views[turn % dataset.views.len()];
            still.render(&view.camera, view.time)?;
            Ok(())
        })?;
        let (shown, asked) = counts::of(|| still.render(&dataset.views[0].camera, 0.5));
        shown?;
        bench.add(Measurement {
            time: Some(pictures),
            asked: Some(Asked::of(&asked, 1)),
            note: Some(NOTE.into()),
            ..target.measurement(Op::Scene, variant, Pass::Forward, n)
        });
        let learning = scene(&trainer, n, &target.device.clone().autodiff())?;
        trainer.run.continue_with(learning, dataset);
        let steps = time(Some(target.device), || match trainer.step()?.n_skipped {
            0 => Ok(()),
            _ => Err(Error::DeviceFault(
                "a step of training a sound scene was not finite".into(),
            )),
        })?;
        let (stepped, asked) =
            counts::of(|| (0..COUNTED).try_for_each(|_| trainer.step().map(|_| ())));
        stepped?;
        bench.add(Measurement {
            time: Some(steps),
            asked: Some(Asked::of(&asked, COUNTED)),
            note: Some(NOTE.into()),
            ..target.measurement(Op::Scene, variant, Pass::Gradient, n)
        });
    }
    Ok(())
}

/// Cameras on a half circle, each with a picture at every frame; all of them are one grey picture.
fn clip(size: [usize; 2]) -> Dataset {
    let [width, height] = size;
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
        time: frame as f32 / (FRAMES - 1) as f32,
        camera: camera(index),
        name: format!("cam{index:02}/{frame:04}"),
        ..first.clone()
    };
    let views = (0..FRAMES).flat_map(|frame| (0..CAMERAS).map(move |index| (frame, index)));
    Dataset {
        name: "made".into(),
        root: "made".into(),
        layout: Layout::Rig,
        views: views.map(|(frame, index)| view(frame, index)).collect(),
        points: None,
        n_frames: FRAMES,
        n_cameras: CAMERAS,
        stated_span: None,
        background: None,
    }
}

/// A scene of `n` Gaussians with the settings of a run that has not begun.
fn scene(trainer: &Trainer, n: usize, device: &Device) -> Result<DynamicScene, Error> {
    let mut rng = generator(11);
    let n_dynamic = n / ONE_IN;
    let config = trainer.config();
    let mut dynamic = rows(n_dynamic, config.sh_degree, &mut rng);
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
    Ok(DynamicScene {
        static_set: Gaussians::from_rows(&rows(n - n_dynamic, config.sh_degree, &mut rng), device),
        dynamic: (n_dynamic > 0).then(|| DynamicPart {
            gaussians: Gaussians::from_rows(&dynamic, device),
            field,
        }),
        settings,
    })
}

fn rows(n: usize, sh_degree: usize, rng: &mut Pcg64) -> GaussianRows {
    let (sigma, spread) = SIGMA;
    let unit = sigma * DISTANCE as f32 / SIZE[0] as f32;
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
        *scales = std::array::from_fn(|_| unit.ln() + spread * standard_normal::<f32>(rng));
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
