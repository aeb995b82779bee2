use dash_model::HashEncoderConfig;

use super::*;
use crate::synth;
use crate::train::Preset;

#[test]
fn times_that_no_training_picture_shows_are_gaps() {
    let whole = synth::loaded(4, 11, [32, 24]);
    let mut with_a_gap = whole.clone();
    with_a_gap
        .views
        .retain(|view| view.time < 0.35 || view.time > 0.65);
    let gaps = |dataset: &Dataset, preset: Preset| {
        let config = TrainConfig::preset(preset);
        let trainer = Trainer::new(config, Arc::new(dataset.clone()), &Device::flex());
        trainer.expect("valid").run.scene.settings.gaps
    };
    assert!(gaps(&whole, Preset::Quick).is_empty());
    assert!(gaps(&with_a_gap, Preset::Paper).is_empty());
    let found = gaps(&with_a_gap, Preset::Quick);
    assert_eq!(found.len(), 1);
    let gap = found.interpolation(0.5).expect("not seen");
    assert!((gap.from - 0.3).abs() < 1e-6 && (gap.to - 0.7).abs() < 1e-6);
    assert!((gap.weight - 0.5).abs() < 1e-6 && (gap.observed - 0.3).abs() < 1e-6);
}

/// The field's encoder for those of a dataset's views that are kept.
fn encoder_for(dataset: &Dataset, keep: &dyn Fn(&View) -> bool) -> HashEncoderConfig {
    let mut dataset = dataset.clone();
    dataset.views.retain(|view| keep(view));
    let config = TrainConfig::preset(Preset::Quick);
    let trainer = Trainer::new(config, Arc::new(dataset), &Device::flex()).expect("valid");
    trainer.run.method.field.encoder
}

#[test]
fn cells_of_time_follow_from_what_training_pictures_show() {
    let rig = synth::loaded(6, 11, [32, 24]);
    let cells = |keep: &dyn Fn(&View) -> bool| {
        let encoder = encoder_for(&rig, keep);
        (encoder.base_resolution[3], encoder.finest_resolution[3])
    };
    assert_eq!(cells(&|_| true), (10, 10));
    assert_eq!(cells(&|view| view.frame.is_multiple_of(2)), (5, 5));
    // A monocular capture.
    assert_eq!(cells(&|view| view.camera_index == view.frame % 6), (6, 6));
}

#[test]
fn the_field_is_coarser_in_monocular_captures_with_long_gaps() {
    let rig = synth::loaded(6, 24, [32, 24]);
    let cells = |keep: &dyn Fn(&View) -> bool| encoder_for(&rig, keep).finest_resolution[0];
    let in_turns = |view: &View| view.camera_index == view.frame * 5 % 6;
    let lacks = |view: &View, n: usize| (9..9 + n).contains(&view.frame);
    assert_eq!(cells(&|view| in_turns(view) && !lacks(view, 2)), 16);
    assert_eq!(cells(&|view| in_turns(view) && !lacks(view, 3)), 4);
    assert_eq!(cells(&|view| !lacks(view, 6)), 16);
}
