//! What a picture shows of each Gaussian, and the losses that are weighed by it.

use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Tensor, TensorData};
use dash_kernels::Camera;
use dash_kernels::splats::{
    CONIC_A, CONIC_B, CONIC_C, DEPTH, MEAN_X, MEAN_Y, N_COLUMNS, OPACITY, RADIUS_X, RADIUS_Y,
};
use dash_model::Gaussians;
use rayon::prelude::*;

/// Gaussians that a thread takes at least.
const PORTION: usize = 4096;
/// Disparity, in units of the typical one, above which a Gaussian is near.
const NEAR: f64 = 2.0;
/// Most that nearness counts for.
const NEAREST: f64 = 16.0;
/// Motion, in shares of the image's width, with which a Gaussian pays half of what it would at rest for being
/// near.
const AT_REST: f64 = 0.005;

/// What a picture shows of Gaussians. Worked out on the host, in one order: it weighs gradients, which must
/// not depend on how a device sums.
pub struct Coverage {
    /// `[N]`; `None` of what shows nothing.
    drawn: Vec<Option<Drawn>>,
}

/// What a picture shows of a Gaussian.
struct Drawn {
    opacity: f64,
    /// Of the picture, at most all of it; what lies beside it counts.
    share: f64,
    /// How much of the Gaussian lies in the picture.
    inside: f64,
    /// How large a world unit appears there, in shares of the image's width: in proportion to its disparity.
    scale: f64,
}

impl Coverage {
    /// Of packed splats `[N, C]`, read from the device.
    pub(crate) fn of(splats: &[f32], camera: &Camera) -> Self {
        let drawn = splats.par_chunks_exact(N_COLUMNS).with_min_len(PORTION);
        Self {
            drawn: drawn.map(|splat| Drawn::of(splat, camera)).collect(),
        }
    }
}

impl Drawn {
    fn of(splat: &[f32], camera: &Camera) -> Option<Self> {
        let value = |column: usize| f64::from(splat[column]);
        let picture = (camera.width * camera.height) as f64;
        let det = value(CONIC_A) * value(CONIC_C) - value(CONIC_B).powi(2);
        let drawn = Self {
            opacity: value(OPACITY),
            share: (1.0 / det.sqrt() / picture).min(1.0),
            inside: part_inside(value(MEAN_X), value(RADIUS_X), camera.width)
                * part_inside(value(MEAN_Y), value(RADIUS_Y), camera.height),
            scale: camera.fx / camera.width as f64 / value(DEPTH),
        };
        let shown = splat[RADIUS_X] > 0.0 && splat[DEPTH] > 0.0 && det > 0.0;
        let numbers = [drawn.opacity, drawn.scale, drawn.inside];
        (shown && numbers.iter().all(|number| number.is_finite())).then_some(drawn)
    }
}

/// How much of `mean` +- `radius` lies in [0, `size`].
fn part_inside(mean: f64, radius: f64, size: usize) -> f64 {
    let (from, to) = ((mean - radius).max(0.0), (mean + radius).min(size as f64));
    ((to - from) / (2.0 * radius)).clamp(0.0, 1.0)
}

/// Motion `m` on the screen, in shares of the image's width, as `m / (1 + m / far)`, weighed by the share of the picture
/// that each Gaussian covers and by its opacity: a mean over the picture, like the photometric loss. Beyond `far`, more
/// motion costs little more. `extents [N]` in world units.
pub(crate) fn visible_motion(extents: Tensor<1>, cover: &Coverage, far: f32) -> Tensor<1> {
    let (scales, shares) = cover
        .drawn
        .iter()
        .map(|drawn| match drawn {
            Some(drawn) => (drawn.scale as f32, (drawn.opacity * drawn.share) as f32),
            None => (0.0, 0.0),
        })
        .unzip();
    let device = extents.device();
    let motion = extents * column(scales, &device);
    let cost = motion.clone() / (motion / far + 1.0);
    (cost * column(shares, &device)).sum()
}

