use dash_model::{HashEncoderConfig, SpaceBox};

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

/// A run of a few steps.
fn short(dataset: &Arc<Dataset>, backdrop: Option<DynamicScene>, steps: usize) -> Trainer {
    let config = TrainConfig {
        iterations: 200,
        ..TrainConfig::preset(Preset::Quick)
    };
    let additions = Additions {
        backdrop,
        ..Default::default()
    };
    let device = Device::flex();
    let mut trainer = Trainer::with(config, dataset.clone(), &device, additions).expect("valid");
    for _ in 0..steps {
        trainer.step().expect("a step");
    }
    trainer
}

/// A room that was trained for a while, and a Gaussian last that is in no picture.
fn room_with_a_ghost(dataset: &Arc<Dataset>) -> DynamicScene {
    let trainer = short(dataset, None, 19);
    let mut room = trainer.whole_scene();
    let mut rows = room.static_set.to_rows();
    rows.trajectories.clear();
    rows.trajectory_width = 0;
    let last = rows.len() - 1;
    let mut ghost = rows.gather(&[last]);
    let SpaceBox { min, max, .. } = trainer.run.region;
    ghost.means[0] = std::array::from_fn(|axis| 0.5 * (min[axis] + max[axis]));
    ghost.log_scales[0] = [(0.1 * trainer.run.extent).ln(); 3];
    ghost.opacity_logits[0] = 6.0;
    ghost.sh_dc[0] = [3.0, -3.0, 3.0];
    rows.append(&ghost);
    room.static_set = Gaussians::from_rows(&rows, &Device::flex());
    room
}

#[test]
fn a_backdrop_does_not_change_where_pictures_show_it() {
    let dataset = Arc::new(synth::loaded(4, 6, [32, 24]));
    let room = room_with_a_ghost(&dataset);
    let rows = room.static_set.to_rows();
    let begun = short(&dataset, Some(room.clone()), 0);
    let backdrop = begun.run.backdrop.as_ref().expect("given");
    let n_kept = backdrop.len();
    assert!(2 * n_kept > rows.len(), "{n_kept} of {}", rows.len());
    // What no picture shows is not kept, but trained on.
    let first = begun.scene().static_set.to_rows();
    assert_eq!(first.means.last(), rows.means.last());
    assert_eq!(begun.whole_scene().counts().0, first.len() + n_kept);
    // The stages that look for what rests are shorter.
    assert_eq!(begun.run.stages().warmup, 4);

    let trained = short(&dataset, Some(room), 12);
    let kept = |trainer: &Trainer| {
        let (own, whole) = (trainer.scene().static_set.len(), trainer.whole_scene());
        let whole = whole.static_set.to_rows();
        whole.gather(&(own..whole.len()).collect::<Vec<usize>>())
    };
    assert_eq!(kept(&trained), kept(&begun));
    let is_of_room = |mean: &[f32; 3]| rows.means.contains(mean);
    assert_eq!(kept(&begun).len(), n_kept);
    assert!(kept(&begun).means.iter().all(is_of_room));
    // Another scene has other Gaussians.
    let choice = trained.run.backdrop.as_ref().expect("given").kept().clone();
    let other = short(&dataset, None, 0);
    let refused = Backdrop::new(other.scene(), choice, &Device::flex());
    assert!(refused.is_err_and(|found| found.contains("where there were")));
}

#[test]
fn a_run_with_a_backdrop_goes_on_from_its_checkpoint() {
    let dataset = Arc::new(synth::loaded(4, 6, [32, 24]));
    let room = room_with_a_ghost(&dataset);
    let folder = tempfile::tempdir().expect("a scratch folder");
    let begun = short(&dataset, Some(room.clone()), 8);
    save_checkpoint(&begun, folder.path(), 1.0).expect("writable");
    let additions = |backdrop: &DynamicScene| Additions {
        backdrop: Some(backdrop.clone()),
        ..Default::default()
    };
    let resume = |room: &DynamicScene| {
        let path = folder.path().join("000008");
        load_checkpoint_with(&path, dataset.clone(), &Device::flex(), additions(room))
    };
    let (mut resumed, _) = resume(&room).expect("whole");
    for _ in 8..14 {
        resumed.step().expect("a step");
    }
    let straight = short(&dataset, Some(room.clone()), 14);
    let [found, expected] = [&resumed, &straight].map(|t| t.whole_scene().static_set.to_rows());
    assert_eq!(found, expected);
    // Another room is refused.
    let mut other = room;
    let mut rows = other.static_set.to_rows();
    rows.means[0][0] += 1.0;
    other.static_set = Gaussians::from_rows(&rows, &Device::flex());
    let refused = resume(&other).err().expect("refused").to_string();
    assert!(refused.contains("backdrop"), "{refused}");
}
