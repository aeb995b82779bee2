//! How many Gaussians there may be.

use super::{DensityConfig, TrainConfig};

impl DensityConfig {
    /// The gradient above which one of `n` Gaussians is cloned or split.
    pub(crate) fn threshold(&self, n: usize) -> f32 {
        match self.crowd {
            0 => self.gradient_threshold,
            crowd => self.gradient_threshold * (n as f32 / crowd as f32).max(1.0),
        }
    }

    /// Takes note of how many Gaussians the split made dynamic. Where cameras take turns, each time has one picture, and
    /// more Gaussians than that number cost time and show nothing more.
    pub(crate) fn after_split(&mut self, n: usize, shown_at_once: bool) {
        if self.crowd > 0 && shown_at_once {
            self.crowd = self.crowd.max((self.crowd_of_split * n as f32) as usize);
        }
    }
}

impl TrainConfig {
    /// Most static Gaussians: those of both kinds in a run in which nothing may move.
    pub(crate) fn most_static(&self, may_move: bool) -> usize {
        let others = if may_move {
            0
        } else {
            self.density_dynamic.max_gaussians
        };
        self.density_static.max_gaussians.saturating_add(others)
    }

    /// Most dynamic Gaussians beside so many static ones.
    pub(crate) fn most_dynamic(&self, n_static: usize) -> usize {
        let left = self.density_static.max_gaussians.saturating_sub(n_static);
        self.density_dynamic.max_gaussians.saturating_add(left)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::Preset;

    #[test]
    fn half_of_what_the_split_makes_dynamic_is_no_crowd_where_much_moves() {
        let crowd_after = |n: usize, shown_at_once: bool, set: &[&str]| {
            let mut config = TrainConfig::preset(Preset::Quick);
            for assignment in set {
                config.set(assignment).expect("a known key");
            }
            config.density_dynamic.after_split(n, shown_at_once);
            config.density_dynamic.crowd
        };
        let after = |n, set: &[&str]| crowd_after(n, true, set);
        assert_eq!(
            [0, 800, 900, 6_000].map(|n| after(n, &[])),
            [400, 400, 450, 3_000]
        );
        assert_eq!(
            after(6_000, &["density_dynamic.crowd=0"]),
            0,
            "none stays none"
        );
        assert_eq!(after(6_000, &["density_dynamic.crowd_of_split=0"]), 400);
        assert_eq!(crowd_after(6_000, false, &[]), 400, "in turns");
    }

    #[test]
    fn dynamic_gaussians_have_what_static_ones_leave() {
        let config = TrainConfig::preset(Preset::Quick);
        let most = [0, 9_000, 10_000, 11_000].map(|n| config.most_dynamic(n));
        assert_eq!(most, [14_000, 5_000, 4_000, 4_000]);
    }

    #[test]
    fn static_gaussians_have_what_dynamic_ones_never_need() {
        let config = TrainConfig::preset(Preset::Quick);
        assert_eq!(
            [true, false].map(|m| config.most_static(m)),
            [10_000, 14_000]
        );
    }
}
