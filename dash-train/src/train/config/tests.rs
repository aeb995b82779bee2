use super::*;
use crate::synth;

/// `quick` for a run of a second, in which both sets are there from 30 % on, with some values set.
pub(crate) fn small(assignments: &[&str]) -> TrainConfig {
    let mut config = TrainConfig::preset(Preset::Quick);
    let of_all = [
        "initial_points=[0, 300]",
        "method.stages=[0.1, 0.3]",
        "extensions.following.min_steps=0",
        "extensions.following.handover=0.5",
        "method.motion_floor=0",
        "method.static_quantile=0.5",
        "method.motion_field.log2_hashmap_size=8",
        "method.field.log2_hashmap_size=8",
        "method.field.hidden=8",
    ];
    for assignment in of_all.iter().chain(assignments) {
        config.set(assignment).expect("a known key");
    }
    config
}

#[test]
fn every_preset_is_valid_and_survives_toml() {
    for preset in [
        Preset::Default,
        Preset::Paper,
        Preset::Reference,
        Preset::Quick,
        Preset::Best,
    ] {
        let config = TrainConfig::preset(preset);
        config.validate().expect("valid");
        let text = toml::to_string(&config).expect("serialises");
        assert_eq!(
            toml::from_str::<TrainConfig>(&text).expect("parses"),
            config
        );
    }
}

#[test]
fn set_changes_one_value_and_refuses_others() {
    let mut config = TrainConfig::preset(Preset::Default);
    config.set("dssim=0").expect("a number");
    assert_eq!(config.dssim, 0.0);
    config.set("method.trajectories=linear").expect("a word");
    config.set("method.stages=[0, 0.5]").expect("a list");
    config.set("iterations=2e3").expect("a whole number");
    assert_eq!(config.iterations, 2_000);
    config
        .set("extensions.crowding=on")
        .expect("a section of `quick`");
    config.set("extensions.crowding=off").expect("a section");
    config.set("near_plane=5").expect("an absent option");
    assert_eq!(config.near_plane, Some(5.0));
    config.set(" near_plane = off ").expect("an option");
    assert_eq!(config.near_plane, None);
    config.set("extensions.floaters=none").expect("a section");
    assert!(config.extensions.floaters.is_none());
    config.set("extensions.exposure=none").expect("a section");
    let refused = config.set("extensions.exposure.rate=0.1");
    let refused = refused.expect_err("off").to_string();
    assert!(refused.contains("exposure=on"), "{refused}");
    config.set("extensions.exposure=on").expect("a section");
    config.set("extensions.floaters=on").expect("a section");
    assert_eq!(
        config.extensions,
        TrainConfig::preset(Preset::Default).extensions
    );
    let before = config.clone();
    for (bad, named) in [
        ("dsim=0", "dssim"),
        ("dssim", "KEY=VALUE"),
        ("dssim=2", "dssim"),
        ("dssim=abc", "a number such as 0.2, found `abc`"),
        ("seed=-1", "a whole number of at least 0"),
        ("seed=0.5", "a whole number of at least 0"),
        ("preset=quick", "--preset"),
        ("method.stages=0.5", "two numbers such as [0.1, 0.35]"),
        (
            "extensions.gaps.steadiness=nan",
            "extensions.gaps.steadiness",
        ),
        ("densify.static.during=[0.9, 0.1]", "densify.static.during"),
        (
            "densify.static.max_gaussians=0",
            "densify.static.max_gaussians",
        ),
        ("initial_points=[0, 0]", "initial_points"),
        ("method.smoothness_share=0", "method.smoothness_share"),
        ("method.smoothness_share=1.1", "method.smoothness_share"),
        ("method.smoothness_interval=0", "method.smoothness_interval"),
        (
            "extensions.appearance.change=0",
            "extensions.appearance.change",
        ),
        ("extensions.gaps.coarsen=0", "extensions.gaps.coarsen"),
        ("extensions.gaps.coarsen=1.1", "extensions.gaps.coarsen"),
        ("near_plane=0", "near_plane"),
        (
            "extensions.demotion.interval=0",
            "extensions.demotion.interval",
        ),
        (
            "extensions.prune.max_loss_db=0",
            "extensions.prune.max_loss_db",
        ),
        ("densify.pixels=0", "densify.pixels"),
        ("densify.interval=0", "densify.interval"),
        (
            "densify.gradient_threshold=-1",
            "densify.gradient_threshold",
        ),
        (
            "densify.opacity_reset_interval=0",
            "densify.opacity_reset_interval",
        ),
        ("method.stages=[0.5, 0.4]", "method.stages"),
        ("method.field.hidden=0", "method.field.hidden"),
        ("method.field.resolution=[0, 4]", "method.field.resolution"),
        ("initial_points=[9, 4]", "initial_points"),
        ("iterations=x", "iterations"),
        ("a.b=1", "no key `a`"),
    ] {
        let refused = config.set(bad).expect_err(bad).to_string();
        assert!(refused.contains(named), "{bad}: {refused}");
        assert_eq!(config, before, "{bad}");
    }
}

