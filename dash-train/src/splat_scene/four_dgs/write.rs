//! Writing clips.

use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use std::path::Path;

use dash_model::unfinished::Unfinished;
use dash_model::{DynamicScene, GaussianRows, Gaussians, SH_C0, TimeWindows};
use fourdgs::quantization::{SH_QUANT_HI, SH_QUANT_LO};
use fourdgs::{CoordinateFrame, GaussianSet, Provenance, SceneExtras, WriteOptions};
use glam::{DQuat, DVec3};

use super::fit::{Piece, fit};
use super::grid::{PROFILE, snap};
use super::key;
use crate::Error;

/// Times are whole steps of so many seconds in the file.
const TIME_STEP: f64 = 0.001;
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
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Written {
    /// Static Gaussians. One that several windows of time share counts once.
    pub n_static: usize,
    /// Dynamic Gaussians.
    pub n_dynamic: usize,
    /// Pieces of lines that follow them.
    pub n_pieces: usize,
}

/// Writes scenes as a `.4dgs`, through a sibling scratch file: one of the whole clip, or those of windows of time. At a frame that two
/// windows share, the file has the one with the larger share: files of Gaussians can't mix pictures.
///
/// Values are rounded as the format's profile `fine` does it: positions to a fiftieth of the median size of the Gaussians, colours to 8 bits and
/// into [0, 1].
///
/// # Errors
/// When a scene can't be had or evaluated, or the file can't be written.
///
/// # Panics
/// When there are no frames.
pub fn write_clip(
    path: &Path,
    windows: &TimeWindows,
    scene_of: &dyn Fn(usize) -> Result<DynamicScene, Error>,
    options: &ClipOptions,
) -> Result<Written, Error> {
    assert!(options.n_frames > 0, "a clip has frames");
    let shown = frames_of(windows, options.n_frames);
    let (mut degree, mut near_plane) = (0, f64::INFINITY);
    for &(number, _) in &shown {
        let scene = scene_of(number)?;
        degree = degree.max(scene.static_set.to_rows().sh_degree());
        near_plane = near_plane.min(scene.settings.near_plane);
    }
    let mut clip = Clip::new(degree, options);
    let mut written = Written::default();
    for (number, frames) in shown {
        let scene = scene_of(number)?;
        let still = scene.static_set.to_rows().with_sh_degree(degree);
        let time = |frame: usize| windows.local(number, time_of(frame, options.n_frames));
        let times: Vec<f32> = frames.clone().map(time).collect();
        let dynamic = dynamic_frames(&scene, &times, degree)?;
        let size = diagonal(still.means.iter().chain(&dynamic[0].means));
        let pieces = fit(&dynamic, options.max_error * size);
        written.n_static += clip.push_static(&still, &frames);
        for piece in &pieces {
            clip.push_piece(piece, &dynamic, &frames);
        }
        written.n_dynamic += dynamic[0].len();
        written.n_pieces += pieces.len();
    }
    snap(&mut clip.set);
    let write = WriteOptions {
        profile: PROFILE,
        library: concat!("dash ", env!("CARGO_PKG_VERSION")).into(),
        metadata: BTreeMap::from([
            (key::FRAMES.into(), options.n_frames.to_string()),
            (key::FRAME_RATE.into(), options.frame_rate.to_string()),
            (key::NEAR_PLANE.into(), near_plane.to_string()),
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
    Ok(written)
}

/// The time of a frame, in [0, 1] over the clip.
fn time_of(frame: usize, n_frames: usize) -> f32 {
    let last = n_frames.saturating_sub(1).max(1) as f64;
    (frame as f64 / last) as f32
}

/// The frames of each window that has any.
fn frames_of(windows: &TimeWindows, n_frames: usize) -> Vec<(usize, Range<usize>)> {
    let mut shown: Vec<(usize, Range<usize>)> = Vec::new();
    for frame in 0..n_frames {
        let shares = windows.shares(time_of(frame, n_frames)).into_iter();
        let (number, _) = shares
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .expect("some window shows it");
        match shown.last_mut() {
            Some((last, frames)) if *last == number => frames.end = frame + 1,
            _ => shown.push((number, frame..frame + 1)),
        }
    }
    shown
}

/// The dynamic Gaussians at each time. Higher colours are left out where they are those of the first time.
fn dynamic_frames(
    scene: &DynamicScene,
    times: &[f32],
    sh_degree: usize,
) -> Result<Vec<GaussianRows>, Error> {
    // A scene of one static Gaussian at most: the others need not be copied for each frame.
    let few: Vec<usize> = (0..scene.static_set.len().min(1)).collect();
    let rows = scene.static_set.to_rows().gather(&few);
    let moving = DynamicScene {
        static_set: Gaussians::from_rows(&rows, &scene.static_set.means.device()),
        ..scene.clone()
    };
    let mut frames: Vec<GaussianRows> = Vec::with_capacity(times.len());
    for &time in times {
        let rows = moving.at(time)?;
        let dynamic: Vec<usize> = (few.len()..rows.len()).collect();
        let mut rows = rows.gather(&dynamic).with_sh_degree(sh_degree);
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

/// A file's Gaussians as they come together.
struct Clip {
    set: GaussianSet,
    frame_rate: f64,
    n_frames: usize,
    /// Static Gaussians of the window before, which the next may have, too: their places by the bits of their values.
    shared: HashMap<Vec<u32>, Vec<usize>>,
}

impl Clip {
    fn new(sh_degree: usize, options: &ClipOptions) -> Self {
        let n_coefficients = (sh_degree + 1).pow(2) - 1;
        let set = GaussianSet {
            sh: (n_coefficients > 0).then(Vec::new),
            sh_coefficients: n_coefficients,
            sh_degree: sh_degree as u8,
            ..Default::default()
        };
        Self {
            set,
            frame_rate: options.frame_rate,
            n_frames: options.n_frames,
            shared: HashMap::new(),
        }
    }

    /// From half a frame before the first of some frames to half a frame after the last, seconds; without end at the clip's ends.
    fn window(&self, frames: &Range<usize>) -> [f32; 2] {
        let half_before = |frame: usize| ((frame as f64 - 0.5) / self.frame_rate) as f32;
        let begin = match frames.start {
            0 => f32::NEG_INFINITY,
            first => half_before(first),
        };
        let end = match frames.end {
            end if end == self.n_frames => f32::INFINITY,
            end => half_before(end),
        };
        [begin, end]
    }

    /// The static Gaussians of some frames; how many of them are new in the file. One that the frames before have, too, goes on.
    fn push_static(&mut self, rows: &GaussianRows, frames: &Range<usize>) -> usize {
        let window = self.window(frames);
        let (mut shared, before) = (HashMap::new(), self.set.win_hi.len());
        for row in 0..rows.len() {
            let bits = bits_of(rows, row);
            let place = match self.shared.get_mut(&bits).and_then(Vec::pop) {
                Some(place) => {
                    self.set.win_hi[place] = window[1];
                    place
                }
                None => {
                    self.push_still(rows, row, window);
                    self.set.win_hi.len() - 1
                }
            };
            shared.entry(bits).or_insert_with(Vec::new).push(place);
        }
        self.shared = shared;
        self.set.win_hi.len() - before
    }

    fn push_still(&mut self, rows: &GaussianRows, row: usize, window: [f32; 2]) {
        let [w, x, y, z] = rows.quats[row].map(f64::from);
        self.push(&Moving {
            mean: DVec3::from(rows.means[row].map(f64::from)),
            velocity: DVec3::ZERO,
            rotation: DQuat::from_xyzw(x, y, z, w),
            log_scales: DVec3::from(rows.log_scales[row].map(f64::from)),
            opacity_logit: rows.opacity_logits[row],
            sh_dc: rows.sh_dc[row],
            time: 0.0,
            window,
        });
        let width = rows.sh_rest_width;
        self.push_sh(&rows.sh_rest[row * width..][..width]);
    }

    /// A piece of a path over some frames of the clip.
    fn push_piece(&mut self, piece: &Piece, dynamic: &[GaussianRows], frames: &Range<usize>) {
        let first = frames.start;
        let middle = first as f64 + piece.middle();
        let time = (middle / self.frame_rate / TIME_STEP).round() * TIME_STEP;
        let own = piece.frames.start + first..piece.frames.end + first;
        self.push(&Moving {
            mean: piece.mean_at(time * self.frame_rate - first as f64),
            velocity: piece.velocity * self.frame_rate,
            rotation: piece.rotation,
            log_scales: piece.log_scales,
            opacity_logit: piece.opacity_logit,
            sh_dc: piece.sh_dc,
            time: time as f32,
            window: self.window(&own),
        });
        // Of the piece's middle frame, or of the first, which is the same then.
        let middle = &dynamic[piece.frames.start + piece.frames.len() / 2];
        let width = dynamic[0].sh_rest_width;
        let rest = match middle.sh_rest.is_empty() {
            true => &dynamic[0].sh_rest,
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

/// The bits of a Gaussian's values.
fn bits_of(rows: &GaussianRows, row: usize) -> Vec<u32> {
    let width = rows.sh_rest_width;
    let values = rows.means[row].iter().chain(&rows.quats[row]);
    let values = values.chain(&rows.log_scales[row]).chain(&rows.sh_dc[row]);
    let rest = &rows.sh_rest[row * width..][..width];
    let values = values.chain(rest).chain([&rows.opacity_logits[row]]);
    values.map(|value| value.to_bits()).collect()
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
