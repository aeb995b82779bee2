//! Eq. 11: the 4D field is smooth. The same lookup of the field serves whatever else is asked of it around a time.

use burn::tensor::{Tensor, TensorData};
use dash_kernels::rows::take_rows;
use dash_kernels::smoothness::smoothness;
use dash_kernels::space_time::Beside;
use dash_model::{DynamicPart, ModelError, SceneSettings};
use rand::Rng;

use crate::train::core::Around;

/// Below this share of the scene's extent a deviation costs less and less.
const TINY: f32 = 1e-5;

/// Half-widths of the random step of Eq. 11 in the unit cube, space then time. Source: the released code.
pub(crate) const STEP: [f32; 2] = [5e-3, 1e-4];

/// What is asked of the 4D field.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Request {
    /// Share of the dynamic Gaussians that it is measured at, drawn anew at every call: its mean is that of all on average.
    pub(crate) share: f32,
    /// Whether to measure Eq. 11.
    pub(crate) is_smooth: bool,
    /// Where to look for steadiness.
    pub(crate) around: Option<Around>,
    /// Size of the scene, world units.
    pub(crate) extent: f32,
}

/// What was found.
pub(crate) struct Probed {
    /// The field's features at all Gaussians, `[N, features]`.
    pub(crate) features: Tensor<2>,
    /// Eq. 11: the mean over Gaussians of the squared distance between the features at them and at a small random step
    /// from each.
    pub(crate) smoothness: Option<Tensor<1>>,
    /// The mean distance, in extents, of Gaussians from where they would be had they gone in a straight line and at one
    /// speed from a time before to a time after. Where one camera sees each time, what is wrong along its axis shows in no
    /// picture of that time, but here.
    pub(crate) unsteadiness: Option<Tensor<1>>,
}

/// Asks the field at all Gaussians and for what is measured, in one lookup: the gradient of a lookup is as large as the
/// tables, however few the points.
///
/// # Errors
/// When a shape does not fit.
pub(crate) fn probe(
    dynamic: &DynamicPart,
    settings: &SceneSettings,
    time: f32,
    request: &Request,
    rng: &mut impl Rng,
) -> Result<Probed, ModelError> {
    let (field, gaussians) = (&dynamic.field, &dynamic.gaussians);
    let all = gaussians.len();
    let n = ((request.share * all as f32).ceil() as usize).min(all);
    let device = gaussians.means.val().device();
    let drawn = draw(all, n, rng);
    let mut steps = Vec::new();
    if request.is_smooth {
        steps.extend((0..4 * n).map(|i| {
            let half_width = STEP[usize::from(i % 4 == 3)];
            (rng.random::<f32>() * 2.0 - 1.0) * half_width
        }));
    }
    for other in request.around.iter().flat_map(|a| [a.before, a.after]) {
        steps.extend((0..n).flat_map(|_| [0.0, 0.0, 0.0, other - time]));
    }
    if steps.is_empty() {
        return Ok(Probed {
            features: dynamic.features(time)?,
            smoothness: None,
            unsteadiness: None,
        });
    }
    let n_groups = steps.len() / (4 * n);
    let beside = Beside {
        rows: drawn.repeat(n_groups),
        steps: Tensor::from_data(TensorData::new(steps, [n_groups * n, 4]), &device),
    };
    let looked_up = dynamic.features_beside(time, beside)?;
    let (features, smoothness, others) = if request.is_smooth {
        let found = smoothness(looked_up, all, &drawn)?;
        (found.own, Some(found.cost), found.others)
    } else {
        let others = looked_up.clone().narrow(0, all, n_groups * n);
        (looked_up.narrow(0, 0, all), None, Some(others))
    };
    let mut unsteadiness = None;
    if let (Some(Around { before, after }), Some(others)) = (request.around, others) {
        let times = [time, before, after];
        let own = take(features.clone(), &drawn)?;
        let offsets = field.decode(Tensor::cat(vec![own, others], 0))?.means;
        let own = gaussians.trajectories.as_ref();
        let own = own.map(|own| take(own.val(), &drawn)).transpose()?;
        let at = |k: usize| {
            let offset = offsets.clone().narrow(0, k * n, n);
            Ok::<_, ModelError>(match own.clone() {
                Some(own) => offset + settings.trajectory_basis.displacement(own, times[k])?,
                None => offset,
            })
        };
        let (now, before_now, after_now) = (at(0)?, at(1)?, at(2)?);
        let share = (time - before) / (after - before);
        let straight = before_now * (1.0 - share) + after_now * share;
        let off = (now - straight) / request.extent;
        let lengths = (off.powi_scalar(2).sum_dim(1) + TINY * TINY).sqrt();
        unsteadiness = Some(lengths.sum() / n as f32);
    }
    Ok(Probed {
        features,
        smoothness,
        unsteadiness,
    })
}

