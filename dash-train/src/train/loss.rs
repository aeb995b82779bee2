//! The losses of Eqs. 6, 11 and 12.

use burn::tensor::activation::sigmoid;
use burn::tensor::{Int, Tensor, TensorData};
use dash_kernels::splats::{CONIC_A, CONIC_B, CONIC_C, DEPTH, N_COLUMNS, OPACITY, RADIUS_X};
use dash_kernels::ssim::ssim;
use dash_kernels::{Camera, KernelError};
use dash_model::{DynamicPart, Gaussians, ModelError, SpaceBox};
use rand::Rng;

use super::optimizer::to_host;

/// Most that nearness counts for.
const NEAREST: f64 = 16.0;
/// Motion, in shares of the image's width, with which a Gaussian pays half of what it would at rest for being
/// near.
const AT_REST: f64 = 0.005;

/// `(1 - lambda_c) L1 + lambda_c (1 - SSIM)` of two images `[H, W, 3]`.
pub(crate) fn photometric(
    image: Tensor<3>,
    target: Tensor<3>,
    dssim: f32,
) -> Result<Tensor<1>, KernelError> {
    let l1 = (image.clone() - target.clone()).abs().mean();
    if dssim == 0.0 {
        return Ok(l1);
    }
    let similarity = ssim(image, target)?.mean();
    Ok(l1 * (1.0 - dssim) + (-similarity + 1.0) * dssim)
}

/// Image and target `[H, W, 3]`, both black where `counted [H * W]` is zero: what is there changes
/// neither the loss nor any gradient.
pub(crate) fn where_counted(
    image: Tensor<3>,
    target: Tensor<3>,
    counted: Vec<f32>,
) -> (Tensor<3>, Tensor<3>) {
    let [height, width, _] = image.dims();
    let counted = TensorData::new(counted, [height, width, 1]);
    let counted = Tensor::<3>::from_data(counted, &image.device());
    (image * counted.clone(), target * counted)
}

/// Eq. 5: mean motion of the static Gaussians, in units of the space's diagonal.
/// `extents [N]`, `is_static [N]` of 0 and 1; zero when none is static.
pub(crate) fn static_motion(extents: Tensor<1>, is_static: &[bool], space: &SpaceBox) -> Tensor<1> {
    let count = is_static.iter().filter(|s| **s).count().max(1);
    let weight = 1.0 / (count as f32 * space.diagonal());
    let weights: Vec<f32> = is_static
        .iter()
        .map(|&s| if s { weight } else { 0.0 })
        .collect();
    let n = weights.len();
    let weights = Tensor::<1>::from_data(TensorData::new(weights, [n]), &extents.device());
    (extents * weights).sum()
}

/// Motion `m` on the screen, in shares of the image's width, as `m / (1 + m / far)` (however far, a
/// thing moves or rests), each Gaussian's by the share of the picture that it covers (with its
/// opacity, and at most all of it). Like the photometric loss this is a mean over the picture: what
/// covers little costs and gains little.
/// `extents [N]` in world units, `splats [N, C]` as projected.
pub(crate) fn visible_motion(
    extents: Tensor<1>,
    splats: &Tensor<2>,
    camera: &Camera,
    far: f32,
) -> Tensor<1> {
    let picture = (camera.width * camera.height) as f32;
    let focal = (camera.fx / camera.width as f64) as f32;
    let (scales, shares): (Vec<f32>, Vec<f32>) = to_host(splats.clone())
        .chunks_exact(N_COLUMNS)
        .map(|splat| {
            let det = splat[CONIC_A] * splat[CONIC_C] - splat[CONIC_B].powi(2);
            let area = splat[OPACITY] / det.sqrt();
            let drawn = splat[RADIUS_X] > 0.0 && splat[DEPTH] > 0.0 && area.is_finite();
            if drawn {
                (focal / splat[DEPTH], (area / picture).min(1.0))
            } else {
                (0.0, 0.0)
            }
        })
        .unzip();
    let device = extents.device();
    let column = |values: Vec<f32>| {
        let n = values.len();
        Tensor::<1>::from_data(TensorData::new(values, [n]), &device)
    };
    let motion = extents * column(scales);
    let cost = motion.clone() / (motion / far + 1.0);
    (cost * column(shares)).sum()
}

