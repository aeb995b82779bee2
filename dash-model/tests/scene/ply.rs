//! One instant of a scene as a 3DGS PLY file.

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, Tensor};
use dash_kernels::splats::NEAR_PLANE;
use dash_model::{
    DeformationField, DynamicScene, Gaussians, Layer, OffsetPlacement, SplatFile, read_splat_ply,
    write_splat_ply,
};
use rand::SeedableRng;
use rand_pcg::Pcg64;

use crate::common::{devices, field_config, largest_difference, pixels, rows, scene};

#[test]
fn an_instant_survives_the_ply_and_renders_alike() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("instant.ply");
    for device in devices() {
        for offsets in [
            OffsetPlacement::BeforeActivation,
            OffsetPlacement::AfterActivation,
        ] {
            let scene = scene(6, Some(5), offsets, &device);
            let written = scene.at(0.7).expect("deforms");
            write_splat_ply(&path, &written, scene.settings.near_plane).expect("writes");
            let SplatFile {
                rows: read,
                near_plane,
                left_out,
            } = read_splat_ply(&path).expect("reads");
            assert_eq!(left_out.count(), 0);
            assert_eq!(read, written);
            assert_eq!(near_plane, scene.settings.near_plane);
            let instant = DynamicScene {
                static_set: Gaussians::from_rows(&read, &device),
                dynamic: None,
                settings: scene.settings.clone(),
            };
            let worst = largest_difference(
                &pixels(&instant, 0.0, Layer::Full),
                &pixels(&scene, 0.7, Layer::Full),
            );
            assert!(worst < 1e-4, "{worst}");
        }
    }
}

/// Adds to every parameter.
struct Shift(f32);

impl ModuleMapper for Shift {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        param.map(|value| value + self.0)
    }
}

#[test]
fn an_exported_instant_has_the_opacities_that_the_field_gives() {
    let device = Device::flex();
    for offsets in [
        OffsetPlacement::BeforeActivation,
        OffsetPlacement::AfterActivation,
    ] {
        let mut scene = scene(0, Some(5), offsets, &device);
        let part = scene.dynamic.as_mut().expect("given");
        let mut config = field_config();
        config.heads.appearance = true;
        let mut rng = Pcg64::seed_from_u64(3);
        let space = *part.field.space();
        let field = DeformationField::new(&config, space, &mut rng, &device).expect("valid");
        part.field = field.map(&mut Shift(0.05));
        let instant = scene.at(0.7).expect("deforms");
        let canonical = canonical_logits(&scene);
        let pairs = instant.opacity_logits.iter().zip(&canonical);
        assert!(
            pairs.clone().all(|(a, b)| (a - b).abs() > 1e-3),
            "{offsets:?}"
        );
        let frozen = DynamicScene {
            static_set: Gaussians::from_rows(&instant, &device),
            dynamic: None,
            settings: scene.settings.clone(),
        };
        let worst = largest_difference(
            &pixels(&frozen, 0.0, Layer::Full),
            &pixels(&scene, 0.7, Layer::Full),
        );
        assert!(worst < 1e-4, "{offsets:?}: {worst}");
    }
}

fn canonical_logits(scene: &DynamicScene) -> Vec<f32> {
    let part = scene.dynamic.as_ref().expect("given");
    part.gaussians.to_rows().opacity_logits
}

#[test]
fn a_comment_of_a_ply_holds_the_near_plane() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("near.ply");
    let near_plane = 0.1 + 0.2;
    write_splat_ply(&path, &rows(3, 5, 3), near_plane).expect("writes");
    assert_eq!(read_splat_ply(&path).expect("reads").near_plane, near_plane);
    write_splat_ply(&path, &rows(3, 5, 3), NEAR_PLANE).expect("writes");
    let bytes = std::fs::read(&path).expect("reads");
    assert!(!String::from_utf8_lossy(&bytes).contains("comment"));
    assert_eq!(read_splat_ply(&path).expect("reads").near_plane, NEAR_PLANE);
    let header = b"ply\nformat binary_little_endian 1.0\n";
    let damaged = [
        header,
        &b"comment dash near_plane none\n"[..],
        &bytes[header.len()..],
    ];
    std::fs::write(&path, damaged.concat()).expect("writes");
    let error = read_splat_ply(&path).expect_err("no number");
    assert!(error.to_string().contains("near_plane none"), "{error}");
}

#[test]
fn a_truncated_ply_is_an_error_that_names_the_file() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("cut.ply");
    write_splat_ply(&path, &rows(3, 5, 3), NEAR_PLANE).expect("writes");
    let whole = std::fs::read(&path).expect("reads");
    for length in 0..whole.len() {
        std::fs::write(&path, &whole[..length]).expect("writes");
        let error = read_splat_ply(&path).expect_err("a cut file");
        assert!(error.to_string().contains("cut.ply"), "{error}");
    }
    // A header that promises more than there is must not be believed.
    let text = String::from_utf8_lossy(&whole[..53]).replace("vertex 3", "vertex 999999999");
    let mut bytes = text.into_bytes();
    bytes.extend(&whole[53..]);
    std::fs::write(&path, &bytes).expect("writes");
    assert!(read_splat_ply(&path).is_err());
}
