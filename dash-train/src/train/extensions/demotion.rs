//! Demotion: during the 4D stage, dynamic Gaussians that rest and keep their colour become static, and those that no picture shows are pruned.

use dash_kernels::project::Activation;
use dash_model::{DynamicScene, Gaussians, SH_C0};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::train::core::visibility::{largest_shares, witnesses};
use crate::train::core::{Extension, Ranges, Run, Section, Set, to_host};
use crate::train::paper::Dash;

/// Times at which a review looks where a Gaussian is.
const TIMES: usize = 12;
/// Share by which the squared error must grow when all that moves is held still; else the scene needs
/// no dynamic part. An object on 0.3 % of the pixels, half found, is worth 4e-4; what is left in a
/// scene in which nothing moves, 1e-5.
const MIN_GAIN: f64 = 2e-4;

/// Motion over the clip, in shares of the image's width, below which a dynamic Gaussian becomes static.
const MIN_MOTION: f32 = 0.005;
/// Change of colour over the clip, as a share of white, below which it may become static.
const MIN_CHANGE: f32 = 0.04;
/// Pixels' worth of a dynamic Gaussian that some picture must show.
const MIN_SHARE: f32 = 0.1;

/// `[extensions.demotion]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DemotionConfig {
    /// Steps of the 4D stage between two reviews. Source: ours.
    pub interval: usize,
}

impl Section for DemotionConfig {
    fn check(&self, ranges: &mut Ranges) {
        ranges.at_least_one("interval", self.interval);
    }
}

/// See [`DemotionConfig`].
pub struct Demotion {
    pub(crate) config: DemotionConfig,
    /// [`MIN_MOTION`], but for tests.
    pub(crate) min_motion: f32,
}

impl Demotion {
    /// From its section.
    pub fn new(config: DemotionConfig) -> Self {
        Self {
            config,
            min_motion: MIN_MOTION,
        }
    }
}

impl Extension<Dash> for Demotion {
    fn name(&self) -> &'static str {
        "demotion"
    }

    fn before_step(&mut self, run: &mut Run<Dash>) -> Result<(), Error> {
        if run.has_just_decomposed() {
            drop_hidden(run)?;
        }
        Ok(())
    }

    fn after_step(&mut self, run: &mut Run<Dash>) -> Result<(), Error> {
        let start = run.stages().end;
        let due = run.step > start && (run.step - start).is_multiple_of(self.config.interval);
        if due && !run.is_frozen() {
            review(run, self.min_motion)?;
        }
        Ok(())
    }
}

/// Where dynamic Gaussians are over the clip, and how their colours change.
struct Ways {
    centres: Vec<[f32; 3]>,
    /// World units.
    ranges: Vec<f32>,
    /// Shares of white.
    changes: Vec<f32>,
}

/// Prunes dynamic Gaussians that no picture shows, and makes static those that rest, in the middle of where they are over
/// the clip: all of them, if by the end of their density control holding all still does no harm.
fn review(run: &mut Run<Dash>, min_motion: f32) -> Result<(), Error> {
    drop_hidden(run)?;
    let Some(ways) = ways(&run.scene)? else {
        return Ok(());
    };
    let n = ways.centres.len();
    let still = held_still(&run.scene, &ways)?;
    let screen = screen_scale(run, &ways.centres);
    let needed = !is_grown(run) || is_needed(run, &still)?;
    // Non-finite Gaussians are left to density control, which prunes them.
    let moves = |row: usize| {
        let way = ways.ranges[row] * screen[row];
        way >= min_motion || !way.is_finite() || ways.changes[row] >= MIN_CHANGE
    };
    let (stay, leave): (Vec<usize>, Vec<usize>) = (0..n).partition(|&row| needed && moves(row));
    if leave.is_empty() {
        return Ok(());
    }
    let n_static = run.scene.static_set.len();
    let rows = still.to_rows();
    let kept: Vec<usize> = (0..n_static)
        .chain(leave.iter().map(|row| n_static + row))
        .collect();
    let grown = Gaussians::from_rows(&rows.gather(&kept), &run.device);
    run.append(Set::Static, grown, leave.len());
    run.keep(Set::Dynamic, &stay);
    Ok(())
}

/// Prunes dynamic Gaussians that no picture shows, such as those that strayed behind a wall.
fn drop_hidden(run: &mut Run<Dash>) -> Result<(), Error> {
    let (n_static, n_dynamic) = run.scene.counts();
    if n_dynamic == 0 {
        return Ok(());
    }
    let shares = largest_shares(run, witnesses(run))?.split_off(n_static);
    let (shown, hidden): (Vec<usize>, Vec<usize>) =
        (0..shares.len()).partition(|&row| shares[row] >= MIN_SHARE);
    if !hidden.is_empty() {
        run.keep(Set::Dynamic, &shown);
    }
    Ok(())
}

