//! Tensors that take less space in files: f16 tables, and tensors without their rows of zeros.

use dash_model::scene_file::{TablePrecision, parameter_bytes};
use dash_model::{DynamicScene, Gaussians, Layer, ModelError, OffsetPlacement};

use crate::common::{devices, field_config, pixels, scene, with_large_offsets};

#[test]
fn f16_tables_are_read_back_as_announced() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    for (index, device) in devices().into_iter().enumerate() {
        let placement = OffsetPlacement::BeforeActivation;
        let scene = scene(6, Some(4), placement, &device);
        let sizes = [TablePrecision::Single, TablePrecision::Half].map(|precision| {
            let path = folder.path().join(format!("{index}-{precision:?}"));
            scene.save_with(&path, precision).expect("writes");
            let file = path.join("scene.safetensors");
            std::fs::metadata(file).expect("written").len()
        });
        // The header differs by a few bytes, too.
        let saved = sizes[0] - sizes[1];
        let layout = field_config().encoder.layout().expect("valid");
        let of_tables = 2 * layout.n_entries() * layout.n_features_per_level();
        assert!(saved.abs_diff(of_tables as u64) < 64, "{sizes:?}");
        let [single, half] = [TablePrecision::Single, TablePrecision::Half]
            .map(|precision| scene.stored_bytes(precision));
        assert_eq!(single - half, of_tables);
        let half = folder.path().join(format!("{index}-Half"));
        let loaded = DynamicScene::load(&half, &device).expect("reads");
        let announced = scene.with_half_tables().expect("has tables");
        assert_eq!(
            pixels(&loaded, 0.4, Layer::Full),
            pixels(&announced, 0.4, Layer::Full)
        );
    }
    let device = devices().swap_remove(0);
    let static_scene = scene(6, None, OffsetPlacement::BeforeActivation, &device);
    assert!(static_scene.with_half_tables().is_none());
    assert_eq!(
        static_scene.stored_bytes(TablePrecision::Half),
        static_scene.stored_bytes(TablePrecision::Single)
    );
}

#[test]
fn higher_sh_coefficients_are_stored_for_gaussians_that_have_any() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let device = devices().swap_remove(0);
    let mut scene = scene(40, Some(4), OffsetPlacement::BeforeActivation, &device);
    let mut rows = scene.static_set.to_rows();
    for row in [3, 17] {
        rows.sh_rest[row * rows.sh_rest_width + 2] = 0.7;
    }
    scene.static_set = Gaussians::from_rows(&rows, &device);
    scene.save(folder.path()).expect("writes");
    let path = folder.path().join("scene.safetensors");
    let size = std::fs::metadata(&path).expect("written").len() as usize;
    let of_parameters = scene.stored_bytes(TablePrecision::Single);
    assert!(
        size > of_parameters && size < of_parameters + 3000,
        "{size}, {of_parameters}"
    );
    // 38 static and all 4 dynamic ones have none, which saves 9 values each; 2 indices are added.
    let all = parameter_bytes(&scene);
    assert_eq!(all - of_parameters, 4 * ((38 + 4) * 9 - 2));
    let loaded = DynamicScene::load(folder.path(), &device).expect("reads");
    assert_eq!(loaded.static_set.to_rows(), rows);
    // An index that no Gaussian has, or twice the same.
    let whole = std::fs::read(&path).expect("reads");
    let numbers: Vec<u8> = [3u32, 17].iter().flat_map(|n| n.to_le_bytes()).collect();
    let at = whole
        .windows(8)
        .position(|bytes| bytes == numbers)
        .expect("indices of the rows");
    for wrong in [40u32, 3, u32::MAX] {
        let mut broken = whole.clone();
        broken[at + 4..at + 8].copy_from_slice(&wrong.to_le_bytes());
        std::fs::write(&path, broken).expect("writes");
        match DynamicScene::load(folder.path(), &device) {
            Err(ModelError::Format { expected, .. }) => {
                assert!(expected.contains("below 40"), "{expected}");
            }
            other => panic!("{wrong}: {other:?}"),
        }
    }
}

#[test]
fn entries_that_no_gaussian_reads_are_not_stored() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    for (index, device) in devices().into_iter().enumerate() {
        let placement = OffsetPlacement::BeforeActivation;
        let whole = with_large_offsets(scene(6, Some(2), placement, &device));
        let dynamic = whole.dynamic.as_ref().expect("a dynamic part");
        let (part, [n_read, n_entries]) = dynamic.without_unread().expect("a hash grid");
        assert!(
            n_read > 0 && 2 * n_read < n_entries,
            "{n_read} of {n_entries}"
        );
        let sparse = DynamicScene {
            dynamic: Some(part),
            ..whole.clone()
        };
        for precision in [TablePrecision::Single, TablePrecision::Half] {
            let bytes = match precision {
                TablePrecision::Single => 4,
                TablePrecision::Half => 2,
            };
            let marks = n_entries.div_ceil(8) + 1;
            let saved = bytes * 2 * (n_entries - n_read) - marks;
            let [all, left] = [&whole, &sparse].map(|scene| scene.stored_bytes(precision));
            assert_eq!(all - left, saved);
            let path = folder.path().join(format!("{index}-{precision:?}"));
            sparse.save_with(&path, precision).expect("writes");
            let loaded = DynamicScene::load(&path, &device).expect("reads");
            for time in [0.0, 0.3, 1.0] {
                let expected = match precision {
                    TablePrecision::Single => pixels(&whole, time, Layer::Full),
                    TablePrecision::Half => {
                        let half = whole.with_half_tables().expect("has tables");
                        pixels(&half, time, Layer::Full)
                    }
                };
                assert_eq!(pixels(&loaded, time, Layer::Full), expected, "at {time}");
            }
        }
        // A missing bit of the mask.
        let path = folder.path().join(format!("{index}-Single"));
        let file = path.join("scene.safetensors");
        let mut bytes = std::fs::read(&file).expect("reads");
        let header = u64::from_le_bytes(bytes[..8].try_into().expect("eight bytes")) as usize;
        let names: serde_json::Value =
            serde_json::from_slice(&bytes[8..8 + header]).expect("a header");
        let marks = &names["dynamic.field.encoder.table.marks"];
        assert_eq!(marks["dtype"], "U8");
        let start = 8 + header + marks["data_offsets"][0].as_u64().expect("an offset") as usize;
        let first = (start..).find(|&at| bytes[at] != 0).expect("a mark");
        bytes[first] &= bytes[first] - 1;
        std::fs::write(&file, bytes).expect("writes");
        match DynamicScene::load(&path, &device) {
            Err(ModelError::Format { expected, .. }) => {
                assert!(expected.contains("a set bit for each row"), "{expected}");
            }
            other => panic!("{other:?}"),
        }
    }
}
