//! Writing clips.

use std::collections::BTreeMap;
use std::path::Path;

use dash_model::unfinished::Unfinished;
use dash_model::{DynamicScene, GaussianRows, Gaussians, SH_C0};
use fourdgs::quantization::{
    Bounds, DEFAULT_CUTOFF, Profile, SH_QUANT_HI, SH_QUANT_LO, Steps, dequantize_rotation,
    life_class, motion_step, quantize_rotation, support_k,
};
use fourdgs::{CoordinateFrame, GaussianSet, Provenance, SceneExtras, WriteOptions};
use glam::{DQuat, DVec3};

use super::fit::{Piece, fit};
use super::key;
use crate::Error;

/// Times are whole steps of so many seconds in the file.
const TIME_STEP: f64 = 0.001;
/// How finely values are rounded.
const PROFILE: Profile = Profile::Fine;
/// The outermost share of the Gaussians on either side that says nothing of a scene's size.
const OUTERMOST: f64 = 0.05;
/// Axes by number, as the format has them: x, y, z, -x, -y, -z.
const UP: u8 = 4;
const FORWARD: u8 = 2;
const RIGHT_HANDED: u8 = 1;

/// How a clip is written.
#[derive(Debug, Clone, PartialEq)]
pub struct ClipOptions {
    /// Frames at which the motion is followed, evenly from the clip's start to its end.
    pub n_frames: usize,
    /// Frames per second.
    pub frame_rate: f64,
    /// How far a centre, or an end of an axis, may be off at a frame, as a share of the scene's diagonal.
    pub max_error: f64,
}

/// What was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Written {
    /// Static Gaussians.
    pub n_static: usize,
    /// Dynamic Gaussians.
    pub n_dynamic: usize,
    /// Windows that follow them.
    pub n_windows: usize,
}

/// Writes a scene as a `.4dgs`, through a sibling scratch file.
///
/// Values are rounded as the format's profile `fine` does it: positions to a fiftieth of the median size of the Gaussians, colours to 8 bits and
/// into [0, 1].
///
/// # Errors
/// When the scene can't be evaluated, or the file can't be written.
///
/// # Panics
/// When there are no frames.
pub fn write_clip(
    path: &Path,
    scene: &DynamicScene,
    options: &ClipOptions,
) -> Result<Written, Error> {
    assert!(options.n_frames > 0, "a clip has frames");
    let still = scene.static_set.to_rows();
    let frames = dynamic_frames(scene, options.n_frames)?;
    let size = diagonal(still.means.iter().chain(&frames[0].means));
    let pieces = fit(&frames, options.max_error * size);
    let mut clip = Clip::new(&still, options.frame_rate);
    for row in 0..still.len() {
        clip.push_static(&still, row);
    }
    for piece in &pieces {
        clip.push_piece(piece, &frames, options.n_frames);
    }
    snap(&mut clip.set);
    let write = WriteOptions {
        profile: PROFILE,
        library: concat!("dash ", env!("CARGO_PKG_VERSION")).into(),
        metadata: BTreeMap::from([
            (key::FRAMES.into(), options.n_frames.to_string()),
            (key::FRAME_RATE.into(), options.frame_rate.to_string()),
            (
                key::NEAR_PLANE.into(),
                scene.settings.near_plane.to_string(),
            ),
        ]),
        ..Default::default()
    };
    let extras = SceneExtras {
        provenance: Provenance {
            frames: vec![CoordinateFrame {
                handedness: RIGHT_HANDED,
                up_axis: UP,
                forward_axis: FORWARD,
                ..Default::default()
            }],
            ..Default::default()
        },
        ..Default::default()
    };
    let duration = options.n_frames as f64 / options.frame_rate;
    let bytes = fourdgs::write_to_vec(&clip.set, duration, &write, &extras)
        .map_err(|error| Error::run(path, format!("cannot be written as .4dgs: {error}")))?;
    let io = |error| Error::io(path, "write", error);
    let scratch = Unfinished::file(path).map_err(io)?;
    std::fs::write(scratch.path(), bytes).map_err(io)?;
    scratch
        .finish(|scratch| std::fs::rename(scratch, path))
        .map_err(io)?;
    Ok(Written {
        n_static: still.len(),
        n_dynamic: frames[0].len(),
        n_windows: pieces.len(),
    })
}

