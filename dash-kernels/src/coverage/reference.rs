//! Costs by coverage in f64, straight from their definition.

use super::{AT_REST, FloaterWeights, NEAR, NEAREST, PictureSize};
use crate::splats::{
    CONIC_A, CONIC_B, CONIC_C, DEPTH, MEAN_X, MEAN_Y, N_COLUMNS, OPACITY, RADIUS_X, RADIUS_Y,
};

/// What a picture shows of a Gaussian.
struct Drawn {
    opacity: f64,
    /// Of the picture, at most all of it; what lies beside it counts.
    share: f64,
    /// How much of the Gaussian lies in the picture.
    inside: f64,
    /// How large a world unit appears there, in shares of the picture's width.
    scale: f64,
}

/// `None` of a splat that is not drawn.
fn drawn(splat: &[f64], picture: PictureSize) -> Option<Drawn> {
    let [width, height, focal] = [picture.width, picture.height, picture.focal].map(f64::from);
    let part_inside = |mean: f64, radius: f64, size: f64| {
        let (from, to) = ((mean - radius).max(0.0), (mean + radius).min(size));
        ((to - from) / (2.0 * radius)).clamp(0.0, 1.0)
    };
    let det = splat[CONIC_A] * splat[CONIC_C] - splat[CONIC_B] * splat[CONIC_B];
    let shown = splat[RADIUS_X] > 0.0 && splat[DEPTH] > 0.0 && det > 0.0;
    shown.then(|| Drawn {
        opacity: splat[OPACITY],
        share: (1.0 / det.sqrt() / (width * height)).min(1.0),
        inside: part_inside(splat[MEAN_X], splat[RADIUS_X], width)
            * part_inside(splat[MEAN_Y], splat[RADIUS_Y], height),
        scale: focal / splat[DEPTH],
    })
}

/// The cost and its gradient to the extents. See [`visible_motion`](super::visible_motion).
pub fn visible_motion(
    extents: &[f64],
    splats: &[f64],
    picture: PictureSize,
    far: f64,
) -> (f64, Vec<f64>) {
    let mut cost = 0.0;
    let rows = extents.iter().zip(splats.chunks_exact(N_COLUMNS));
    let gradient = rows.map(|(extent, splat)| {
        let Some(drawn) = drawn(splat, picture) else {
            return 0.0;
        };
        let weight = drawn.opacity * drawn.share;
        let motion = extent * drawn.scale;
        cost += weight * motion / (1.0 + motion / far);
        weight * drawn.scale / (1.0 + motion / far).powi(2)
    });
    let gradient = gradient.collect();
    (cost, gradient)
}

/// The cost and its gradient to the logits. See [`floater_cost`](super::floater_cost).
pub fn floater_cost(
    opacity_logits: &[f64],
    splats: &[f64],
    motion: &[f64],
    picture: PictureSize,
    weights: FloaterWeights,
) -> (f64, Vec<f64>) {
    let splats = splats.chunks_exact(N_COLUMNS);
    let drawn: Vec<_> = splats.map(|splat| drawn(splat, picture)).collect();
    let covered = |d: &Drawn| d.opacity * d.share * d.inside;
    let all: f64 = drawn.iter().flatten().map(covered).sum();
    let near: f64 = drawn.iter().flatten().map(|d| covered(d) * d.scale).sum();
    let nearness = |drawn: &Drawn, motion: f64| {
        let typical = near / all;
        let near = (drawn.scale / typical).powi(2) - f64::from(NEAR).powi(2);
        let rests = 1.0 / (1.0 + motion * drawn.scale / f64::from(AT_REST));
        drawn.share * drawn.inside * near.clamp(0.0, f64::from(NEAREST)) * rests
    };
    let share = f64::from(weights.opacity) / opacity_logits.len() as f64;
    let mut cost = 0.0;
    let rows = opacity_logits.iter().zip(motion).zip(&drawn);
    let gradient = rows.map(|((logit, &motion), drawn)| {
        let near = match drawn {
            Some(drawn) if all > 0.0 => nearness(drawn, motion),
            _ => 0.0,
        };
        let weight = share + f64::from(weights.nearness) * near;
        let opacity = 1.0 / (1.0 + (-logit).exp());
        cost += opacity * weight;
        opacity * (1.0 - opacity) * weight
    });
    let gradient = gradient.collect();
    (cost, gradient)
}