/// `None` without dynamic Gaussians.
fn ways(scene: &DynamicScene) -> Result<Option<Ways>, Error> {
    let Some(dynamic) = scene.dynamic.as_ref().filter(|d| !d.gaussians.is_empty()) else {
        return Ok(None);
    };
    let n = dynamic.gaussians.len();
    let mut low = vec![[f32::INFINITY; 3]; n];
    let mut high = vec![[f32::NEG_INFINITY; 3]; n];
    let has_changes = dynamic.field.config().heads.appearance;
    let mut shades = vec![[f32::INFINITY, f32::NEG_INFINITY]; 3 * n];
    for k in 0..TIMES {
        let time = k as f32 / (TIMES - 1) as f32;
        let deformed = dynamic.deform(&scene.settings, time)?;
        if has_changes {
            let colors = to_host(deformed.sh_coeffs.dc.detach());
            let opacities = to_host(deformed.opacities.detach());
            let is_logit = deformed.activation == Activation::Exp;
            for (index, (ends, dc)) in shades.iter_mut().zip(colors).enumerate() {
                let opacity = opacities[index / 3];
                let opacity = match is_logit {
                    true => 1.0 / (1.0 + (-opacity).exp()),
                    false => opacity,
                };
                let shade = opacity * (0.5 + SH_C0 * dc).clamp(0.0, 1.0);
                *ends = [ends[0].min(shade), ends[1].max(shade)];
            }
        }
        let means = to_host(deformed.means.detach());
        for (row, mean) in means.chunks_exact(3).enumerate() {
            for axis in 0..3 {
                low[row][axis] = low[row][axis].min(mean[axis]);
                high[row][axis] = high[row][axis].max(mean[axis]);
            }
        }
    }
    let both = || low.iter().zip(&high);
    let centres = both().map(|(l, h)| std::array::from_fn(|a| 0.5 * (l[a] + h[a])));
    let ranges = both().map(|(l, h)| glam::Vec3::from(*l).distance((*h).into()));
    Ok(Some(Ways {
        centres: centres.collect(),
        ranges: ranges.collect(),
        changes: shades
            .chunks_exact(3)
            .map(|channels| channels.iter().map(|[l, h]| h - l).fold(0.0, f32::max))
            .collect(),
    }))
}

/// All Gaussians as one static set, the dynamic ones last and in the middle of their ways.
fn held_still(scene: &DynamicScene, ways: &Ways) -> Result<Gaussians, Error> {
    let mut rows = scene.at(0.5)?;
    let n_static = rows.len() - ways.centres.len();
    rows.means[n_static..].copy_from_slice(&ways.centres);
    Ok(Gaussians::from_rows(
        &rows,
        &scene.static_set.means.device(),
    ))
}

/// Whether the dynamic set has had its time to grow; before, it may still be finding motion.
fn is_grown(run: &Run<Dash>) -> bool {
    run.step >= run.config.step_at(run.config.densify.dynamic.during[1])
}

/// Whether pictures get worse when all that moves is held still.
fn is_needed(run: &Run<Dash>, still: &Gaussians) -> Result<bool, Error> {
    let scene = &run.scene;
    let still = DynamicScene {
        static_set: still.clone(),
        dynamic: None,
        settings: scene.settings.clone(),
    };
    let (mut moving_error, mut still_error) = (0.0, 0.0);
    for view in witnesses(run) {
        let truth = view.rgb(scene.settings.background)?;
        let error = |scene: &DynamicScene| -> Result<f64, Error> {
            let image = scene.render(&view.camera, view.time)?.rgb().detach();
            let pairs = to_host(image).into_iter().zip(&truth);
            Ok(pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum())
        };
        moving_error += error(scene)?;
        still_error += error(&still)?;
    }
    let worth = (1.0 + MIN_GAIN) * moving_error;
    // An error that is not finite decides nothing.
    Ok(still_error >= worth || !still_error.is_finite() || !worth.is_finite())
}

/// Shares of the image's width that a world unit takes at each point, median over the training
/// views that have it in front of them.
fn screen_scale(run: &Run<Dash>, points: &[[f32; 3]]) -> Vec<f32> {
    const VIEWS: usize = 16;
    let stride = run.train_views.len().div_ceil(VIEWS).max(1);
    let cameras: Vec<_> = run
        .train_views
        .iter()
        .step_by(stride)
        .map(|&view| &run.dataset.views[view].camera)
        .collect();
    points
        .iter()
        .map(|point| {
            let mut scales: Vec<f32> = cameras
                .iter()
                .filter_map(|camera| {
                    let depth = camera.transform(point.map(f64::from))[2];
                    (depth > 1e-6).then(|| (camera.fx / (depth * camera.width as f64)) as f32)
                })
                .collect();
            scales.sort_by(f32::total_cmp);
            scales
                .get(scales.len() / 2)
                .copied()
                .unwrap_or(f32::INFINITY)
        })
        .collect()
}
