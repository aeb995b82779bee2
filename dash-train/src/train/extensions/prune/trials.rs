//! Trials when training is over: the scene without a part, on training views, against the scene with
//! it.

use std::time::Instant;

use burn::module::Module as _;
use dash_model::scene_file::TablePrecision;
use dash_model::{DynamicScene, Layer};

use super::{MAX_TOTAL_LOSS, MIN_SAVING};
use crate::Error;
use crate::dataset::View;
use crate::metrics::{DYNAMIC_ALPHA_THRESHOLD, masked_psnr, psnr};
use crate::numbers::median;
use crate::train::core::visibility::spread;
use crate::train::core::{Decision, Run, to_host};
use crate::train::paper::Dash;

/// Halvings of the range in which a share lies.
const ROUNDS: usize = 5;
/// Training views on which a scene is scored: one for so many steps, so that the trials take a small share
/// of a run.
const STEPS_PER_VIEW: usize = 100;
/// Most of them.
const MOST_VIEWS: usize = 64;
/// Views after which a scene that is clearly worse is given up; there are no fewer.
const FIRST_VIEWS: usize = 8;
/// Standard errors that make it clear.
const CLEARLY: f64 = 3.0;

/// How a scene does on training views.
#[derive(Debug, Clone, Default)]
pub(super) struct Scores {
    /// PSNR over the pixels that count, dB.
    psnr: Vec<f64>,
    /// PSNR over those of them where something moves, dB, of views that have any.
    moving: Vec<f64>,
    /// How long a view took.
    millis: Vec<f64>,
}

impl Scores {
    /// How they compare with those of a scene with more parts: over all pixels, and where something moves.
    /// Where one has fewer views, these count.
    fn against(&self, with: &Self) -> [Outcome; 2] {
        [
            Outcome::of(&with.psnr, &self.psnr),
            Outcome::of(&with.moving, &self.moving),
        ]
    }
}

/// A training view to score scenes on.
struct Trial<'a> {
    view: &'a View,
    /// Where something moves in the scene with all parts, `[H * W]`; `None` where nothing does anywhere.
    moving: Option<Vec<bool>>,
}

/// How a scene without a part does, against the scene with it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Outcome {
    mean: f64,
    standard_error: f64,
}

impl Outcome {
    fn of(with: &[f64], without: &[f64]) -> Self {
        let changes: Vec<f64> = with
            .iter()
            .zip(without)
            .map(|(with, without)| without - with)
            .collect();
        let n = changes.len().max(1) as f64;
        let mean = changes.iter().sum::<f64>() / n;
        let variance = changes.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        Self {
            mean,
            standard_error: (variance / n).sqrt(),
        }
    }

    fn lower(self) -> f64 {
        self.mean - 2.0 * self.standard_error
    }

    fn is_clearly_worse(self, max_loss: f64) -> bool {
        self.mean + CLEARLY * self.standard_error < -max_loss
    }
}

/// How a scene did in a trial without consequences.
pub(super) struct Effect {
    /// Change of PSNR, dB.
    pub(super) mean: f64,
    /// Whether so little is lost that the part may go.
    pub(super) is_harmless: bool,
    pub(super) scores: Scores,
}

/// A scene without a part.
pub(super) struct Candidate {
    pub(super) part: String,
    /// What is said of it beside what is measured.
    pub(super) reason: String,
    pub(super) scene: DynamicScene,
    /// How its tables are stored.
    pub(super) precision: TablePrecision,
    /// Share of the field's arithmetic that goes with the part.
    pub(super) arithmetic: f64,
}

/// A trained scene from which parts are left out one after the other.
pub(super) struct Trials<'a> {
    pub(super) run: &'a Run<Dash>,
    /// Most that pictures may lose when a part is left out, dB.
    max_loss: f64,
    views: Vec<Trial<'a>>,
    /// What is left so far.
    pub(super) scene: DynamicScene,
    /// How its tables are stored.
    pub(super) precision: TablePrecision,
    scores: Scores,
    /// The scores of all of it.
    of_all: Scores,
    /// Bytes that what is left takes when stored.
    bytes: usize,
    /// What was decided.
    pub(super) decisions: Vec<Decision>,
}