/// How much of the picture a set covers from nearer than half of the typical distance: the sum over its Gaussians of
/// opacity, times the share of the picture under each, times what the square of its disparity has above that of
/// [`NEAR`] (at most [`NEAREST`]), in units of the mean disparity of what the set covers. `None` of a set of which
/// nothing is drawn. A Gaussian larger than the picture counts by the part of it that lies inside: such are backgrounds.
///
/// A floater between the cameras and the scene, as dark as the background, changes no training picture, but darkens
/// novel views between them. What moves is followed and must stay visible: it pays the less the more its
/// `motion [N]`, in world units (empty: all rest).
///
/// # Gradient
/// To the opacities only.
pub(crate) fn nearness(set: &Gaussians, cover: &Coverage, motion: &[f32]) -> Option<Tensor<1>> {
    let drawn = || cover.drawn.iter().flatten();
    let share = |drawn: &Drawn| drawn.share * drawn.inside;
    let covered: f64 = drawn().map(|d| d.opacity * share(d)).sum();
    let near: f64 = drawn().map(|d| d.opacity * share(d) * d.scale).sum();
    let typical = near / covered;
    if !(typical > 0.0 && typical.is_finite()) {
        return None;
    }
    let weight = |(row, drawn): (usize, &Option<Drawn>)| {
        let Some(drawn) = drawn else {
            return 0.0;
        };
        let near = (drawn.scale / typical).powi(2) - NEAR.powi(2);
        let moved = motion.get(row).map_or(0.0, |&m| f64::from(m) * drawn.scale);
        (share(drawn) * near.clamp(0.0, NEAREST) / (1.0 + moved / AT_REST)) as f32
    };
    let rows = cover.drawn.par_iter().with_min_len(PORTION).enumerate();
    let weights = rows.map(weight).collect();
    let logits = set.opacity_logits.val();
    let weights = column(weights, &logits.device());
    Some((sigmoid(logits) * weights).sum())
}

/// A tensor `[N]`.
fn column(values: Vec<f32>, device: &Device) -> Tensor<1> {
    let n = values.len();
    Tensor::from_data(TensorData::new(values, [n]), device)
}

#[cfg(test)]
mod tests {
    use dash_model::GaussianRows;

    use super::*;
    use crate::train::core::to_host;

    /// Of a picture of 200 pixels; a unit at depth 1 is half its width.
    fn camera() -> Camera {
        Camera::new(10.0, 10.0, 10.0, 5.0, 20, 10)
    }

    /// Opacity, area of one standard deviation in pixels, depth, whether it is drawn.
    type Spot = (f32, f32, f32, bool);

    /// Of a spot in the middle of the picture, one standard deviation wide; the height of the picture is 10.
    fn inside(area: f32) -> f64 {
        let radius = f64::from(area.sqrt());
        (20.0 / (2.0 * radius)).min(1.0) * (10.0 / (2.0 * radius)).min(1.0)
    }

    const SPOTS: [Spot; 6] = [
        (0.9, 40.0, 3.0, true),
        (0.5, 10.0, 6.0, true),
        (0.1, 30.0, 1.0, true),
        // Far nearer than the rest, larger than the picture, not drawn.
        (0.02, 2.0, 0.01, true),
        (0.3, 500.0, 8.0, true),
        (0.7, 90.0, 2.0, false),
    ];

    /// A set of such Gaussians, and the cover of splats with round outlines.
    fn spots(spots: &[Spot], device: &Device) -> (Gaussians, Coverage) {
        let points = vec![[0.0; 3]; spots.len()];
        let mut rows = GaussianRows::from_points(&points, &points, 0, 0.1);
        let mut splats = Vec::new();
        for (logit, &(opacity, area, depth, drawn)) in rows.opacity_logits.iter_mut().zip(spots) {
            *logit = dash_model::logit(opacity);
            let mut splat = [0.0; N_COLUMNS];
            if drawn {
                splat[CONIC_A] = 1.0 / area;
                splat[CONIC_C] = 1.0 / area;
                (splat[MEAN_X], splat[MEAN_Y]) = (10.0, 5.0);
                (splat[RADIUS_X], splat[RADIUS_Y]) = (area.sqrt(), area.sqrt());
                splat[DEPTH] = depth;
                splat[OPACITY] = opacity;
            }
            splats.extend(splat);
        }
        let set = Gaussians::from_rows(&rows, device);
        (set, Coverage::of(&splats, &camera()))
    }

