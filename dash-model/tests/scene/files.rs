//! Scenes on disk: what comes back, what is refused.

use burn::tensor::Device;
use dash_model::{DynamicScene, Gaps, Layer, ModelError, OffsetPlacement, TrajectoryBasis};

use crate::common::{devices, pixels, scene, with_large_offsets};

#[test]
fn a_saved_scene_renders_the_same_bits() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    for (index, device) in devices().into_iter().enumerate() {
        for n_dynamic in [None, Some(4)] {
            let scene = scene(6, n_dynamic, OffsetPlacement::BeforeActivation, &device);
            let path = folder.path().join(format!("{index}-{n_dynamic:?}"));
            scene.save(&path).expect("writes");
            let loaded = DynamicScene::load(&path, &device).expect("reads");
            assert_eq!(loaded.settings, scene.settings);
            assert_eq!(
                pixels(&loaded, 0.4, Layer::Full),
                pixels(&scene, 0.4, Layer::Full)
            );
        }
    }
}

#[test]
fn the_anchor_of_trajectories_survives_a_file() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let anchored = |anchor: f32| {
        let device = Device::flex();
        let mut scene = scene(6, Some(4), OffsetPlacement::BeforeActivation, &device);
        scene.settings.trajectory_basis = TrajectoryBasis::Polyline { spans: 4, anchor };
        scene
    };
    let saved = |scene: &DynamicScene, name: &str| {
        let path = folder.path().join(name);
        scene.save(&path).expect("writes");
        let text = std::fs::read_to_string(path.join("scene.json")).expect("reads");
        (DynamicScene::load(&path, &Device::flex()), text)
    };
    let (middle, text) = saved(&anchored(0.5), "middle");
    assert!(text.contains("\"anchor\": 0.5"), "{text}");
    let middle = middle.expect("reads");
    let expected = anchored(0.5);
    for time in [0.0, 0.5, 0.9] {
        let [read, written] = [&middle, &expected].map(|s| pixels(s, time, Layer::Full));
        assert_eq!(read, written);
    }
    let start = pixels(&anchored(0.0), 0.9, Layer::Full);
    assert_ne!(pixels(&middle, 0.9, Layer::Full), start);
    let (plain, text) = saved(&anchored(0.0), "start");
    plain.expect("reads");
    assert!(!text.contains("anchor"), "{text}");
    for bad in [-0.1, 1.5] {
        let (read, _) = saved(&anchored(bad), "bad");
        let error = read.expect_err("out of the clip").to_string();
        assert!(error.contains("anchor in [0, 1]"), "{error}");
    }
}

#[test]
fn time_gaps_survive_a_file_and_are_checked() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let closed = [0.0, 0.125, 0.25, 0.75, 0.875, 1.0];
    let open = [0.25, 0.375, 0.5, 0.625, 0.75, 0.75];
    for device in devices() {
        for times in [closed, open] {
            for offsets in [
                OffsetPlacement::BeforeActivation,
                OffsetPlacement::AfterActivation,
            ] {
                let mut scene = with_large_offsets(scene(6, Some(9), offsets, &device));
                scene.settings.gaps = Gaps::between(times, 1.5);
                scene.save(folder.path()).expect("writes");
                let loaded = DynamicScene::load(folder.path(), &device).expect("reads");
                assert_eq!(loaded.settings, scene.settings);
                for time in [0.1, 0.5] {
                    let full = |scene| pixels(scene, time, Layer::Full);
                    assert_eq!(full(&loaded), full(&scene));
                }
                let path = folder.path().join("scene.json");
                let text = std::fs::read_to_string(&path).expect("reads");
                let invalid = text.replace("0.75", "1.75");
                assert_ne!(invalid, text);
                std::fs::write(&path, invalid).expect("writes");
                let error = DynamicScene::load(folder.path(), &device);
                let error = error.expect_err("after the clip").to_string();
                assert!(error.contains("gaps [from, to] in [0, 1]"), "{error}");
            }
        }
    }
}

#[test]
fn other_versions_and_unknown_keys_are_refused() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let device = Device::flex();
    let scene = scene(3, Some(2), OffsetPlacement::BeforeActivation, &device);
    scene.save(folder.path()).expect("writes");
    let path = folder.path().join("scene.json");
    let text = std::fs::read_to_string(&path).expect("reads");
    let load = |text: String| {
        std::fs::write(&path, text).expect("writes");
        DynamicScene::load(folder.path(), &device).expect_err("refused")
    };
    let with_version = |version: u32| {
        let changed = text.replace(
            "\"format_version\": 1",
            &format!("\"format_version\": {version}"),
        );
        assert_eq!(changed == text, version == 1);
        changed
    };
    for version in [0, 2, 6] {
        let error = load(with_version(version));
        assert!(
            matches!(error, ModelError::Version { found, .. } if found == version),
            "{error}"
        );
        // A later version may have keys that this one does not know.
        let later = with_version(version).replace("\"n_static\"", "\"n_static_gaussians\"");
        assert!(matches!(load(later), ModelError::Version { .. }));
    }
    let unknown = text.replace("\"n_static\"", "\"extra\": 0, \"n_static\"");
    let error = load(unknown);
    assert!(matches!(error, ModelError::Format { .. }), "{error}");
    assert!(error.to_string().contains("extra"), "{error}");
}

#[test]
fn a_damaged_scene_is_an_error_at_every_length() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let device = devices().swap_remove(0);
    let scene = scene(3, Some(2), OffsetPlacement::BeforeActivation, &device);
    for name in ["scene.json", "scene.safetensors"] {
        scene.save(folder.path()).expect("writes");
        let path = folder.path().join(name);
        let whole = std::fs::read(&path).expect("reads");
        for length in (0..whole.len()).step_by(whole.len() / 60) {
            std::fs::write(&path, &whole[..length]).expect("writes");
            match DynamicScene::load(folder.path(), &device) {
                Err(ModelError::Format { path: named, .. }) => assert_eq!(named, path),
                other => panic!("{length} bytes of {name}: {other:?}"),
            }
        }
        std::fs::write(&path, &whole).expect("writes");
    }
}
