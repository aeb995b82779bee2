//! Adaptive density control of one set of Gaussians.

use dash_model::GaussianRows;
use rand::Rng;
use rayon::prelude::*;

use super::config::{DensityConfig, Oversized};

/// A split Gaussian's children are smaller by this factor (3DGS).
const SPLIT_SHRINK: f32 = 1.6;

/// Gaussians that a thread takes at least.
const PORTION: usize = 4096;

/// Columns of packed splats that hold the mean.
pub(crate) const MEANS: usize = 2;

/// Opacity that a reset leaves at most (3DGS).
pub(crate) const RESET_OPACITY: f32 = 0.01;

/// Screen-space gradients gathered between two rounds.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct DensityStatistics {
    gradient: Vec<f32>,
    seen: Vec<u32>,
}

impl DensityStatistics {
    /// Nothing gathered for `n` Gaussians.
    pub(crate) fn new(n: usize) -> Self {
        Self {
            gradient: vec![0.0; n],
            seen: vec![0; n],
        }
    }

    /// Adds one view: gradients with respect to the means of packed splats, and the splats (for visibility).
    /// `half_size` is half the image in pixels, which makes the gradient independent of it.
    pub(crate) fn add(&mut self, v_means: &[f32], splats: &[f32], half_size: [f32; 2]) {
        use dash_kernels::splats::{N_COLUMNS, RADIUS_X};
        let rows = v_means
            .par_chunks_exact(MEANS)
            .zip(splats.par_chunks_exact(N_COLUMNS));
        let sums = self.gradient.par_iter_mut().zip(&mut self.seen);
        let rows = rows.zip(sums).with_min_len(PORTION);
        rows.for_each(|((v, splat), (gradient, seen))| {
            let (x, y) = (v[0] * half_size[0], v[1] * half_size[1]);
            if splat[RADIUS_X] > 0.0 && x.is_finite() && y.is_finite() {
                *gradient += x.hypot(y);
                *seen += 1;
            }
        });
    }

    fn mean(&self, row: usize) -> f32 {
        if self.seen[row] > 0 {
            self.gradient[row] / self.seen[row] as f32
        } else {
            0.0
        }
    }

    /// Adds Gaussians that nothing is known about.
    pub(crate) fn grow(&mut self, added: usize) {
        self.gradient.resize(self.gradient.len() + added, 0.0);
        self.seen.resize(self.seen.len() + added, 0);
    }

    /// Follows a change of the rows.
    pub(crate) fn gather(&self, sources: &[usize]) -> Self {
        Self {
            gradient: sources.iter().map(|&row| self.gradient[row]).collect(),
            seen: sources.iter().map(|&row| self.seen[row]).collect(),
        }
    }

    /// Sums of gradients, and how often each Gaussian was seen.
    pub(crate) fn parts(&self) -> (&[f32], &[u32]) {
        (&self.gradient, &self.seen)
    }

    /// Rebuilds statistics from [`DensityStatistics::parts`].
    pub(crate) fn from_parts(gradient: Vec<f32>, seen: Vec<u32>) -> Self {
        Self { gradient, seen }
    }
}

/// What lengths are measured by.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measure {
    /// Centre of the scene.
    pub(crate) centre: [f32; 3],
    /// Its size, world units.
    pub(crate) extent: f32,
}

impl Measure {
    /// The extent, and farther out the distance: what is behind the scene may be larger as it is
    /// farther.
    fn at(self, mean: [f32; 3]) -> f32 {
        let distance = glam::Vec3::from(mean).distance(self.centre.into());
        self.extent.max(distance)
    }
}

/// The rows after a round, and where each came from.
pub(crate) struct Round {
    pub(crate) rows: GaussianRows,
    pub(crate) sources: Vec<usize>,
    /// Whether a row's optimiser moments start anew.
    pub(crate) fresh: Vec<bool>,
}