    /// What the spots pay for each unit of opacity, in double precision.
    fn weights(spots: &[Spot], motion: &[f64]) -> Vec<f64> {
        let (mut covered, mut near) = (0.0, 0.0);
        let share = |area: f32| (f64::from(area) / 200.0).min(1.0) * inside(area);
        for &(opacity, area, depth, _) in spots.iter().filter(|spot| spot.3) {
            covered += f64::from(opacity) * share(area);
            near += f64::from(opacity) * share(area) / f64::from(depth);
        }
        let weight = |(&(_, area, depth, drawn), moved): (&Spot, &f64)| {
            let ratio = covered / near / f64::from(depth);
            let excess = (ratio * ratio - 4.0).clamp(0.0, 16.0);
            let on_screen = 0.5 * moved / f64::from(depth);
            let part = 0.005 / (0.005 + on_screen);
            if drawn {
                share(area) * excess * part
            } else {
                0.0
            }
        };
        spots.iter().zip(motion).map(weight).collect()
    }

    fn value(cost: Option<Tensor<1>>) -> f64 {
        f64::from(to_host(cost.expect("some are drawn"))[0])
    }

    #[test]
    fn cover_costs_by_how_near_it_is() {
        let device = Device::flex().autodiff();
        let (set, cover) = spots(&SPOTS, &device);
        // In order: at rest, half of the cost, moves, hardly moves, far, hidden.
        let moving = [0.0, 0.06, 0.2, 1e-4, 2.0, 9.0f32];
        for motion in [&[][..], &moving] {
            let moved: Vec<f64> = (0..SPOTS.len())
                .map(|k| motion.get(k).map_or(0.0, |&m| f64::from(m)))
                .collect();
            let weights = weights(&SPOTS, &moved);
            let cost = nearness(&set, &cover, motion);
            let each = SPOTS.iter().zip(&weights);
            let expected: f64 = each.map(|(spot, w)| f64::from(spot.0) * w).sum();
            let found = value(cost.clone());
            assert!((found / expected - 1.0).abs() < 1e-5, "{found} {expected}");

            // What is nearer than half of the typical distance, 2.4, pays for its cover, the rest nothing.
            let gradients = cost.expect("drawn").backward();
            let logits = set.opacity_logits.val();
            let slopes = Tensor::<1>::from_inner(logits.grad(&gradients).expect("of logits"));
            for (k, slope) in to_host(slopes).into_iter().enumerate() {
                // Where the cover is weighed stays as it is: a gradient to the opacities only.
                let at = |by: f32| {
                    let mut rows = set.to_rows();
                    rows.opacity_logits[k] += by;
                    let nudged = Gaussians::from_rows(&rows, &device);
                    value(nearness(&nudged, &cover, motion))
                };
                let difference = (at(1e-2) - at(-1e-2)) / 2e-2;
                let error = (f64::from(slope) - difference).abs();
                assert!(
                    error < 1e-3 * f64::from(slope.abs()) + 5e-6,
                    "{k}: {slope} {difference}"
                );
                let near = SPOTS[k].3 && SPOTS[k].2 < 1.2;
                assert_eq!(slope > 0.0, near, "{k}: {slope}");
            }
        }
    }

    #[test]
    fn nearness_is_half_the_cost_where_something_moves_a_little() {
        let device = Device::flex();
        let (set, cover) = spots(&SPOTS[..3], &device);
        // Only the third is much nearer than typical, and at depth 1: a unit is half of the picture's width.
        let at_rest = value(nearness(&set, &cover, &[]));
        let moves = value(nearness(&set, &cover, &[0.0, 0.0, 0.01]));
        let rest = value(nearness(&set, &cover, &[0.0, 0.0, 1e9]));
        assert!(at_rest > 0.0 && rest < 1e-6 * at_rest);
        assert!((moves / at_rest - 0.5).abs() < 1e-5, "{moves} {at_rest}");
    }

    #[test]
    fn nearness_is_the_same_in_other_units() {
        let device = Device::flex();
        let cost = |unit: f32| {
            let spots_in = SPOTS.map(|(o, area, depth, drawn)| (o, area, unit * depth, drawn));
            let (set, cover) = spots(&spots_in, &device);
            value(nearness(&set, &cover, &[]))
        };
        assert!((cost(39.4) / cost(1.0) - 1.0).abs() < 1e-5);
    }

