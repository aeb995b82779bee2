//! Means, masks and rounding of scores.

use burn::tensor::Device;
use dash_model::{Gaps, Gaussians, OffsetPlacement, SceneSettings, TrajectoryBasis};

use super::*;
use crate::synth;

#[test]
fn means_leave_out_nothing_that_is_broken() {
    assert_eq!(mean_of_all([Some(1.0), Some(3.0)].into_iter()), Some(2.0));
    assert_eq!(mean_of_all([Some(1.0), None].into_iter()), None);
    assert_eq!(mean_of_all([].into_iter()), None);
    assert_eq!(mean_of_some([4.0].into_iter()), Some(4.0));
    assert_eq!(mean_of_some([].into_iter()), None);
}

/// Two cameras and three frames of a room in which a ball moves.
fn room() -> Dataset {
    synth::loaded(2, 3, [24, 18])
}

#[test]
fn of_a_single_picture_the_mask_says_what_moves() {
    let mut dataset = room();
    let all = dataset
        .views_of(Partition::Test)
        .next()
        .expect("has one")
        .clone();
    let marked: Vec<bool> = all
        .motion_mask()
        .expect("in memory")
        .expect("true")
        .iter()
        .map(|&m| m > 0)
        .collect();
    let of_the_video = camera_moving_pixels(&dataset, &all, [0.0; 3]).expect("in memory");
    assert!(of_the_video != marked, "the video has other moments, too");
    dataset.views.retain(|view| view.name == all.name);
    assert_eq!(
        camera_moving_pixels(&dataset, &all, [0.0; 3]).expect("in memory"),
        marked
    );
    dataset.views[0].motion_mask = None;
    let none = camera_moving_pixels(&dataset, &dataset.views[0], [0.0; 3]).expect("in memory");
    assert!(none.iter().all(|moves| !moves));
}

#[test]
fn an_empty_scene_scores_its_background() {
    let dataset = room();
    let scene = DynamicScene {
        static_set: Gaussians::from_rows(&Default::default(), &Device::flex()),
        dynamic: None,
        settings: SceneSettings {
            background: [0.5; 3],
            sh_degree: 0,
            near_plane: 0.2,
            trajectory_basis: TrajectoryBasis::polyline(4),
            offsets: OffsetPlacement::BeforeActivation,
            gaps: Gaps::default(),
        },
    };
    let scores =
        evaluate(&scene, &dataset, Partition::Test, 1.0, &Default::default()).expect("scored");
    assert_eq!((scores.n_static, scores.n_dynamic), (0, 0));
    assert_eq!(scores.per_view.len(), 3);
    let shown = 128.0 / 255.0;
    let mut sum = 0.0;
    for (view, got) in dataset.views_of(Partition::Test).zip(&scores.per_view) {
        let truth = view.rgb([0.0; 3]).expect("in memory");
        let errors = truth.iter().map(|v| f64::from(v - shown).powi(2));
        let expected = -10.0 * (errors.sum::<f64>() / truth.len() as f64).log10();
        let got = got.psnr.expect("defined");
        assert!(
            (got - expected).abs() < 1e-4,
            "got {got}, expected {expected}"
        );
        sum += got;
    }
    assert!((scores.psnr.expect("defined") - sum / 3.0).abs() < 1e-9);
    assert!(scores.psnr_dynamic.is_some(), "the ball moves");
    let decomposition = scores.decomposition.expect("the room has true masks");
    assert_eq!(decomposition.recall, 0.0);
}

#[test]
fn rounding_is_that_of_a_saved_picture() {
    assert_eq!(as_saved(-0.2), 0.0);
    assert_eq!(as_saved(1.7), 1.0);
    assert_eq!(as_saved(0.5), 128.0 / 255.0);
    assert!(as_saved(f32::NAN).is_nan());
}
