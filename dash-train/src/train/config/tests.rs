use super::*;

/// `quick` for a run of a second, in which both sets are there from 30 % on, with some values set.
pub(crate) fn small(assignments: &[&str]) -> TrainConfig {
    let mut config = TrainConfig::preset(Preset::Quick);
    let of_all = [
        "max_initial_points=300",
        "min_initial_points=0",
        "stages.warmup=0.1",
        "stages.min_following=0",
        "stages.settle=0.5",
        "stages.decomposition=0.3",
        "decomposition.floor=0",
        "decomposition.quantile=0.5",
        "decomposition.encoder.log2_hashmap_size=8",
        "field.deformation.encoder.log2_hashmap_size=8",
        "field.deformation.hidden=8",
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

/// Keys that came after the first runs were made.
#[test]
fn what_older_runs_do_not_say_is_as_it_was() {
    let config = TrainConfig::preset(Preset::Paper);
    let text = toml::to_string(&config).expect("serialises");
    let newer = [
        "means_in_turns",
        "at_once",
        "cells_with_gaps",
        "steadiness",
        "moved_share",
        "smoothness_share",
        "smoothness_interval",
        "nearness",
        "found_places",
        "crowd",
        "promote_floor",
        "matching_floor",
        "averaged",
    ];
    let is_newer = |line: &&str| newer.iter().any(|key| line.starts_with(key));
    let older: Vec<&str> = text.lines().filter(|line| !is_newer(line)).collect();
    // Both sets have a crowd, each by two keys.
    assert_eq!(text.lines().count() - older.len(), newer.len() + 3);
    let read = toml::from_str::<TrainConfig>(&older.join("\n")).expect("parses");
    assert_eq!(read, config);
}

#[test]
fn set_changes_one_value_and_refuses_others() {
    let mut config = TrainConfig::preset(Preset::Default);
    config.set("loss.dssim=0").expect("a number");
    assert_eq!(config.loss.dssim, 0.0);
    config.set("decomposition.basis=linear").expect("a word");
    config.set("background=[1, 1.0, 1]").expect("a list");
    config
        .set("learning_rates.extent=5.0")
        .expect("an absent option");
    for bad in [
        "loss.dsim=0",
        "loss.dssim",
        "loss.dssim=2",
        "loss.static_opacity=-0.1",
        "loss.nearness=-0.1",
        "loss.moved_share=1.1",
        "loss.visible_motion=nan",
        "loss.smoothness_share=0",
        "field.cells_with_gaps=0",
        "field.cells_with_gaps=1.1",
        "loss.smoothness_share=1.1",
        "loss.smoothness_interval=0",
        "near_plane=0",
        "density_static.max_scale=0",
        "density_dynamic.max_scale=nan",
        "gap_steps=0.5",
        "decomposition.promote_floor=-0.1",
        "decomposition.matching_floor=-0.1",
        "density_dynamic.crowd_of_split=-1",
        "decomposition.basis={polyline={spans=4, anchor=1.1}}",
        "iterations=x",
        "a.b=1",
    ] {
        assert!(config.set(bad).is_err(), "{bad}");
    }
}

#[test]
fn zeros_of_time_follow_from_the_frames() {
    let resolutions = |base: u32, finest: u32, n_frames: usize, seen_at_once: bool| {
        let mut config = TrainConfig::preset(Preset::Default);
        let encoder = &mut config.field.deformation.encoder;
        encoder.base_resolution[3] = base;
        encoder.finest_resolution[3] = finest;
        let fitted = config.for_frames(n_frames, seen_at_once);
        let fitted = fitted.field.deformation.encoder;
        [fitted.base_resolution[3], fitted.finest_resolution[3]]
    };
    assert_eq!(resolutions(4, 0, 24, false), [4, 12]);
    assert_eq!(resolutions(4, 0, 5, false), [3, 3]);
    assert_eq!(resolutions(0, 0, 24, false), [12, 12]);
    assert_eq!(resolutions(4, 0, 24, true), [4, 23]);
    assert_eq!(resolutions(4, 0, 5, true), [4, 4]);
    assert_eq!(resolutions(0, 0, 24, true), [23, 23]);
    for frames in [0, 1, 2, 3] {
        assert_eq!(resolutions(4, 0, frames, true), [2, 2], "{frames}");
    }
    for seen_at_once in [false, true] {
        assert_eq!(resolutions(0, 9, 24, seen_at_once), [9, 9]);
        assert_eq!(resolutions(4, 9, 24, seen_at_once), [4, 9]);
    }
}

#[test]
fn gaps_make_the_field_coarser_in_space_once() {
    let coarsened = |factor: f32| {
        let mut config = TrainConfig::preset(Preset::Quick);
        config.field.cells_with_gaps = factor;
        config.field.deformation.encoder.base_resolution = vec![1, 5, 4, 7];
        config.field.deformation.encoder.finest_resolution = vec![16, 16, 9, 12];
        config.coarsen_for_gaps();
        let once = config.clone();
        config.coarsen_for_gaps();
        assert_eq!(config, once);
        let encoder = once.field.deformation.encoder;
        [encoder.base_resolution, encoder.finest_resolution]
    };
    assert_eq!(coarsened(0.25), [[1, 2, 1, 7], [4, 4, 3, 12]]);
    assert_eq!(coarsened(1.0), [[1, 5, 4, 7], [16, 16, 9, 12]]);
}