    #[test]
    fn what_lies_beside_the_picture_covers_nothing() {
        let device = Device::flex();
        // A far one, and one near: within the picture, by half, in a corner by a quarter, beside it.
        let cost_of = |place: [f32; 2], wide: f32| {
            let mut splats = [[0.0; N_COLUMNS]; 2];
            let places = [([10.0, 5.0], 9.0, 1.0), (place, 1.0, wide)];
            for (splat, (mean, depth, wide)) in splats.iter_mut().zip(places) {
                (splat[CONIC_A], splat[CONIC_C]) = (wide.powi(-2), wide.powi(-2));
                (splat[MEAN_X], splat[MEAN_Y]) = mean.into();
                (splat[RADIUS_X], splat[RADIUS_Y]) = (2.0 * wide, 3.0 * wide);
                (splat[DEPTH], splat[OPACITY]) = (depth, [0.9, 0.001][usize::from(depth < 2.0)]);
            }
            let set = spots(&[(0.9, 1.0, 9.0, true), (0.001, 1.0, 1.0, true)], &device).0;
            value(nearness(
                &set,
                &Coverage::of(&splats.concat(), &camera()),
                &[],
            ))
        };
        let cost = |place: [f32; 2]| cost_of(place, 1.0);
        let whole = cost([4.0, 4.0]);
        assert!(whole > 0.0);
        for (place, part) in [
            ([0.0, 4.0], 0.5),
            ([20.0, 10.0], 0.25),
            ([4.0, 12.0], 1.0 / 6.0),
        ] {
            assert!((cost(place) / whole - part).abs() < 1e-3, "{place:?}");
        }
        for beside in [[-2.0, 5.0], [23.0, 5.0], [4.0, -3.5], [4.0, 99.0]] {
            assert_eq!(cost(beside), 0.0, "{beside:?}");
        }
        // Twice as wide as one that is as large as the picture: a quarter of it lies within.
        let ratio = cost_of([4.0, 4.0], 2e3) / cost_of([4.0, 4.0], 1e3);
        assert!((ratio - 0.25).abs() < 1e-3, "{ratio}");
    }

    #[test]
    fn nothing_drawn_covers_nothing() {
        let device = Device::flex().autodiff();
        for hidden in [&[][..], &[(0.7, 90.0, 2.0, false)]] {
            let (set, cover) = spots(hidden, &device);
            assert!(nearness(&set, &cover, &[]).is_none());
        }
    }

    #[test]
    fn visible_motion_is_a_mean_over_the_picture_and_saturates() {
        let device = Device::flex();
        // An area of 4 pixels, of 200. The last two are not drawn.
        let pale = [(2.0, true), (4.0, true), (0.0, true), (2.0, false)];
        let pale = pale.map(|(depth, drawn)| (0.5, 4.0, depth, drawn));
        let (_, cover) = spots(&pale, &device);
        let cost = |extents: [f32; 4], far| {
            let extents = Tensor::<1>::from_data(extents, &device);
            to_host(visible_motion(extents, &cover, far))[0]
        };
        let far = 0.05;
        // Half opaque, each covers 2 / 200; a unit is 1 / 4 and 1 / 8 of the width.
        let half = 0.05 / 2.0;
        assert!((cost([0.2, 0.0, 9.0, 9.0], far) - 0.01 * half).abs() < 1e-8);
        assert!((cost([0.2, 0.4, 9.0, 9.0], far) - 0.02 * half).abs() < 1e-8);
        assert!(cost([1e6, 1e6, 0.0, 0.0], far) < 0.02 * 0.0501);
        assert_eq!(cost([0.0; 4], far), 0.0);
        // Larger than the picture: as if it covered all of it.
        let (_, vast) = spots(&[(0.5, 900.0, 2.0, true)], &device);
        let moved = Tensor::<1>::from_data([0.2], &device);
        let all = to_host(visible_motion(moved, &vast, far))[0];
        assert!((all - 0.5 * half).abs() < 1e-7, "{all}");
        // Nearly straight.
        assert!((cost([0.2, 0.8, 9.0, 9.0], 1e6) - 0.01 * 0.15).abs() < 1e-8);
    }
}