impl<'a> Trials<'a> {
    /// All of a run's scene.
    pub(super) fn new(
        run: &'a Run<Dash>,
        scene: DynamicScene,
        max_loss: f64,
    ) -> Result<Self, Error> {
        // Without the graph that gradients need.
        let scene = scene.valid();
        let n_views = (run.step / STEPS_PER_VIEW).clamp(FIRST_VIEWS, MOST_VIEWS);
        let views: Vec<&View> = spread(run, n_views).collect();
        // The first views that are looked at are of all cameras and times, too.
        let stride = views.len().div_ceil(FIRST_VIEWS).max(1);
        let order = (0..stride).flat_map(|from| (from..views.len()).step_by(stride));
        let views = order
            .map(|k| {
                let view = views[k];
                let moving = moving(&scene, view)?;
                Ok(Trial { view, moving })
            })
            .collect::<Result<_, Error>>()?;
        let mut trials = Self {
            run,
            max_loss,
            views,
            bytes: scene.stored_bytes(TablePrecision::Single),
            scene,
            precision: TablePrecision::Single,
            scores: Scores::default(),
            of_all: Scores::default(),
            decisions: Vec::new(),
        };
        trials.of_all = trials.score(&trials.scene)?;
        trials.scores = trials.of_all.clone();
        Ok(trials)
    }

    /// Scores a scene against what is left so far, on fewer views if it is clearly worse.
    pub(super) fn score(&self, scene: &DynamicScene) -> Result<Scores, Error> {
        let whole = self.run.whole(scene);
        let mut scores = Scores::default();
        for Trial { view, moving } in &self.views {
            let start = Instant::now();
            let image = to_host(whole.render(&view.camera, view.time)?.rgb().detach());
            scores.millis.push(1e3 * start.elapsed().as_secs_f64());
            let (truth, counted) = view.rgb_and_counted(scene.settings.background)?;
            let counts = |pixel: usize| counted.as_ref().is_none_or(|counted| counted[pixel] > 0.0);
            scores.psnr.extend(match &counted {
                None => Some(psnr(&image, &truth)),
                Some(counted) => {
                    let counted: Vec<bool> = (0..counted.len()).map(counts).collect();
                    masked_psnr(&image, &truth, &counted)
                }
            });
            if let Some(moving) = moving {
                let moving = moving.iter().enumerate();
                let counted: Vec<bool> = moving.map(|(pixel, m)| *m && counts(pixel)).collect();
                scores.moving.extend(masked_psnr(&image, &truth, &counted));
            }
            let looked_at = scores.psnr.len();
            let so_far = scores.against(&self.scores);
            if looked_at >= FIRST_VIEWS
                && so_far
                    .into_iter()
                    .any(|outcome| outcome.is_clearly_worse(self.max_loss))
            {
                break;
            }
        }
        Ok(scores)
    }

    /// Whether a scene of these scores loses no more than a part may, nor all parts together.
    fn is_harmless(&self, scores: &Scores) -> bool {
        let loses_no_more = |with: &Scores, most: f64| {
            let outcomes = scores.against(with);
            outcomes.iter().all(|outcome| outcome.lower() > -most)
        };
        loses_no_more(&self.scores, self.max_loss) && loses_no_more(&self.of_all, MAX_TOTAL_LOSS)
    }

    /// Goes on with a candidate, if that loses nothing and saves enough; whether it does.
    pub(super) fn judge(&mut self, candidate: Candidate) -> Result<bool, Error> {
        let scores = self.score(&candidate.scene)?;
        Ok(self.judge_scored(candidate, scores))
    }