/// One round: clones small and splits large Gaussians of high gradient, removes the transparent,
/// the oversized (once `prune_large`, where they are to be removed) and the non-finite.
pub(crate) fn control_density(
    rows: &GaussianRows,
    statistics: &DensityStatistics,
    config: &DensityConfig,
    measure: Measure,
    prune_large: bool,
    rng: &mut impl Rng,
) -> Round {
    let n = rows.len();
    let largest = |row: usize| {
        rows.log_scales[row]
            .iter()
            .copied()
            .fold(f32::MIN, f32::max)
            .exp()
    };
    let threshold = config.threshold(n);
    let mut grow: Vec<usize> = (0..n)
        .filter(|&row| statistics.mean(row) >= threshold)
        .collect();
    let room = config.max_gaussians.saturating_sub(n);
    if grow.len() > room {
        grow.sort_by(|&a, &b| {
            statistics
                .mean(b)
                .total_cmp(&statistics.mean(a))
                .then(a.cmp(&b))
        });
        grow.truncate(room);
        grow.sort_unstable();
    }
    let mut split = vec![false; n];
    let mut clones = Vec::new();
    for &row in &grow {
        if largest(row) <= config.clone_scale * measure.at(rows.means[row]) {
            clones.push(row);
        } else {
            split[row] = true;
        }
    }
    let min_logit = dash_model::logit(config.min_opacity);
    let stays = |row: usize| {
        let finite = rows.means[row]
            .iter()
            .chain(&rows.log_scales[row])
            .all(|v| v.is_finite())
            && rows.opacity_logits[row].is_finite();
        let oversized = prune_large
            && config.oversized == Oversized::Removed
            && largest(row) > config.max_scale * measure.at(rows.means[row]);
        finite && !oversized && rows.opacity_logits[row] >= min_logit
    };

    let mut sources: Vec<usize> = (0..n).filter(|&row| stays(row) && !split[row]).collect();
    let mut fresh = vec![false; sources.len()];
    sources.extend(clones.iter().filter(|&&row| stays(row)));
    let first_child = sources.len();
    for row in (0..n).filter(|&row| stays(row) && split[row]) {
        sources.extend([row, row]);
    }
    fresh.resize(sources.len(), true);

    let mut edited = rows.gather(&sources);
    for (child, &parent) in sources.iter().enumerate().skip(first_child) {
        let offset = sample(&rows.quats[parent], &rows.log_scales[parent], rng);
        for (axis, offset) in offset.into_iter().enumerate() {
            edited.means[child][axis] += offset;
            edited.log_scales[child][axis] -= SPLIT_SHRINK.ln();
        }
    }
    Round {
        rows: edited,
        sources,
        fresh,
    }
}

/// A random point of a Gaussian centred at the origin.
fn sample(quat: &[f32; 4], log_scales: &[f32; 3], rng: &mut impl Rng) -> [f32; 3] {
    let local: [f32; 3] = std::array::from_fn(|axis| normal(rng) * log_scales[axis].exp());
    let norm = quat.iter().map(|v| v * v).sum::<f32>().sqrt().max(1e-12);
    let [w, x, y, z] = quat.map(|v| v / norm);
    glam::Quat::from_xyzw(x, y, z, w)
        .mul_vec3(local.into())
        .into()
}