/// The dynamic Gaussians at each frame. Higher colours are left out where they are those of the first frame.
fn dynamic_frames(scene: &DynamicScene, n_frames: usize) -> Result<Vec<GaussianRows>, Error> {
    // A scene of one static Gaussian at most: the others need not be copied for each frame.
    let few: Vec<usize> = (0..scene.static_set.len().min(1)).collect();
    let rows = scene.static_set.to_rows().gather(&few);
    let moving = DynamicScene {
        static_set: Gaussians::from_rows(&rows, &scene.static_set.means.device()),
        ..scene.clone()
    };
    let last = n_frames.saturating_sub(1).max(1) as f64;
    let mut frames: Vec<GaussianRows> = Vec::with_capacity(n_frames);
    for frame in 0..n_frames {
        let rows = moving.at((frame as f64 / last) as f32)?;
        let dynamic: Vec<usize> = (few.len()..rows.len()).collect();
        let mut rows = rows.gather(&dynamic);
        if frames
            .first()
            .is_some_and(|first| first.sh_rest == rows.sh_rest)
        {
            rows.sh_rest = Vec::new();
        }
        frames.push(rows);
    }
    Ok(frames)
}

/// The diagonal of the box of points without the outermost on either side, world units.
fn diagonal<'a>(points: impl Iterator<Item = &'a [f32; 3]>) -> f64 {
    let points: Vec<[f32; 3]> = points
        .copied()
        .filter(|p| p.iter().all(|v| v.is_finite()))
        .collect();
    if points.is_empty() {
        return 0.0;
    }
    let outermost = (OUTERMOST * points.len() as f64) as usize;
    let side = |axis: usize| {
        let mut values: Vec<f32> = points.iter().map(|point| point[axis]).collect();
        values.sort_by(f32::total_cmp);
        f64::from(values[values.len() - 1 - outermost]) - f64::from(values[outermost])
    };
    DVec3::new(side(0), side(1), side(2)).length()
}

/// Puts values on the grids that the file has for them.
///
/// The writer refuses a file in which a value is off by more than half a step, and in single precision a value halfway between two
/// steps is off by a little more.
fn snap(set: &mut GaussianSet) {
    let steps_of = |scales: &[f32]| Steps::of(&Bounds::for_profile(PROFILE, median(scales)));
    let put = |value: &mut f32, origin: f64, step: f64| {
        let bin = ((f64::from(*value) - origin) / step).round();
        *value = (origin + bin * step) as f32;
    };
    // These first: the other grids depend on their median.
    let step = steps_of(&set.scales).scale_log;
    for scale in &mut set.scales {
        let mut log = f64::from(*scale).max(1e-30).ln() as f32;
        put(&mut log, 0.0, step);
        *scale = log.exp();
    }
    let steps = steps_of(&set.scales);
    for axis in 0..3 {
        let values = set.positions.iter_mut().skip(axis).step_by(3);
        let mut values: Vec<&mut f32> = values.collect();
        let origin = values.iter().map(|value| f64::from(**value));
        let origin = origin.fold(f64::INFINITY, f64::min);
        values
            .iter_mut()
            .for_each(|value| put(value, origin, steps.pos));
    }
    for rotation in set.rotations.as_chunks_mut::<4>().0 {
        let (largest, bins) = quantize_rotation(rotation.map(f64::from), steps.rot);
        *rotation = dequantize_rotation(largest, &bins, steps.rot);
    }
    for color in set.colors.as_chunks_mut::<4>().0 {
        let (rgb, opacity) = color.split_at_mut(3);
        rgb.iter_mut().for_each(|value| put(value, 0.0, steps.rgb));
        put(&mut opacity[0], 0.0, steps.alpha);
    }
    let cutoff = support_k(DEFAULT_CUTOFF);
    let windows = set.win_lo.iter().zip(&set.win_hi);
    let motions = set.motions.as_chunks_mut::<3>().0.iter_mut();
    for (motion, (lo, hi)) in motions.zip(windows) {
        let length = f64::from(*hi) - f64::from(*lo);
        let class = life_class(0, steps.sigma_log, true, length, cutoff);
        let step = motion_step(class, steps.motion);
        motion.iter_mut().for_each(|value| put(value, 0.0, step));
    }
}

/// The median as the writer takes it.
fn median(values: &[f32]) -> f64 {
    let mut values: Vec<f64> = values.iter().map(|value| f64::from(*value)).collect();
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => 1.0,
        n if n % 2 == 1 => values[middle],
        _ => 0.5 * (values[middle - 1] + values[middle]),
    }
}