    /// The same where it has been scored.
    pub(super) fn judge_scored(&mut self, candidate: Candidate, scores: Scores) -> bool {
        let bytes = candidate.scene.stored_bytes(candidate.precision);
        let saved = self.bytes.saturating_sub(bytes);
        let [whole, moving] = scores.against(&self.scores);
        let moves = !scores.moving.is_empty();
        let enough =
            saved as f64 >= MIN_SAVING * self.bytes as f64 || candidate.arithmetic >= MIN_SAVING;
        let left_out = self.is_harmless(&scores) && enough;
        self.decisions.push(Decision {
            left_out,
            reason: candidate.reason,
            db: Some(whole.mean),
            db_lower: Some(whole.lower()),
            moving_db: moves.then_some(moving.mean),
            moving_db_lower: moves.then(|| moving.lower()),
            bytes: Some(saved as u64),
            millis: Some(typical(&self.scores.millis) - typical(&scores.millis)),
            ..Decision::kept(self.run.step, &candidate.part)
        });
        if left_out {
            (self.scene, self.precision) = (candidate.scene, candidate.precision);
            (self.scores, self.bytes) = (scores, bytes);
        }
        left_out
    }

    /// What is said of every part: how much it may cost.
    pub(super) fn may_cost(&self) -> String {
        format!("may cost at most {} dB", self.max_loss)
    }

    /// How a scene does by itself.
    pub(super) fn effect(&self, scene: &DynamicScene) -> Result<Effect, Error> {
        let scores = self.score(scene)?;
        Ok(Effect {
            mean: scores.against(&self.scores)[0].mean,
            is_harmless: self.is_harmless(&scores),
            scores,
        })
    }

    /// The largest share that can go, up to `most`: how many of `n` that is, and what `without` makes of
    /// it. While none is harmless, the last that was tried.
    pub(super) fn largest_share(
        &self,
        most: f64,
        n: usize,
        without: impl Fn(usize) -> DynamicScene,
    ) -> Result<Option<(usize, DynamicScene, Scores)>, Error> {
        let (mut low, mut high, mut share) = (0.0, most, most);
        let mut tried = None;
        for _ in 0..ROUNDS {
            let gone = (share * n as f64) as usize;
            let scene = without(gone);
            let scores = self.score(&scene)?;
            let harmless = self.is_harmless(&scores);
            if harmless || low == 0.0 {
                tried = Some((gone, scene, scores));
            }
            if harmless {
                low = share;
            } else {
                high = share;
            }
            if low == most {
                break;
            }
            share = 0.5 * (low + high);
        }
        Ok(tried)
    }
}

/// Pixels of a view on which the dynamic Gaussians lie, `[H * W]`; `None` of a scene without any.
fn moving(scene: &DynamicScene, view: &View) -> Result<Option<Vec<bool>>, Error> {
    if scene.dynamic.is_none() {
        return Ok(None);
    }
    let layer = scene.render_layer(&view.camera, view.time, Layer::Dynamic)?;
    let alpha = to_host(layer.alpha().detach()).into_iter();
    Ok(Some(alpha.map(|a| a > DYNAMIC_ALPHA_THRESHOLD).collect()))
}

/// The median; 0 of nothing.
fn typical(values: &[f64]) -> f64 {
    median(values.iter().copied()).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAX_LOSS: f64 = 0.007;

    #[test]
    fn a_loss_is_judged_by_its_lower_bound() {
        let with = [30.0; 4];
        let lower = |without: &[f64]| Outcome::of(&with, without).lower();
        assert_eq!(lower(&with), 0.0);
        // A mean of no loss that one view in four pays for.
        let uneven = Outcome::of(&with, &[30.3, 30.3, 30.3, 29.1]);
        assert!(uneven.mean.abs() < 1e-9 && uneven.lower() < -MAX_LOSS);
        assert!(!uneven.is_clearly_worse(MAX_LOSS));
        assert!(lower(&[29.99; 4]) < -MAX_LOSS && lower(&[29.995; 4]) > -MAX_LOSS);
        assert!(Outcome::of(&with, &[29.98; 4]).is_clearly_worse(MAX_LOSS));
        assert!(!Outcome::of(&with, &[29.995; 4]).is_clearly_worse(MAX_LOSS));
        // Nothing moves: nothing is lost there.
        let none = Outcome::of(&[], &[]);
        assert!(none.lower() == 0.0 && !none.is_clearly_worse(MAX_LOSS));
        // Given up early: as many views as were looked at count.
        assert_eq!(Outcome::of(&with, &[29.0; 2]).mean, -1.0);
    }
}
