//! Paths of Gaussians as windows of linear motion.

use std::ops::Range;

use dash_model::GaussianRows;
use glam::{DQuat, DVec3};
use rayon::prelude::*;

/// Difference of an opacity or a colour that shows: one level of 8 bits.
const LEVEL: f64 = 1.0 / 255.0;

/// A Gaussian over a window of frames: its centre moves along a line, all else stays.
#[derive(Debug, Clone, PartialEq)]
pub struct Piece {
    /// The Gaussian.
    pub row: usize,
    /// The frames of the window.
    pub frames: Range<usize>,
    /// The centre in the middle of the window, `(frames.start + frames.end - 1) / 2`, world units.
    pub mean: DVec3,
    /// Its change from one frame to the next, world units.
    pub velocity: DVec3,
    /// The rotation.
    pub rotation: DQuat,
    /// Logarithms of the standard deviations, world units.
    pub log_scales: DVec3,
    /// The opacity before the sigmoid.
    pub opacity_logit: f32,
    /// The constant colour coefficients.
    pub sh_dc: [f32; 3],
}

/// A Gaussian at one frame.
#[derive(Debug, Clone, Copy)]
struct Pose {
    mean: DVec3,
    rotation: DQuat,
    log_scales: DVec3,
    opacity_logit: f32,
    sh_dc: [f32; 3],
}

/// Cuts the paths of Gaussians, given at each frame, into as few windows as halving finds.
///
/// In each window, at each of its frames, no centre and no end of an axis (of one standard deviation) is off by more than `max_error` world
/// units, and no opacity or colour by more than a level of 8 bits. A window of one frame is exact. Windows are those of a clip
/// that is halved again and again, so that many Gaussians share them.
///
/// # Panics
/// When the frames have different numbers of Gaussians.
pub fn fit(frames: &[GaussianRows], max_error: f64) -> Vec<Piece> {
    let n = frames.first().map_or(0, GaussianRows::len);
    assert!(frames.iter().all(|rows| rows.len() == n), "rows differ");
    let of_row = |row: usize| {
        let path: Vec<Pose> = frames.iter().map(|rows| Pose::of(rows, row)).collect();
        let mut pieces = Vec::new();
        cut(row, &path, 0..path.len(), max_error, &mut pieces);
        pieces
    };
    let pieces: Vec<Vec<Piece>> = (0..n).into_par_iter().map(of_row).collect();
    pieces.concat()
}

fn cut(row: usize, path: &[Pose], frames: Range<usize>, max_error: f64, out: &mut Vec<Piece>) {
    if frames.is_empty() {
        return;
    }
    let piece = Piece::of(row, path, frames.clone());
    if frames.len() == 1 || piece.fits(path, max_error) {
        out.push(piece);
        return;
    }
    let middle = frames.start + frames.len() / 2;
    cut(row, path, frames.start..middle, max_error, out);
    cut(row, path, middle..frames.end, max_error, out);
}

impl Pose {
    fn of(rows: &GaussianRows, row: usize) -> Self {
        let [w, x, y, z] = rows.quats[row].map(f64::from);
        let rotation = DQuat::from_xyzw(x, y, z, w);
        Self {
            mean: DVec3::from(rows.means[row].map(f64::from)),
            // Rotations of length 0 mean none.
            rotation: match rotation.length_squared() > 0.0 {
                true => rotation.normalize(),
                false => DQuat::IDENTITY,
            },
            log_scales: DVec3::from(rows.log_scales[row].map(f64::from)),
            opacity_logit: rows.opacity_logits[row],
            sh_dc: rows.sh_dc[row],
        }
    }

    /// From the centre to the ends of the axes.
    fn axes(rotation: DQuat, log_scales: DVec3) -> [DVec3; 3] {
        let scales = log_scales.exp();
        [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| rotation * (axis * scales))
    }
}

impl Piece {
    fn of(row: usize, path: &[Pose], frames: Range<usize>) -> Self {
        let n = frames.len() as f64;
        let own = &path[frames.clone()];
        let first = own[0];
        let middle = 0.5 * (n - 1.0);
        let mean = own.iter().map(|pose| pose.mean).sum::<DVec3>() / n;
        let offsets = (0..own.len()).map(|k| k as f64 - middle);
        let spread: f64 = offsets.clone().map(|t| t * t).sum();
        let velocity = match own.len() {
            // Between frames it goes on as from the one before to the one after.
            1 => {
                let before = frames.start.saturating_sub(1);
                let after = (frames.end).min(path.len() - 1);
                let span = (after - before).max(1) as f64;
                (path[after].mean - path[before].mean) / span
            }
            _ => {
                let moments = offsets.zip(own).map(|(t, pose)| t * pose.mean);
                moments.sum::<DVec3>() / spread
            }
        };
        // Both signs are one rotation.
        let aligned = own
            .iter()
            .map(|pose| match pose.rotation.dot(first.rotation) {
                dot if dot < 0.0 => -pose.rotation,
                _ => pose.rotation,
            });
        let rotation = aligned.fold(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), |sum, q| sum + q);
        let mean_of = |value: &dyn Fn(&Pose) -> f32| {
            let sum: f64 = own.iter().map(|pose| f64::from(value(pose))).sum();
            (sum / n) as f32
        };
        Self {
            row,
            frames,
            mean,
            velocity,
            rotation: rotation.normalize(),
            log_scales: own.iter().map(|pose| pose.log_scales).sum::<DVec3>() / n,
            opacity_logit: mean_of(&|pose| pose.opacity_logit),
            sh_dc: std::array::from_fn(|channel| mean_of(&|pose| pose.sh_dc[channel])),
        }
    }

    /// The centre so many frames after the clip's start.
    pub fn mean_at(&self, frame: f64) -> DVec3 {
        self.mean + self.velocity * (frame - self.middle())
    }

    /// The middle of the window, frames after the clip's start.
    pub fn middle(&self) -> f64 {
        0.5 * (self.frames.start + self.frames.end - 1) as f64
    }

    fn fits(&self, path: &[Pose], max_error: f64) -> bool {
        let own = Pose::axes(self.rotation, self.log_scales);
        self.frames.clone().all(|frame| {
            let pose = &path[frame];
            let axes = Pose::axes(pose.rotation, pose.log_scales);
            let off = own
                .iter()
                .zip(axes)
                .map(|(a, b)| a.distance(b).min(a.distance(-b)));
            let off = off.fold(0.0, f64::max);
            let moved = self.mean_at(frame as f64).distance(pose.mean);
            off.max(moved) <= max_error && self.looks_as(pose)
        })
    }

    fn looks_as(&self, pose: &Pose) -> bool {
        let opacity = |logit: f32| 1.0 / (1.0 + f64::from(-logit).exp());
        let near = |a: f64, b: f64| (a - b).abs() <= LEVEL;
        let colors = self.sh_dc.iter().zip(pose.sh_dc);
        near(opacity(self.opacity_logit), opacity(pose.opacity_logit))
            && colors.into_iter().all(|(a, b)| {
                let level = f64::from(dash_model::SH_C0);
                near(f64::from(*a) * level, f64::from(b) * level)
            })
    }
}
