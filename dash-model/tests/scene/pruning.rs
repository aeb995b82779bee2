//! Deformation fields without heads and levels.

use burn::tensor::Tensor;
use dash_model::parameters::{named_parameters, with_parameters};
use dash_model::{DynamicScene, Head, Layer, OffsetPlacement};

use crate::common::{
    devices, field_config, largest_difference, pixels, scene, with_appearance, with_large_offsets,
};

#[test]
fn a_pruned_field_keeps_its_average_offsets() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let times = [0.4f32];
    for (index, device) in devices().into_iter().enumerate() {
        let scene = scene(6, Some(9), OffsetPlacement::BeforeActivation, &device);
        let scene = with_large_offsets(with_appearance(scene, &device));
        let dynamic = scene.dynamic.as_ref().expect("a dynamic part");
        for head in [Head::Rotation, Head::Scale, Head::Appearance] {
            let mut without = scene.clone();
            let part = dynamic.without_head(&scene.settings, head, &times);
            without.dynamic = Some(part.expect("fits"));
            let deformed = |scene: &DynamicScene, time: f32| {
                let part = scene.dynamic.as_ref().expect("a dynamic part");
                let deformed = part.deform(&scene.settings, time).expect("fits");
                let tensor = match head {
                    Head::Rotation => deformed.quats,
                    Head::Scale => deformed.scales,
                    Head::Appearance => {
                        let n = deformed.opacities.dims()[0];
                        let colors = deformed.sh_coeffs.dc.reshape([n, 3]);
                        Tensor::cat(vec![deformed.opacities.reshape([n, 1]), colors], 1)
                    }
                };
                tensor.into_data().try_into_vec::<f32>().expect("f32")
            };
            // The average over one time is exact there.
            let change = largest_difference(&deformed(&without, 0.4), &deformed(&scene, 0.4));
            assert!(change < 1e-5, "{head:?}: {change}");
            assert_eq!(deformed(&without, 0.9), deformed(&without, 0.4));
            assert_ne!(deformed(&scene, 0.9), deformed(&scene, 0.4));
            let path = folder.path().join(format!("{index}-{head:?}"));
            without.save(&path).expect("writes");
            let loaded = DynamicScene::load(&path, &device).expect("reads");
            let full = |scene| pixels(scene, 0.9, Layer::Full);
            assert_eq!(full(&loaded), full(&without));
        }
        let mut without = scene.clone();
        let typical = dynamic.mean_features(&times).expect("fits");
        let part = dynamic
            .without_levels(&[1], &typical)
            .expect("two levels stay");
        without.dynamic = Some(part);
        let part = without.dynamic.as_ref().expect("just put there");
        assert_eq!(part.field.config().encoder.pruned_levels, [1]);
        let typical = part.mean_features(&times).expect("fits");
        let again = part
            .without_levels(&[1], &typical)
            .expect("one level stays");
        assert_eq!(again.field.config().encoder.pruned_levels, [1, 2]);
        // No such level, means of fewer features, and no level left.
        let typical = again.mean_features(&times).expect("fits");
        assert!(again.without_levels(&[1], &typical).is_err());
        assert!(part.without_levels(&[0], &typical).is_err());
        assert!(again.without_levels(&[0], &typical).is_err());
        let path = folder.path().join(format!("{index}-level"));
        without.save(&path).expect("writes");
        let loaded = DynamicScene::load(&path, &device).expect("reads");
        let full = |scene| pixels(scene, 0.9, Layer::Full);
        assert_eq!(full(&loaded), full(&without));
    }
}

#[test]
fn a_constant_level_can_be_pruned_without_a_change() {
    let placement = OffsetPlacement::BeforeActivation;
    for device in devices() {
        let scene = with_large_offsets(scene(6, Some(9), placement, &device));
        // Every feature of level 1 becomes 0.5.
        let mut parameters = named_parameters(&scene);
        let layout = field_config().encoder.layout().expect("valid");
        let level = layout.levels()[1];
        let table = parameters
            .get_mut("dynamic.field.encoder.table")
            .expect("a hash grid has a table");
        let rows = level.offset as usize..(level.offset + level.size) as usize;
        table.values[2 * rows.start..2 * rows.end].fill(0.5);
        let scene = with_parameters(scene, parameters).expect("fits");
        let mut without = scene.clone();
        let part = scene.dynamic.as_ref().expect("a dynamic part");
        let typical = part.mean_features(&[0.1, 0.7]).expect("fits");
        without.dynamic = Some(part.without_levels(&[1], &typical).expect("two stay"));
        for time in [0.0, 0.3, 1.0] {
            let dynamic = |scene| pixels(scene, time, Layer::Dynamic);
            let largest = largest_difference(&dynamic(&scene), &dynamic(&without));
            assert!(largest < 1e-4, "at {time}: {largest}");
        }
    }
}