#[test]
fn ranges_name_the_value_that_was_found() {
    let mut config = TrainConfig::preset(Preset::Quick);
    config.densify.dynamic.during[1] = -0.25;
    let refused = config.validate().expect_err("negative").to_string();
    for said in ["densify.dynamic.during", "-0.25", "at least 0"] {
        assert!(refused.contains(said), "{refused}");
    }
}

#[test]
fn time_resolutions_follow_from_the_frames() {
    use crate::train::core::CaptureFacts;
    use crate::train::paper::TimeResolution::{self, Fixed, PerFrame, UpToFrames};
    let cells = |time: TimeResolution, n_frames: usize, is_synchronized: bool| {
        time.cells(&CaptureFacts {
            n_frames,
            is_synchronized,
        })
    };
    assert_eq!(cells(UpToFrames(4), 24, false), [4, 12]);
    assert_eq!(cells(UpToFrames(4), 5, false), [3, 3]);
    assert_eq!(cells(PerFrame, 24, false), [12, 12]);
    assert_eq!(cells(UpToFrames(4), 24, true), [4, 23]);
    assert_eq!(cells(UpToFrames(4), 5, true), [4, 4]);
    assert_eq!(cells(PerFrame, 24, true), [23, 23]);
    for frames in [0, 1, 2, 3] {
        assert_eq!(cells(UpToFrames(4), frames, true), [2, 2], "{frames}");
    }
    for is_synchronized in [false, true] {
        assert_eq!(cells(Fixed([8, 25]), 24, is_synchronized), [8, 25]);
    }
}

#[test]
fn larger_pictures_have_more_gaussians_where_the_preset_says_for_which_it_is() {
    let most = |preset: Preset, pixels: usize| {
        let config = TrainConfig::preset(preset).for_pictures(pixels);
        let densify = config.densify;
        let [fewest, _] = config.initial_points;
        [
            fewest,
            densify.static_set.max_gaussians,
            densify.dynamic.max_gaussians,
        ]
    };
    for pixels in [0, 5_000, 20_000] {
        assert_eq!(most(Preset::Quick, pixels), [6_000, 10_000, 4_000]);
    }
    assert_eq!(most(Preset::Quick, 80_000), [12_000, 20_000, 8_000]);
    for preset in [
        Preset::Default,
        Preset::Best,
        Preset::Paper,
        Preset::Reference,
    ] {
        assert_eq!(most(preset, 80_000), most(preset, 20_000));
    }
}

#[test]
fn only_what_several_cameras_show_at_once_has_more_gaussians_for_larger_pictures() {
    let mut preset = TrainConfig::preset(Preset::Quick);
    preset.densify.pixels = Some(300);
    let rig = synth::loaded(6, 3, [40, 30]);
    let most = |dataset: &Dataset| preset.for_capture(dataset).densify.dynamic.max_gaussians;
    assert_eq!(most(&rig), 8_000);
    let mut in_turns = rig.clone();
    in_turns
        .views
        .retain(|view| view.camera_index % 3 == view.frame);
    assert_eq!(most(&in_turns), 4_000);
}

#[test]
fn many_views_are_given_more_steps() {
    // 5 training cameras of 6, less a view held out for validation.
    let dataset = synth::loaded(6, 8, [32, 24]);
    let views = dataset.views_of(Partition::Train).count();
    let mut config = TrainConfig::preset(Preset::Quick);
    assert_eq!(config.steps_for(&dataset), 6_000);
    config.iterations = 50;
    assert_eq!(config.steps_for(&dataset), 2 * views);
    config.visits = None;
    assert_eq!(config.steps_for(&dataset), 50);
    config.visits = Some(0);
    config.validate().expect_err("at least 1");
}
