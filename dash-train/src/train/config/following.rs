//! Stages of runs that are too short for the shares of their preset.

use dash_model::TrajectoryBasis;

use super::{Selection, TimeWindow, TrainConfig};

/// The form of the shortest runs, as shares like those of the configuration: most steps follow motion,
/// since what was lost then no later stage finds again.
const SHORT_WARMUP: f32 = 0.06;
const SHORT_DECOMPOSITION: f32 = 0.6;
const SHORT_SETTLE: f32 = 0.85;
/// The ends of the static and of the dynamic Gaussians' density control in them.
const SHORT_DENSITIES: [f32; 2] = [0.75, 0.85];

impl TrainConfig {
    /// Trajectories start from where things are at `time`, if motion is followed from there.
    pub(crate) fn follow_from(&mut self, time: f32) {
        if self.stages.window == TimeWindow::Growing {
            let basis = &mut self.decomposition.basis;
            // A line is a polyline of one span.
            *basis = TrajectoryBasis::Polyline {
                spans: basis.len(),
                anchor: time,
            };
        }
    }

    /// Moves the stages towards the form of the shortest runs, as far as it takes to leave
    /// [`min_following`](super::StageConfig::min_following) steps: following takes of the time in which every
    /// Gaussian goes alone first, then of the warm-up, and only then puts off the split.
    pub(crate) fn make_room_for_following(&mut self) {
        let stages = &mut self.stages;
        let follows = self.decomposition.enabled
            && self.decomposition.select == Selection::Moving
            && stages.window == TimeWindow::Growing;
        let share = stages.settle * (stages.decomposition - stages.warmup);
        let step = 1.0 / self.iterations as f32;
        let shortest_warmup = stages.warmup.min(SHORT_WARMUP);
        let latest_split = stages.decomposition.max(SHORT_DECOMPOSITION);
        let settle = stages.settle.max(SHORT_SETTLE);
        let most = settle * (latest_split - shortest_warmup);
        let needed = (stages.min_following as f32 * step).min(most);
        // A part of a step is none: what was moved before stays as it is.
        if !follows || needed <= share + 0.5 * step {
            return;
        }
        let length = needed / settle;
        let split = stages.decomposition;
        stages.warmup = (split - length).clamp(shortest_warmup, stages.warmup);
        stages.decomposition = split.max(stages.warmup + length);
        stages.settle = (needed / (stages.decomposition - stages.warmup)).min(1.0);
        if stages.decomposition > split {
            let way = (stages.decomposition - split) / (latest_split - split);
            let densities = [&mut self.density_static, &mut self.density_dynamic];
            for (density, until) in densities.into_iter().zip(SHORT_DENSITIES) {
                if density.until > 0.0 {
                    density.until += way * (until - density.until).max(0.0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::Preset;

    /// Steps of the warm-up, of following, until the split, and until the end of both density controls.
    fn stages(preset: Preset, iterations: usize, set: &[&str]) -> [usize; 5] {
        let mut config = TrainConfig::preset(preset);
        config.iterations = iterations;
        for assignment in set {
            config.set(assignment).expect("a known key");
        }
        config.make_room_for_following();
        config.validate().expect("valid");
        let once = config.clone();
        config.make_room_for_following();
        assert_eq!(config, once, "a checkpoint's configuration changes no more");
        let stages = &config.stages;
        let following = stages.settle * (stages.decomposition - stages.warmup);
        [
            stages.warmup,
            following,
            stages.decomposition,
            config.density_static.until,
            config.density_dynamic.until,
        ]
        .map(|share| config.step_at(share))
    }

    #[test]
    fn what_is_followed_from_a_time_is_at_rest_then() {
        let followed = |set: &[&str]| {
            let mut config = TrainConfig::preset(Preset::Quick);
            for assignment in set {
                config.set(assignment).expect("a known key");
            }
            let mut config = config.for_frames(24, true);
            config.follow_from(0.5);
            config.validate().expect("valid");
            config.decomposition.basis
        };
        let line = followed(&["decomposition.basis=linear"]);
        assert_eq!(
            (line.at(0.0), line.at(0.5), line.at(1.0)),
            (vec![-0.5], vec![0.0], vec![0.5])
        );
        let polyline = followed(&[]);
        assert_eq!((polyline.len(), polyline.anchor()), (12, 0.5));
        let paper = followed(&["decomposition.basis=linear", "stages.window=all"]);
        assert_eq!(paper, TrajectoryBasis::Linear);
    }

    #[test]
    fn short_runs_follow_for_as_many_steps_as_there_can_be() {
        let quick = |iterations| stages(Preset::Quick, iterations, &[]);
        // 0.95 (0.45 - 0.1) 6,000 = 1,995 are enough.
        assert_eq!(quick(6_000), [600, 1_995, 2_700, 3_600, 4_200]);
        // 0.95 (0.6 - 0.06) 1,500 = 770 are all that there can be.
        assert_eq!(quick(1_500), [90, 770, 900, 1_125, 1_275]);
        assert_eq!(quick(200), [12, 103, 120, 150, 170]);
        // The warm-up gives way before the split does.
        let [warmup, following, split, end_static, end_dynamic] = quick(2_300);
        assert_eq!([following, split], [800, 1_035]);
        assert!((150..230).contains(&warmup), "{warmup}");
        assert_eq!([end_static, end_dynamic], [1_380, 1_610]);
        let [warmup, following, split, end_static, end_dynamic] = quick(2_000);
        assert_eq!((warmup, following), (120, 800));
        assert!((900..1_200).contains(&split), "{split}");
        assert!((1_200..1_500).contains(&end_static), "{end_static}");
        assert!((1_400..1_700).contains(&end_dynamic), "{end_dynamic}");
    }

    #[test]
    fn runs_that_need_no_more_steps_keep_their_shares() {
        let default = |set: &[&str]| stages(Preset::Default, 15_000, set);
        assert_eq!(default(&[]), [1_500, 2_625, 5_250, 9_000, 10_500]);
        let short = |set: &[&str]| stages(Preset::Quick, 1_000, set);
        let as_set = [100, 332, 450, 600, 700];
        assert_eq!(short(&["stages.min_following=0"]), as_set);
        assert_eq!(short(&["stages.window=all"]), as_set);
        assert_eq!(short(&["decomposition.select=all"]), as_set);
        // Later stages than those of a short run stay where they are.
        assert_eq!(
            short(&[
                "stages.decomposition=0.9",
                "stages.settle=1",
                "stages.min_following=1000"
            ]),
            [60, 840, 900, 600, 700]
        );
        assert_eq!(short(&["density_dynamic.until=0"]), [60, 513, 600, 750, 0]);
        assert_eq!(
            stages(Preset::Paper, 1_000, &[]),
            stages(Preset::Paper, 1_000, &["stages.min_following=0"])
        );
    }
}
