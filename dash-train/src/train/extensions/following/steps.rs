//! Stages of runs that are too short to follow motion within the shares of their preset.

use crate::train::core::Run;
use crate::train::paper::{Dash, Decomposition};

/// The form of the shortest runs, as shares like those of the configuration: most steps follow motion, since no later
/// stage finds again what was lost then.
const SHORT_WARMUP: f32 = 0.06;
const SHORT_DECOMPOSITION: f32 = 0.6;
const SHORT_HANDOVER: f32 = 0.85;
/// The ends of the static and of the dynamic Gaussians' density control in them.
const SHORT_DENSIFY: [f32; 2] = [0.75, 0.85];

/// Moves the stages towards the form of the shortest runs, as far as it takes to leave `min_steps` for following: following
/// takes of the time in which every Gaussian goes alone first, then of the warm-up, and only then puts off the
/// decomposition.
pub(super) fn lengthen(run: &mut Run<Dash>, min_steps: usize) {
    let follows = matches!(
        run.method.config.decomposition,
        Decomposition::Moving | Decomposition::AllWithMotion
    );
    let [warmup, end] = run.method.config.stages;
    let share = run.method.handover * (end - warmup);
    let step = 1.0 / run.config.iterations as f32;
    let shortest_warmup = warmup.min(SHORT_WARMUP);
    let latest_end = end.max(SHORT_DECOMPOSITION);
    let handover = run.method.handover.max(SHORT_HANDOVER);
    let most = handover * (latest_end - shortest_warmup);
    let needed = (min_steps as f32 * step).min(most);
    // A part of a step is none: stages that were moved before stay.
    if !follows || needed <= share + 0.5 * step {
        return;
    }
    let length = needed / handover;
    let warmup = (end - length).clamp(shortest_warmup, warmup);
    let moved_end = end.max(warmup + length);
    run.method.config.stages = [warmup, moved_end];
    run.method.handover = (needed / (moved_end - warmup)).min(1.0);
    if moved_end > end {
        let way = (moved_end - end) / (latest_end - end);
        let densify = &mut run.config.densify;
        let sets = [&mut densify.static_set, &mut densify.dynamic];
        for (set, until) in sets.into_iter().zip(SHORT_DENSIFY) {
            if set.during[1] > set.during[0] {
                set.during[1] += way * (until - set.during[1]).max(0.0);
            }
        }
    }
}

/// Most steps that scene flow leaves to the warm-up, which sees one frame.
pub(crate) const FLOW_WARMUP: usize = 480;
/// Fewest and most steps in which Gaussians come to rest behind it, and the share of the shortest runs that is enough.
pub(crate) const FLOW_REST: [usize; 2] = [210, 840];
const SHORTEST_REST: f32 = 0.14;
/// Steps for each frame for which scene flow puts off the decomposition, and the latest that it is put off to.
pub(crate) const FRAME_STEPS: usize = 12;
pub(crate) const FLOW_END: f32 = 0.5;

/// The stages of a rig's run of `iterations` steps and the handover in them, moved so that scene flow has the steps that the
/// stages around it do not need. They are as asked for, in shares of the run: the ends of warm-up and decomposition, and the
/// handover between them.
pub(crate) fn stages_of_flow(
    [warmup, end]: [f32; 2],
    handover: f32,
    iterations: usize,
    n_times: usize,
) -> ([f32; 2], f32) {
    let share = |steps: usize| steps as f32 / iterations as f32;
    let [fewest, most] = FLOW_REST.map(share);
    let fewest = fewest.min(SHORTEST_REST);
    let rest = ((1.0 - handover) * (end - warmup)).clamp(fewest, most.max(fewest));
    let warmup = warmup.min(share(FLOW_WARMUP));
    let flow = share(FRAME_STEPS * n_times);
    let end = (warmup + flow + rest).clamp(end, end.max(FLOW_END));
    let handover = 1.0 - rest / (end - warmup).max(f32::MIN_POSITIVE);
    ([warmup, end], handover.max(0.0))
}

