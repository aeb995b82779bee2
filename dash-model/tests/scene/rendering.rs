//! Layers, near plane, and scenes without static or dynamic Gaussians.

use dash_model::{Layer, OffsetPlacement};

use crate::common::{BACKGROUND, devices, pixels, scene};

#[test]
fn gaussians_before_the_near_plane_are_not_drawn() {
    for device in devices() {
        let mut scene = scene(5, Some(7), OffsetPlacement::BeforeActivation, &device);
        let before = pixels(&scene, 0.3, Layer::Full);
        // The camera is 4 from the origin, and the Gaussians no farther than 2 from it.
        scene.settings.near_plane = 1.9;
        assert_eq!(pixels(&scene, 0.3, Layer::Full), before);
        scene.settings.near_plane = 6.1;
        let [r, g, b] = BACKGROUND;
        let background = [r, g, b, 0.0, 0.0];
        let empty = pixels(&scene, 0.3, Layer::Full);
        assert!(empty.chunks_exact(5).all(|pixel| pixel == background));
    }
}

#[test]
fn none_one_and_only_dynamic_gaussians_render() {
    for device in devices() {
        for offsets in [
            OffsetPlacement::BeforeActivation,
            OffsetPlacement::AfterActivation,
        ] {
            for (n_static, n_dynamic) in [
                (0, None),
                (5, None),
                (5, Some(0)),
                (5, Some(1)),
                (0, Some(7)),
                (0, Some(0)),
            ] {
                pixels(
                    &scene(n_static, n_dynamic, offsets, &device),
                    0.3,
                    Layer::Full,
                );
            }
        }
        let empty = pixels(
            &scene(0, None, OffsetPlacement::BeforeActivation, &device),
            0.0,
            Layer::Full,
        );
        let [r, g, b] = BACKGROUND;
        assert_eq!(empty[..5], [r, g, b, 0.0, 0.0], "the background alone");
    }
}

#[test]
fn an_empty_dynamic_part_equals_none_bit_for_bit() {
    for device in devices() {
        let without = scene(6, None, OffsetPlacement::BeforeActivation, &device);
        let with = scene(6, Some(0), OffsetPlacement::BeforeActivation, &device);
        assert_eq!(
            pixels(&without, 0.5, Layer::Full),
            pixels(&with, 0.5, Layer::Full)
        );
    }
}

#[test]
fn static_gaussians_never_move_and_dynamic_ones_do() {
    for device in devices() {
        let scene = scene(6, Some(6), OffsetPlacement::BeforeActivation, &device);
        assert_eq!(
            pixels(&scene, 0.0, Layer::Static),
            pixels(&scene, 1.0, Layer::Static)
        );
        assert_ne!(
            pixels(&scene, 0.0, Layer::Dynamic),
            pixels(&scene, 1.0, Layer::Dynamic)
        );
    }
}