/// A file's Gaussians as they come together.
struct Clip {
    set: GaussianSet,
    frame_rate: f64,
}

impl Clip {
    fn new(rows: &GaussianRows, frame_rate: f64) -> Self {
        let n_coefficients = rows.sh_rest_width / 3;
        let set = GaussianSet {
            sh: (n_coefficients > 0).then(Vec::new),
            sh_coefficients: n_coefficients,
            sh_degree: rows.sh_degree() as u8,
            ..Default::default()
        };
        Self { set, frame_rate }
    }

    fn push_static(&mut self, rows: &GaussianRows, row: usize) {
        let [w, x, y, z] = rows.quats[row].map(f64::from);
        self.push(&Moving {
            mean: DVec3::from(rows.means[row].map(f64::from)),
            velocity: DVec3::ZERO,
            rotation: DQuat::from_xyzw(x, y, z, w),
            log_scales: DVec3::from(rows.log_scales[row].map(f64::from)),
            opacity_logit: rows.opacity_logits[row],
            sh_dc: rows.sh_dc[row],
            time: 0.0,
            window: [f32::NEG_INFINITY, f32::INFINITY],
        });
        let width = rows.sh_rest_width;
        self.push_sh(&rows.sh_rest[row * width..][..width]);
    }

    /// A window ends half a frame before the first frame of the next.
    fn push_piece(&mut self, piece: &Piece, frames: &[GaussianRows], n_frames: usize) {
        let seconds = |frame: f64| frame / self.frame_rate;
        let time = (seconds(piece.middle()) / TIME_STEP).round() * TIME_STEP;
        let begin = match piece.frames.start {
            0 => f32::NEG_INFINITY,
            first => seconds(first as f64 - 0.5) as f32,
        };
        let end = match piece.frames.end {
            end if end == n_frames => f32::INFINITY,
            end => seconds(end as f64 - 0.5) as f32,
        };
        self.push(&Moving {
            mean: piece.mean_at(time * self.frame_rate),
            velocity: piece.velocity * self.frame_rate,
            rotation: piece.rotation,
            log_scales: piece.log_scales,
            opacity_logit: piece.opacity_logit,
            sh_dc: piece.sh_dc,
            time: time as f32,
            window: [begin, end],
        });
        // Of the window's middle frame, or of the first, which is the same then.
        let middle = &frames[piece.frames.start + piece.frames.len() / 2];
        let width = frames[0].sh_rest_width;
        let rest = match middle.sh_rest.is_empty() {
            true => &frames[0].sh_rest,
            false => &middle.sh_rest,
        };
        self.push_sh(&rest[piece.row * width..][..width]);
    }

    fn push(&mut self, at: &Moving) {
        let set = &mut self.set;
        let narrow = |values: DVec3| values.to_array().map(|value| value as f32);
        set.positions.extend(narrow(at.mean));
        set.scales.extend(narrow(at.log_scales.exp()));
        let rotation = match at.rotation.length_squared() > 0.0 {
            true => at.rotation.normalize(),
            false => DQuat::IDENTITY,
        };
        set.rotations
            .extend(rotation.to_array().map(|value| value as f32));
        set.colors
            .extend(at.sh_dc.map(|dc| (0.5 + SH_C0 * dc).clamp(0.0, 1.0)));
        set.colors.push(1.0 / (1.0 + (-at.opacity_logit).exp()));
        set.motions.extend(narrow(at.velocity));
        set.mu_t.push(at.time);
        set.sigma_t.push(f32::INFINITY);
        set.win_lo.push(at.window[0]);
        set.win_hi.push(at.window[1]);
    }

    /// Higher colours, coefficients first here, channels first there.
    fn push_sh(&mut self, rest: &[f32]) {
        let Some(sh) = &mut self.set.sh else {
            return;
        };
        let (lo, hi) = (SH_QUANT_LO as f32, SH_QUANT_HI as f32);
        for channel in 0..3 {
            let values = rest.iter().skip(channel).step_by(3);
            sh.extend(values.map(|value| (255.0 * (value - lo) / (hi - lo)).round() as u8));
        }
    }
}

/// A Gaussian of the file.
struct Moving {
    mean: DVec3,
    /// World units a second.
    velocity: DVec3,
    rotation: DQuat,
    log_scales: DVec3,
    opacity_logit: f32,
    sh_dc: [f32; 3],
    /// When it is at `mean`, seconds.
    time: f32,
    /// Seconds.
    window: [f32; 2],
}