/// These rows of `values [N, C]`.
fn take(values: Tensor<2>, rows: &[u32]) -> Result<Tensor<2>, ModelError> {
    if rows.len() == values.dims()[0] {
        return Ok(values);
    }
    Ok(take_rows(values, rows)?)
}

/// `n` of so many rows, in order.
fn draw(all: usize, n: usize, rng: &mut impl Rng) -> Vec<u32> {
    if n == all {
        return (0..all as u32).collect();
    }
    let drawn = rand::seq::index::sample(rng, all, n);
    let mut drawn: Vec<u32> = drawn.into_iter().map(|row| row as u32).collect();
    drawn.sort_unstable();
    drawn
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use dash_model::{
        DeformationField, Gaps, GaussianRows, Gaussians, OffsetPlacement, SpaceBox, TrajectoryBasis,
    };
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::*;
    use crate::train::core::{CaptureFacts, to_host};
    use crate::train::{Preset, TrainConfig};

    const SPANS: usize = 4;

    fn settings() -> SceneSettings {
        SceneSettings {
            trajectory_basis: TrajectoryBasis::Polyline {
                spans: SPANS,
                anchor: 0.5,
            },
            background: [0.0; 3],
            sh_degree: 0,
            near_plane: 0.01,
            offsets: OffsetPlacement::BeforeActivation,
            gaps: Gaps::default(),
        }
    }

    /// Gaussians at random places of a fresh field, with trajectories by coefficients, if any.
    fn part(n: usize, trajectories: &[f32], rng: &mut Pcg64, device: &Device) -> DynamicPart {
        let facts = CaptureFacts {
            n_frames: 8,
            is_synchronized: true,
        };
        let config = TrainConfig::preset(Preset::Quick)
            .method
            .deformation(&facts);
        let space = SpaceBox::fixed(1.0);
        let field = DeformationField::new(&config, space, rng, device).expect("valid");
        let points: Vec<[f32; 3]> = (0..n)
            .map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
            .collect();
        let mut rows = GaussianRows::from_points(&points, &points, 0, 0.1);
        rows.trajectory_width = trajectories.len() / n;
        rows.trajectories = trajectories.to_vec();
        DynamicPart {
            gaussians: Gaussians::from_rows(&rows, device),
            field,
        }
    }

    #[test]
    fn a_share_is_all_on_average() {
        const N: usize = 101;
        const DRAWS: usize = 300;
        let device = Device::flex();
        let mut rng = Pcg64::seed_from_u64(3);
        let coefficients: Vec<f32> = (0..N * SPANS * 3)
            .map(|_| rng.random_range(0.0..1.0))
            .collect();
        let dynamic = part(N, &coefficients, &mut rng, &device);
        let mut means_of = |share: f32| {
            let mut sums = [0.0; 2];
            for k in 0..DRAWS {
                let time = k as f32 / DRAWS as f32;
                let request = Request {
                    share,
                    is_smooth: true,
                    around: Some(Around {
                        before: time - 0.2,
                        after: time + 0.2,
                    }),
                    extent: 1.0,
                };
                let found = probe(&dynamic, &settings(), time, &request, &mut rng);
                let found = found.expect("valid");
                let terms = [found.smoothness, found.unsteadiness];
                for (sum, term) in sums.iter_mut().zip(terms) {
                    *sum += f64::from(to_host(term.expect("asked for"))[0]) / DRAWS as f64;
                }
            }
            sums
        };
        let all = means_of(1.0);
        assert!(all.iter().all(|mean| *mean > 0.0));
        // 101 of 101, 26 of 101, 1 of 101: the noise of one draw each is 0.06 in 300.
        for (share, tolerance) in [(1.0, 0.02), (0.25, 0.04), (1e-6, 0.2)] {
            for (mean, all) in means_of(share).into_iter().zip(all) {
                let ratio = mean / all;
                assert!((ratio - 1.0).abs() < tolerance, "{share}: {ratio}");
            }
        }
    }

    /// Against the formula in f64 and central differences of it, in scenes of several sizes. The field adds next to nothing yet.
    #[test]
    fn what_leaves_the_straight_way_costs() {
        const N: usize = 5;
        let device = Device::flex().autodiff();
        let basis = settings().trajectory_basis;
        let mut rng = Pcg64::seed_from_u64(4);
        let [before, time, after] = [0.3_f32, 0.45, 0.8];
        for extent in [1.0_f32, 1e-2, 1e4] {
            let mut coefficients: Vec<f32> = (0..N * SPANS * 3)
                .map(|_| rng.random_range(-1.0..1.0) * extent)
                .collect();
            // The first goes straight: each of its spans adds the same.
            for span in 1..SPANS {
                coefficients.copy_within(0..3, 3 * span);
            }
            let mut dynamic = part(N, &coefficients, &mut rng, &device);
            let own = dynamic.gaussians.trajectories.take().expect("given");
            let place = |own: &[f64], time: f32| -> [f64; 3] {
                let weights = basis.at(time);
                std::array::from_fn(|axis| {
                    let terms = weights.iter().zip(own.chunks_exact(3));
                    terms.map(|(w, c)| f64::from(*w) * c[axis]).sum()
                })
            };
            let cost = |own: &[f64]| -> f64 {
                let share = f64::from(time - before) / f64::from(after - before);
                let off = |own: &[f64]| {
                    let [a, b, c] = [before, time, after].map(|time| place(own, time));
                    let off = |axis: usize| b[axis] - a[axis] * (1.0 - share) - c[axis] * share;
                    let squares = (0..3).map(|axis| (off(axis) / f64::from(extent)).powi(2));
                    (squares.sum::<f64>() + f64::from(TINY).powi(2)).sqrt()
                };
                own.chunks_exact(SPANS * 3).map(off).sum::<f64>() / N as f64
            };
            dynamic.gaussians.trajectories = Some(own);
            let request = Request {
                share: 1.0,
                is_smooth: false,
                around: Some(Around { before, after }),
                extent,
            };
            let found = probe(&dynamic, &settings(), time, &request, &mut rng);
            let found = found.expect("valid");
            assert!(found.smoothness.is_none());
            let found = found.unsteadiness.expect("asked for");
            let gradients = found.backward();
            let own = dynamic.gaussians.trajectories.as_ref().expect("given");
            let gradient = to_host(own.val().grad(&gradients).expect("used"));
            let exact: Vec<f64> = coefficients.iter().map(|&c| f64::from(c)).collect();
            let expected = cost(&exact);
            let error = (f64::from(to_host(found)[0]) - expected).abs();
            let of_field = 1e-7 / f64::from(extent);
            assert!(
                error < 1e-5 * expected + of_field,
                "{extent}: off by {error} of {expected}"
            );
            let step = 1e-4 * f64::from(extent);
            // Of the one that goes straight, only that it asks for next to nothing; in a small scene, what the field adds
            // is more than that.
            let unit = 1.0 / (N as f32 * extent);
            let asks = |of: &[f32]| of.iter().fold(0.0, |most: f32, g| most.max(g.abs())) / unit;
            let (straight, others) = gradient.split_at(SPANS * 3);
            assert!(asks(others) > 0.1);
            assert!(extent < 1.0 || asks(straight) < 0.05, "{straight:?}");
            for k in SPANS * 3..exact.len() {
                let nudged = |by: f64| {
                    let mut own = exact.clone();
                    own[k] += by;
                    cost(&own)
                };
                let expected = (nudged(step) - nudged(-step)) / (2.0 * step);
                let error = (f64::from(gradient[k]) - expected).abs() * f64::from(extent);
                assert!(error < 1e-4, "{extent}, {k}: {} {expected}", gradient[k]);
            }
        }
    }
}
