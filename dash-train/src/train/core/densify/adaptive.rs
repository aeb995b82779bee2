//! Adaptive density control as in 3DGS.

use dash_model::GaussianRows;
use rand::Rng;
use rand_pcg::Pcg64;

use super::{Densify, Edit, Round};
use crate::numbers::standard_normal;

/// Largest scale that is cloned rather than split, in units of the extent. Source: 3DGS.
const CLONE_SCALE: f32 = 0.01;
/// A split Gaussian's children are smaller by this factor. Source: 3DGS.
const SPLIT_SHRINK: f32 = 1.6;
/// Opacity below which a Gaussian is pruned. Source: 3DGS.
const MIN_OPACITY: f32 = 0.005;
/// Scale above which a Gaussian is pruned, in units of the extent. Source: 3DGS.
const MAX_SCALE: f32 = 0.1;

/// Clones small and splits large Gaussians of a high screen-space gradient; prunes transparent, oversized and
/// non-finite ones (Kerbl et al. 2023, section 5).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adaptive;

impl Densify for Adaptive {
    fn round(&mut self, round: &Round<'_>, rng: &mut Pcg64) -> Edit {
        let rows = round.rows;
        let (clones, split) = grown(round);
        let stays = |row: usize| stays(round, row);
        let n = rows.len();
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
        Edit {
            rows: edited,
            sources,
            fresh,
        }
    }
}

/// The rows that are cloned, and for each row whether it is split: those of the highest gradients where there is
/// no room for all.
fn grown(round: &Round<'_>) -> (Vec<usize>, Vec<bool>) {
    let (rows, statistics) = (round.rows, round.statistics);
    let n = rows.len();
    let mut grow: Vec<usize> = (0..n)
        .filter(|&row| statistics.mean(row) >= round.rules.gradient_threshold)
        .collect();
    let room = round.max_gaussians.saturating_sub(n);
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
        if largest(rows, row) <= CLONE_SCALE * round.scale.at(rows.means[row]) {
            clones.push(row);
        } else {
            split[row] = true;
        }
    }
    (clones, split)
}

fn stays(round: &Round<'_>, row: usize) -> bool {
    let rows = round.rows;
    let finite = rows.means[row]
        .iter()
        .chain(&rows.log_scales[row])
        .all(|v| v.is_finite())
        && rows.opacity_logits[row].is_finite();
    let oversized = round.was_reset
        && round.rules.prunes_oversized
        && largest(rows, row) > MAX_SCALE * round.scale.at(rows.means[row]);
    finite && !oversized && rows.opacity_logits[row] >= dash_model::logit(MIN_OPACITY)
}

/// The largest scale of a Gaussian, world units.
fn largest(rows: &GaussianRows, row: usize) -> f32 {
    rows.log_scales[row]
        .iter()
        .copied()
        .fold(f32::MIN, f32::max)
        .exp()
}

/// A random point of a Gaussian centred at the origin.
fn sample(quat: &[f32; 4], log_scales: &[f32; 3], rng: &mut impl Rng) -> [f32; 3] {
    let local: [f32; 3] =
        std::array::from_fn(|axis| standard_normal::<f32>(rng) * log_scales[axis].exp());
    let norm = quat.iter().map(|v| v * v).sum::<f32>().sqrt().max(1e-12);
    let [w, x, y, z] = quat.map(|v| v / norm);
    glam::Quat::from_xyzw(x, y, z, w)
        .mul_vec3(local.into())
        .into()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;
    use crate::train::core::{DensifyConfig, DensityStatistics, Rules, SceneScale, Set};
    use crate::train::{Preset, TrainConfig};

    const UNIT: SceneScale = SceneScale {
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

    fn config() -> DensifyConfig {
        TrainConfig::preset(Preset::Default).densify.static_set
    }

    /// Of four Gaussians, each seen twice, by their sums of gradients.
    fn statistics(gradients: [f32; 4]) -> DensityStatistics {
        DensityStatistics::from_totals(gradients.to_vec(), vec![2; 4])
    }

    /// A round with room for so many and this threshold.
    fn round(
        rows: &GaussianRows,
        gradients: [f32; 4],
        (max_gaussians, gradient_threshold): (usize, f32),
        prunes_oversized: bool,
    ) -> Edit {
        let config = config();
        let round = Round {
            set: Set::Static,
            step: 100,
            rows,
            statistics: &statistics(gradients),
            config: &config,
            rules: Rules {
                gradient_threshold,
                prunes_oversized,
            },
            max_gaussians,
            was_reset: true,
            scale: UNIT,
        };
        Adaptive.round(&round, &mut Pcg64::seed_from_u64(1))
    }

    #[test]
    fn small_are_cloned_large_are_split_and_transparent_are_pruned() {
        let edit = round(&rows(), [1.0, 1.0, 0.0, 0.0], (100, 2e-4), false);
        assert_eq!(edit.sources, [0, 2, 0, 1, 1]);
        assert_eq!(edit.fresh, [false, false, true, true, true]);
        let means = &edit.rows.means;
        assert_eq!(means[2], means[0], "a clone stays where it was");
        assert_ne!(means[3], means[4], "children are drawn apart");
        let shrunk = edit.rows.log_scales[3][0].exp();
        assert!((shrunk - 0.5 / 1.6).abs() < 1e-6, "{shrunk}");
    }

    #[test]
    fn the_limit_keeps_the_highest_gradients() {
        let edit = round(&rows(), [1.0, 1.0, 9.0, 0.0], (5, 2e-4), false);
        assert_eq!(edit.sources, [0, 1, 2, 2]);
    }

    #[test]
    fn broken_are_pruned_and_oversized_unless_they_are_shrunk() {
        let left = |prunes_oversized: bool| {
            let mut broken = rows();
            broken.means[0][1] = f32::NAN;
            round(&broken, [0.0; 4], (100, 2e-4), prunes_oversized).sources
        };
        assert_eq!(left(true), [2]);
        assert_eq!(left(false), [1, 2]);
    }
}