/// Mean opacity of a set; `None` of an empty one, which has no mean.
pub(crate) fn opacity(set: &Gaussians) -> Option<Tensor<1>> {
    (!set.is_empty()).then(|| sigmoid(set.opacity_logits.val()).mean())
}

/// How much of the picture a set covers from nearer than is typical: the sum of opacity times the share of
/// the picture under a Gaussian (at most all of it) times what the square of its disparity has above 1 (at
/// most [`NEAREST`]), in units of the mean disparity of what the set covers. Like the photometric loss this
/// is a mean over the picture. `None` of a set of which nothing is drawn.
///
/// What hangs between the cameras and the scene, as dark as what is behind it, changes no training picture,
/// but darkens those of cameras between them. What moves is followed and must stay in sight: it pays the less
/// the more its `motion [N]`, in world units. Gradient to the opacities only. `splats [N, C]` as projected.
pub(crate) fn nearness(
    set: &Gaussians,
    splats: &Tensor<2>,
    motion: Option<Tensor<1>>,
    camera: &Camera,
) -> Option<Tensor<1>> {
    if set.is_empty() {
        return None;
    }
    // On the host, in one order: the mean disparity enters every gradient, and must not depend on how a
    // device sums.
    let picture = (camera.width * camera.height) as f64;
    let drawn: Vec<Option<Drawn>> = to_host(splats.clone())
        .chunks_exact(N_COLUMNS)
        .map(|splat| Drawn::of(splat, picture))
        .collect();
    let covered = drawn.iter().flatten().map(|d| d.opacity * d.share);
    let near = drawn.iter().flatten();
    let near = near.map(|d| d.opacity * d.share * d.disparity);
    let typical = near.sum::<f64>() / covered.sum::<f64>();
    if !(typical > 0.0 && typical.is_finite()) {
        return None;
    }
    let motion = motion.map_or_else(|| vec![0.0; drawn.len()], to_host);
    let focal = camera.fx / camera.width as f64;
    let weights: Vec<f32> = drawn
        .iter()
        .zip(motion)
        .map(|(drawn, motion)| {
            let Some(drawn) = drawn else {
                return 0.0;
            };
            let near = (drawn.disparity / typical).powi(2) - 1.0;
            let moved = f64::from(motion) * drawn.disparity * focal;
            (drawn.share * near.clamp(0.0, NEAREST) / (1.0 + moved / AT_REST)) as f32
        })
        .collect();
    let logits = set.opacity_logits.val();
    let weights = TensorData::new(weights, [drawn.len()]);
    let weights = Tensor::<1>::from_data(weights, &logits.device());
    Some((sigmoid(logits) * weights).sum())
}

/// What a picture shows of a Gaussian.
struct Drawn {
    opacity: f64,
    /// Of the picture, at most all of it.
    share: f64,
    /// One over the depth.
    disparity: f64,
}

impl Drawn {
    /// Of a packed splat in a picture of so many pixels; `None` if it shows nothing.
    fn of(splat: &[f32], picture: f64) -> Option<Self> {
        let value = |column: usize| f64::from(splat[column]);
        let det = value(CONIC_A) * value(CONIC_C) - value(CONIC_B).powi(2);
        let drawn = Self {
            opacity: value(OPACITY),
            share: (1.0 / det.sqrt() / picture).min(1.0),
            disparity: 1.0 / value(DEPTH),
        };
        let shown = splat[RADIUS_X] > 0.0 && splat[DEPTH] > 0.0 && det > 0.0;
        (shown && drawn.opacity.is_finite() && drawn.disparity.is_finite()).then_some(drawn)
    }
}