/// A standard normal number (Box-Muller).
fn normal(rng: &mut impl Rng) -> f32 {
    let radius = (-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt();
    radius * (std::f32::consts::TAU * rng.random::<f32>()).cos()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64;

    use super::super::config::{Preset, TrainConfig};
    use super::*;

    const UNIT: Measure = Measure {
        centre: [1.5, 0.0, 0.0],
        extent: 1.0,
    };

    fn rows() -> GaussianRows {
        let points: Vec<[f32; 3]> = (0..4).map(|i| [i as f32, 0.0, 0.0]).collect();
        let mut rows = GaussianRows::from_points(&points, &[[0.5; 3]; 4], 0, 0.1);
        rows.log_scales = vec![
            [(0.001f32).ln(); 3],
            [(0.5f32).ln(); 3],
            [(0.001f32).ln(); 3],
            [(0.001f32).ln(); 3],
        ];
        rows.opacity_logits[3] = dash_model::logit(0.001);
        rows
    }

    fn statistics(high: &[usize]) -> DensityStatistics {
        let mut statistics = DensityStatistics::new(4);
        for &row in high {
            statistics.gradient[row] = 1.0;
            statistics.seen[row] = 2;
        }
        statistics
    }

    #[test]
    fn small_are_cloned_large_are_split_and_transparent_are_pruned() {
        let config = TrainConfig::preset(Preset::Default).density_static;
        let mut rng = Pcg64::seed_from_u64(1);
        let round = control_density(
            &rows(),
            &statistics(&[0, 1]),
            &config,
            UNIT,
            false,
            &mut rng,
        );
        assert_eq!(round.sources, [0, 2, 0, 1, 1]);
        assert_eq!(round.fresh, [false, false, true, true, true]);
        assert_eq!(
            round.rows.means[2], round.rows.means[0],
            "a clone stays where it was"
        );
        assert_ne!(
            round.rows.means[3], round.rows.means[4],
            "children are drawn apart"
        );
        let shrunk = round.rows.log_scales[3][0].exp();
        assert!((shrunk - 0.5 / 1.6).abs() < 1e-6, "{shrunk}");
    }

    #[test]
    fn the_limit_keeps_the_highest_gradients() {
        let config = DensityConfig {
            max_gaussians: 5,
            ..TrainConfig::preset(Preset::Default).density_static
        };
        let mut many = statistics(&[0, 1, 2]);
        many.gradient[2] = 9.0;
        let mut rng = Pcg64::seed_from_u64(1);
        let round = control_density(&rows(), &many, &config, UNIT, false, &mut rng);
        assert_eq!(round.sources, [0, 1, 2, 2]);
    }

    #[test]
    fn the_more_there_are_the_more_each_has_to_pay_for() {
        let preset = TrainConfig::preset(Preset::Default).density_static;
        let base = preset.gradient_threshold;
        let threshold = |crowd: usize, n: usize| {
            let preset = preset.clone();
            DensityConfig { crowd, ..preset }.threshold(n) / base
        };
        assert_eq!([0, 400, 100_000].map(|n| threshold(0, n)), [1.0; 3]);
        assert_eq!([0, 400, 1_000].map(|n| threshold(400, n)), [1.0, 1.0, 2.5]);

        // Two of four rows, at 2.5 times the threshold: enough where two are a crowd, not where one is.
        let mut paid = statistics(&[0, 1]);
        for row in 0..2 {
            paid.gradient[row] = 2.5 * base * paid.seen[row] as f32;
        }
        let grown = |crowd: usize| {
            let config = DensityConfig {
                crowd,
                ..preset.clone()
            };
            let mut rng = Pcg64::seed_from_u64(1);
            control_density(&rows(), &paid, &config, UNIT, false, &mut rng)
                .rows
                .len()
        };
        assert_eq!((grown(0), grown(2), grown(1)), (5, 5, 3));
    }

    #[test]
    fn broken_are_pruned_and_oversized_unless_they_are_shrunk() {
        let left = |oversized: Oversized| {
            let config = DensityConfig {
                oversized,
                ..TrainConfig::preset(Preset::Default).density_static
            };
            let mut broken = rows();
            broken.means[0][1] = f32::NAN;
            let mut rng = Pcg64::seed_from_u64(1);
            control_density(&broken, &statistics(&[]), &config, UNIT, true, &mut rng).sources
        };
        assert_eq!(left(Oversized::Removed), [2]);
        assert_eq!(left(Oversized::Shrunk), [1, 2]);
    }
}