/// Moves the stages as [`stages_of_flow`] does.
pub(super) fn lengthen_for_flow(run: &mut Run<Dash>) {
    (run.method.config.stages, run.method.handover) = stages_of_flow(
        run.method.config.stages,
        run.method.handover,
        run.config.iterations,
        run.times.all().len(),
    );
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::Device;
    use dash_model::TrajectoryBasis;

    use crate::synth;
    use crate::train::{Preset, TrainConfig, Trainer};

    /// A run of a synchronised rig of 24 frames, with extensions told that it begins.
    fn begun(preset: Preset, iterations: usize, set: &[&str]) -> Trainer {
        begun_with(24, preset, iterations, set)
    }

    fn begun_with(frames: usize, preset: Preset, iterations: usize, set: &[&str]) -> Trainer {
        let mut config = TrainConfig::preset(preset);
        config.iterations = iterations;
        config.initial_points = [50, 50];
        for assignment in ["extensions.prune=none"].iter().chain(set) {
            config.set(assignment).expect("a known key");
        }
        let dataset = Arc::new(synth::loaded(6, frames, [32, 24]));
        let mut trainer = Trainer::new(config, dataset, &Device::flex()).expect("valid");
        for _ in 0..2 {
            // A resumed run begins again: its stages change no more.
            for extension in &mut trainer.hooks.extensions {
                extension.begin(&mut trainer.run).expect("begins");
            }
        }
        trainer
    }

    /// Without scene flow, as a monocular capture.
    const NO_FLOW: &str = "method.trajectories=linear";

    /// Steps of the warm-up, of following, until the decomposition, and until the end of both density controls.
    fn stages(preset: Preset, iterations: usize, set: &[&str]) -> [usize; 5] {
        let set = [&[NO_FLOW], set].concat();
        let run = begun(preset, iterations, &set).run;
        let [warmup, decomposition] = run.method.config.stages;
        let following = run.method.handover * (decomposition - warmup);
        let densify = &run.config.densify;
        let ends = [densify.static_set.during[1], densify.dynamic.during[1]];
        [warmup, following, decomposition, ends[0], ends[1]].map(|share| run.config.step_at(share))
    }

    #[test]
    fn what_is_followed_from_a_time_is_at_rest_then() {
        let followed = |set: &[&str]| {
            let run = begun(Preset::Quick, 6_000, set).run;
            assert_eq!(run.scene.settings.trajectory_basis, run.method.basis);
            (run.method.basis, run.start.expect("cameras stand").middle())
        };
        let (line, middle) = followed(&["method.trajectories=linear"]);
        assert!((middle - 0.5).abs() < 0.05 && line.at(middle) == [0.0]);
        assert!((line.at(1.0)[0] - (1.0 - middle)).abs() < 1e-6);
        let (polyline, _) = followed(&[]);
        assert_eq!(polyline.len(), 12);
        assert!((polyline.anchor() - middle).abs() < 1e-6);
        let (paper, _) = followed(&["method.trajectories=linear", "extensions.following=none"]);
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
        // The warm-up gives way before the decomposition does.
        let [warmup, following, end, end_static, end_dynamic] = quick(2_300);
        assert_eq!([following, end], [800, 1_035]);
        assert!((150..230).contains(&warmup), "{warmup}");
        assert_eq!([end_static, end_dynamic], [1_380, 1_610]);
        let [warmup, following, end, end_static, end_dynamic] = quick(2_000);
        assert_eq!((warmup, following), (120, 800));
        assert!((900..1_200).contains(&end), "{end}");
        assert!((1_200..1_500).contains(&end_static), "{end_static}");
        assert!((1_400..1_700).contains(&end_dynamic), "{end_dynamic}");
    }

    #[test]
    fn runs_that_need_no_more_steps_keep_their_shares() {
        let default = |set: &[&str]| stages(Preset::Default, 15_000, set);
        assert_eq!(default(&[]), [1_500, 2_625, 5_250, 9_000, 10_500]);
        let short = |set: &[&str]| stages(Preset::Quick, 1_000, set);
        let unmoved = [100, 332, 450, 600, 700];
        assert_eq!(short(&["extensions.following.min_steps=0"]), unmoved);
        assert_eq!(short(&["method.decomposition=all"]), unmoved);
        let all_times = short(&["extensions.following=none"]);
        assert_eq!(all_times, [100, 350, 450, 600, 700]);
        // Later stages than those of a short run stay where they are.
        assert_eq!(
            short(&[
                "method.stages=[0.1, 0.9]",
                "extensions.following.handover=1",
                "extensions.following.min_steps=1000"
            ]),
            [60, 840, 900, 600, 700]
        );
        assert_eq!(
            short(&["densify.dynamic.during=[0, 0]"]),
            [60, 513, 600, 750, 0]
        );
    }

    /// The last steps of the warm-up, of scene flow, and before the decomposition.
    fn flow_stages(frames: usize, iterations: usize, set: &[&str]) -> [usize; 3] {
        let stages = begun_with(frames, Preset::Quick, iterations, set)
            .run
            .stages();
        [stages.warmup, stages.handover, stages.end]
    }

    #[test]
    fn scene_flow_has_what_the_stages_around_it_do_not_need() {
        // Few steps are shared out: 0.1, 0.45, and between them 210 to come to rest.
        assert_eq!(flow_stages(24, 2_000, &[]), [200, 690, 900]);
        // 480 steps before it and 840 after it are enough.
        assert_eq!(flow_stages(24, 20_000, &[]), [480, 8_160, 9_000]);
        // 12 steps for each of 60 frames put off the decomposition, but not beyond half of the run.
        assert_eq!(flow_stages(60, 2_400, &[]), [240, 960, 1_170]);
        assert_eq!(flow_stages(60, 1_000, &[]), [100, 360, 500]);
        let late = flow_stages(60, 1_000, &["method.stages=[0.1, 0.7]"]);
        assert_eq!(late, [100, 560, 700]);
    }
}