/// Eq. 11: mean over Gaussians of the squared distance between the field's features at a point
/// and at a small random step from it. Of the Gaussians, a `share` drawn anew at every call: its mean is
/// that of all on average.
pub(crate) fn smoothness(
    dynamic: &DynamicPart,
    time: f32,
    share: f32,
    step: [f32; 2],
    rng: &mut impl Rng,
) -> Result<Tensor<1>, ModelError> {
    let (field, gaussians) = (&dynamic.field, &dynamic.gaussians);
    let all = gaussians.len();
    let n = ((share * all as f32).ceil() as usize).min(all);
    let device = gaussians.means.val().device();
    let drawn = (n < all).then(|| {
        let mut drawn: Vec<i32> = rand::seq::index::sample(rng, all, n)
            .into_iter()
            .map(|row| row as i32)
            .collect();
        drawn.sort_unstable();
        Tensor::<1, Int>::from_data(TensorData::new(drawn, [n]), &device)
    });
    let of_drawn = |rows: Tensor<2>| match &drawn {
        Some(drawn) => rows.select(0, drawn.clone()),
        None => rows,
    };
    let embeddings = || gaussians.embeddings.as_ref().map(|e| of_drawn(e.val()));
    let unit = field
        .space()
        .normalize(of_drawn(gaussians.means.val().detach()));
    let points = Tensor::cat(vec![unit, Tensor::full([n, 1], time, &device)], 1);
    let steps: Vec<f32> = (0..4 * n)
        .map(|i| {
            let half_width = if i % 4 == 3 { step[1] } else { step[0] };
            (rng.random::<f32>() * 2.0 - 1.0) * half_width
        })
        .collect();
    let steps = Tensor::<2>::from_data(TensorData::new(steps, [n, 4]), &device);
    let nearby = (points.clone() + steps).clamp(0.0, 1.0);
    let difference =
        field.features_at(points, embeddings())? - field.features_at(nearby, embeddings())?;
    Ok(difference.powi_scalar(2).sum() / n.max(1) as f32)
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use dash_model::{DeformationField, GaussianRows};
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;
    use crate::train::{Preset, TrainConfig};

    #[test]
    fn smoothness_of_a_share_is_that_of_all_on_average() {
        const N: usize = 101;
        const DRAWS: usize = 300;
        let device = Device::flex();
        let config = TrainConfig::preset(Preset::Quick).for_frames(8);
        let space = SpaceBox::fixed(1.0);
        let mut rng = Pcg64::seed_from_u64(3);
        let field = DeformationField::new(&config.field.deformation, space, &mut rng, &device)
            .expect("valid");
        let points: Vec<[f32; 3]> = (0..N)
            .map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
            .collect();
        let rows = GaussianRows::from_points(&points, &points, 0, 0.1);
        let dynamic = DynamicPart {
            gaussians: Gaussians::from_rows(&rows, &device),
            field,
        };
        let mut mean_of = |share: f32| {
            let terms = (0..DRAWS).map(|k| {
                let time = k as f32 / DRAWS as f32;
                let term = smoothness(&dynamic, time, share, [5e-3, 1e-4], &mut rng);
                f64::from(to_host(term.expect("valid"))[0])
            });
            terms.sum::<f64>() / DRAWS as f64
        };
        let all = mean_of(1.0);
        assert!(all > 0.0);
        // 101 of 101, 26 of 101, 1 of 101: the noise of one draw each is 0.06 in 300.
        for (share, tolerance) in [(1.0, 0.02), (0.25, 0.04), (1e-6, 0.2)] {
            let ratio = mean_of(share) / all;
            assert!((ratio - 1.0).abs() < tolerance, "{share}: {ratio}");
        }
    }

    #[test]
    fn an_empty_set_has_no_opacity_to_pay_for() {
        let device = Device::flex();
        let set = |n: usize| {
            let points = vec![[0.0; 3]; n];
            let mut rows = GaussianRows::from_points(&points, &points, 0, 0.1);
            rows.opacity_logits = [0.0, 1e9].into_iter().cycle().take(n).collect();
            opacity(&Gaussians::from_rows(&rows, &device)).map(|mean| to_host(mean)[0])
        };
        assert_eq!(set(0), None);
        assert_eq!(set(1), Some(0.5));
        assert_eq!(set(2), Some(0.75));
    }

    /// Opacity, area of one standard deviation in pixels, depth, whether it is drawn.
    type Spot = (f32, f32, f32, bool);

    /// A set of such Gaussians, as rows and as splats with round outlines.
    fn spots(spots: &[Spot], device: &Device) -> (Gaussians, Tensor<2>) {
        let points = vec![[0.0; 3]; spots.len()];
        let mut rows = GaussianRows::from_points(&points, &points, 0, 0.1);
        let mut splats = Vec::new();
        for (logit, &(opacity, area, depth, drawn)) in rows.opacity_logits.iter_mut().zip(spots) {
            *logit = dash_model::logit(opacity);
            let mut splat = [0.0; N_COLUMNS];
            if drawn {
                splat[CONIC_A] = 1.0 / area;
                splat[CONIC_C] = 1.0 / area;
                splat[RADIUS_X] = area.sqrt();
                splat[DEPTH] = depth;
                splat[OPACITY] = opacity;
            }
            splats.extend(splat);
        }
        let splats = TensorData::new(splats, [spots.len(), N_COLUMNS]);
        let set = Gaussians::from_rows(&rows, device);
        (set, Tensor::from_data(splats, device))
    }

    /// [`nearness`] in a picture of 200 pixels, in double precision.
    fn nearness_reference(spots: &[Spot]) -> f64 {
        let drawn = || {
            spots.iter().filter(|spot| spot.3).map(|spot| {
                let share = (f64::from(spot.1) / 200.0).min(1.0);
                (f64::from(spot.0) * share, 1.0 / f64::from(spot.2))
            })
        };
        let covered: f64 = drawn().map(|(cover, _)| cover).sum();
        let typical = drawn().map(|(cover, near)| cover * near).sum::<f64>() / covered;
        drawn()
            .map(|(cover, near)| cover * ((near / typical).powi(2) - 1.0).clamp(0.0, 16.0))
            .sum()
    }

    #[test]
    fn cover_costs_by_how_near_it_is() {
        const SPOTS: [Spot; 6] = [
            (0.9, 40.0, 3.0, true),
            (0.5, 10.0, 6.0, true),
            (0.1, 30.0, 1.0, true),
            // Far nearer than the rest, larger than the picture, not drawn.
            (0.02, 2.0, 0.01, true),
            (0.3, 500.0, 8.0, true),
            (0.7, 90.0, 2.0, false),
        ];
        let camera = Camera::new(10.0, 10.0, 10.0, 5.0, 20, 10);
        let device = Device::flex().autodiff();
        let (set, splats) = spots(&SPOTS, &device);
        let cost = nearness(&set, &splats, None, &camera).expect("some are drawn");
        let expected = nearness_reference(&SPOTS);
        let found = f64::from(to_host(cost.clone())[0]);
        assert!((found / expected - 1.0).abs() < 1e-5, "{found} {expected}");

        // In other units all is as near as before.
        let inches =
            SPOTS.map(|(opacity, area, depth, drawn)| (opacity, area, 39.4 * depth, drawn));
        let (same, far) = spots(&inches, &device);
        let far = nearness(&same, &far, None, &camera).map(|cost| f64::from(to_host(cost)[0]));
        assert!((far.expect("drawn") / expected - 1.0).abs() < 1e-5);

        // What is nearer than typical pays for its cover, the rest nothing.
        let gradients = cost.backward();
        let gradient = set
            .opacity_logits
            .val()
            .grad(&gradients)
            .expect("of logits");
        let step = 1e-3;
        for (k, slope) in to_host(Tensor::<1>::from_inner(gradient))
            .iter()
            .enumerate()
        {
            let at = |by: f32| {
                let mut rows = set.to_rows();
                rows.opacity_logits[k] += by;
                let moved = Gaussians::from_rows(&rows, &device);
                f64::from(to_host(nearness(&moved, &splats, None, &camera).expect("drawn"))[0])
            };
            let difference = (at(step) - at(-step)) / f64::from(2.0 * step);
            let error = (f64::from(*slope) - difference).abs();
            assert!(error < 1e-3 * expected, "{k}: {slope} {difference}");
            let near = SPOTS[k].3 && SPOTS[k].2 < 3.5;
            assert_eq!(*slope > 0.0, near, "{k}: {slope}");
        }
    }

    #[test]
    fn nothing_drawn_covers_nothing() {
        let camera = Camera::new(10.0, 10.0, 10.0, 5.0, 20, 10);
        let device = Device::flex().autodiff();
        for hidden in [&[][..], &[(0.7, 90.0, 2.0, false)]] {
            let (set, splats) = spots(hidden, &device);
            assert!(nearness(&set, &splats, None, &camera).is_none());
        }
    }

    #[test]
    fn what_does_not_count_changes_neither_loss_nor_gradient() {
        const SIDE: usize = 16;
        let device = Device::flex().autodiff();
        let counted: Vec<f32> = (0..SIDE * SIDE)
            .map(|pixel| f32::from(u8::from(pixel % SIDE < 6)))
            .collect();
        let picture = |seed: usize, outside: f32| -> Tensor<3> {
            let values: Vec<f32> = (0..SIDE * SIDE * 3)
                .map(|i| match counted[i / 3] > 0.0 {
                    true => ((i * 37 + seed * 11) % 101) as f32 / 101.0,
                    false => outside,
                })
                .collect();
            Tensor::from_data(TensorData::new(values, [SIDE, SIDE, 3]), &device)
        };
        let judge = |outside: [f32; 2]| {
            let image = picture(1, outside[0]).require_grad();
            let (a, b) = where_counted(image.clone(), picture(2, outside[1]), counted.clone());
            let loss = photometric(a, b, 0.2).expect("equal sizes");
            let gradient = image.grad(&loss.backward()).expect("tracked");
            (to_host(loss), to_host(gradient))
        };
        let (loss, gradient) = judge([0.2, 0.9]);
        assert!(loss[0] > 0.0);
        assert_eq!((loss, gradient.clone()), judge([0.7, 0.1]));
        for (i, v) in gradient.iter().enumerate() {
            assert_eq!(*v != 0.0, counted[i / 3] > 0.0, "value {i}: {v}");
        }
    }

    #[test]
    fn visible_motion_is_a_mean_over_the_picture_and_saturates() {
        let device = Device::flex();
        let camera = Camera::new(20.0, 20.0, 10.0, 5.0, 20, 10);
        let mut splats = vec![0.0f32; 4 * N_COLUMNS];
        // Conics of 1/4: an area of 4 pixels, of 200. The last two are not drawn.
        for (row, (depth, radius)) in [(2.0, 3.0), (4.0, 3.0), (0.0, 3.0), (2.0, 0.0)]
            .iter()
            .enumerate()
        {
            let splat = &mut splats[row * N_COLUMNS..(row + 1) * N_COLUMNS];
            (splat[CONIC_A], splat[CONIC_C]) = (0.25, 0.25);
            (splat[OPACITY], splat[DEPTH], splat[RADIUS_X]) = (0.5, *depth, *radius);
        }
        let splats = Tensor::<2>::from_data(TensorData::new(splats, [4, N_COLUMNS]), &device);
        let cost = |extents: [f32; 4], far| {
            let extents = Tensor::<1>::from_data(extents, &device);
            to_host(visible_motion(extents, &splats, &camera, far))[0]
        };
        let far = 0.05;
        // Half opaque, each covers 2 / 200; a unit is 1 / 2 and 1 / 4 of the width.
        let half = 0.05 / 2.0;
        assert!((cost([0.1, 0.0, 9.0, 9.0], far) - 0.01 * half).abs() < 1e-8);
        assert!((cost([0.1, 0.2, 9.0, 9.0], far) - 0.02 * half).abs() < 1e-8);
        assert!(cost([1e6, 1e6, 0.0, 0.0], far) < 0.02 * 0.0501);
        assert_eq!(cost([0.0; 4], far), 0.0);
        // Nearly straight.
        assert!((cost([0.1, 0.4, 9.0, 9.0], 1e6) - 0.01 * 0.15).abs() < 1e-8);
    }
}
