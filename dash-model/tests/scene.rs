//! A whole scene: rendering, layers, files, export, on every backend.

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, Tensor};
use dash_kernels::testing::devices;
use dash_model::scene_file::TablePrecision;
use dash_model::{
    Camera, Clipping, DeformationConfig, DeformationField, DynamicPart, DynamicScene, Gaps,
    GaussianRows, Gaussians, HashEncoderConfig, Head, Heads, Layer, ModelError, OffsetPlacement,
    Representation, SceneSettings, SpaceBox, TrajectoryBasis, read_splat_ply, write_splat_ply,
};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

const SIZE: usize = 40;
const BASIS: TrajectoryBasis = TrajectoryBasis::polyline(4);

fn camera() -> Camera {
    Camera::new(45.0, 45.0, 20.0, 20.0, SIZE, SIZE).look_at(
        [0.0, 0.0, -4.0],
        [0.0; 3],
        [0.0, 1.0, 0.0],
    )
}

fn rows(n: usize, seed: u64, sh_degree: usize) -> GaussianRows {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut triple = |low: f32, high: f32| -> Vec<[f32; 3]> {
        (0..n)
            .map(|_| std::array::from_fn(|_| rng.random_range(low..high)))
            .collect()
    };
    let mut rows = GaussianRows::from_points(&triple(-1.0, 1.0), &triple(0.0, 1.0), sh_degree, 0.1);
    rows.opacity_logits.fill(2.0);
    rows
}

fn field_config() -> DeformationConfig {
    DeformationConfig {
        representation: Representation::Hash,
        heads: Heads::default(),
        encoder: HashEncoderConfig {
            n_levels: 3,
            n_features_per_level: 2,
            log2_hashmap_size: 8,
            base_resolution: vec![4; 4],
            finest_resolution: vec![16, 16, 16, 8],
            smoothstep: false,
            reference_sizing: false,
            left_out_levels: Vec::new(),
        },
        hidden: 8,
        layers: 1,
    }
}

/// A scene with as many static and dynamic Gaussians as asked for; `None` has no dynamic part.
fn scene(
    n_static: usize,
    n_dynamic: Option<usize>,
    offsets: OffsetPlacement,
    device: &Device,
) -> DynamicScene {
    let dynamic = n_dynamic.map(|n| {
        let mut moving = rows(n, 2, 1);
        moving.trajectory_width = 3 * BASIS.len();
        moving.trajectories = (0..n * moving.trajectory_width)
            .map(|i| 0.1 * (i as f32).sin())
            .collect();
        let space = SpaceBox::around(&moving.means, 0.0, 0.1);
        let mut rng = Pcg64::seed_from_u64(3);
        DynamicPart {
            gaussians: Gaussians::from_rows(&moving, device),
            field: DeformationField::new(&field_config(), space, &mut rng, device).expect("valid"),
        }
    });
    DynamicScene {
        static_set: Gaussians::from_rows(&rows(n_static, 1, 1), device),
        dynamic,
        settings: SceneSettings {
            background: [0.1, 0.2, 0.3],
            sh_degree: 1,
            near_plane: 0.2,
            ndc_limit: Some(50.0),
            trajectory_basis: BASIS,
            offsets,
            gaps: Gaps::default(),
        },
    }
}

fn pixels(scene: &DynamicScene, time: f32, layer: Layer) -> Vec<f32> {
    let image = scene
        .render_layer(&camera(), time, layer)
        .expect("renders")
        .image;
    assert_eq!(image.dims(), [SIZE, SIZE, 5]);
    let values = image.into_data().try_into_vec::<f32>().expect("f32");
    assert!(values.iter().all(|v| v.is_finite()));
    values
}

fn largest_difference(one: &[f32], other: &[f32]) -> f32 {
    assert_eq!(one.len(), other.len());
    let differences = one.iter().zip(other).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f32::max)
}

#[test]
fn what_is_nearer_than_the_near_plane_is_not_drawn() {
    for device in devices() {
        let mut scene = scene(5, Some(7), OffsetPlacement::BeforeActivation, &device);
        let before = pixels(&scene, 0.3, Layer::Full);
        // The camera is 4 from the origin, and the Gaussians no farther than 2 from it.
        scene.settings.near_plane = 1.9;
        assert_eq!(pixels(&scene, 0.3, Layer::Full), before);
        scene.settings.near_plane = 6.1;
        let background = [0.1, 0.2, 0.3, 0.0, 0.0];
        let empty = pixels(&scene, 0.3, Layer::Full);
        assert!(empty.chunks_exact(5).all(|pixel| pixel == background));
    }
}

#[test]
fn what_is_far_out_of_the_picture_is_not_drawn() {
    // Four in front of the camera, whose half picture is 20 / 45 wide at a distance of 1.
    let ndc = |offset: f32| f64::from(offset / 4.0 * 45.0 / 20.0);
    for device in devices() {
        for direction in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] {
            for moves in [false, true] {
                let offset = 20.0;
                let mut far = rows(1, 1, 1);
                far.means[0] = [direction[0] * offset, direction[1] * offset, 0.0];
                // So large that the picture shows it all the same.
                far.log_scales[0] = [2.5; 3];
                let mut scene = scene(5, Some(7), OffsetPlacement::BeforeActivation, &device);
                let without = pixels(&scene, 0.3, Layer::Full);
                if let Some(dynamic) = scene.dynamic.as_mut().filter(|_| moves) {
                    let mut all = dynamic.gaussians.to_rows();
                    far.trajectory_width = all.trajectory_width;
                    far.trajectories = vec![0.0; far.trajectory_width];
                    all.append(&far);
                    dynamic.gaussians = Gaussians::from_rows(&all, &device);
                } else {
                    let mut all = scene.static_set.to_rows();
                    all.append(&far);
                    scene.static_set = Gaussians::from_rows(&all, &device);
                }
                scene.settings.ndc_limit = None;
                let with = pixels(&scene, 0.3, Layer::Full);
                assert!(largest_difference(&with, &without) > 0.1, "{direction:?}");
                scene.settings.ndc_limit = Some(ndc(offset + 2.0));
                assert_eq!(pixels(&scene, 0.3, Layer::Full), with);
                scene.settings.ndc_limit = Some(ndc(offset - 2.0));
                assert_eq!(pixels(&scene, 0.3, Layer::Full), without);
                // Steps of training draw the splats, not the limited picture.
                let splats = if moves {
                    scene.dynamic_splats(&camera(), 0.3).expect("projects")
                } else {
                    Some(scene.static_splats(&camera()).expect("projects"))
                };
                let splats = splats.expect("a layer").into_data();
                let splats = splats.try_into_vec::<f32>().expect("f32");
                let last = &splats[splats.len() - dash_kernels::splats::N_COLUMNS..];
                assert!(last[dash_kernels::splats::RADIUS_X] > 0.0, "{last:?}");
            }
        }
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
        assert_eq!(
            empty[..5],
            [0.1, 0.2, 0.3, 0.0, 0.0],
            "the background alone"
        );
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
fn an_anchored_scene_is_at_rest_there_and_its_files_say_so() {
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
    assert!(text.contains("\"format_version\": 4"), "{text}");
    let middle = middle.expect("reads");
    let expected = anchored(0.5);
    for time in [0.0, 0.5, 0.9] {
        let [read, written] = [&middle, &expected].map(|s| pixels(s, time, Layer::Full));
        assert_eq!(read, written);
    }
    let start = pixels(&anchored(0.0), 0.9, Layer::Full);
    assert_ne!(pixels(&middle, 0.9, Layer::Full), start);
    let (plain, text) = saved(
        &{
            let mut scene = anchored(0.0);
            scene.settings.ndc_limit = None;
            scene
        },
        "start",
    );
    plain.expect("reads");
    assert!(text.contains("\"format_version\": 2"), "{text}");
    for bad in [-0.1, 1.5] {
        let (read, _) = saved(&anchored(bad), "bad");
        let error = read.expect_err("out of the clip").to_string();
        assert!(error.contains("anchor in [0, 1]"), "{error}");
    }
}

/// A place on the way through a gap, by those before the gap, at both of its ends and after it, and by how much longer
/// the gap is than what is known on either side.
fn through_a_gap(known: [[f64; 3]; 4], longer: f64, share: f64) -> ([f64; 3], f64) {
    let minus = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] { std::array::from_fn(|k| a[k] - b[k]) };
    let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
    let [before, from, to, after] = known;
    let way = minus(to, from);
    let arrives = minus(from, before).map(|v| v * longer);
    let leaves = minus(after, to).map(|v| v * longer);
    let change = minus(arrives, leaves);
    let old = (dot(minus(way, leaves), change) / dot(change, change)).clamp(0.0, 1.0);
    let both: [f64; 3] = std::array::from_fn(|k| old * arrives[k] + (1.0 - old) * leaves[k]);
    let miss = minus(way, both);
    let off = change.map(|v| old * (1.0 - old) * v);
    let agree = match dot(off, off) {
        0.0 => 0.0,
        square => (1.0 - dot(miss, miss) / square).clamp(0.0, 1.0),
    };
    let tent = agree * (share * (1.0 - old)).min(old * (1.0 - share));
    let place = std::array::from_fn(|k| from[k] + share * way[k] + tent * change[k]);
    (place, agree)
}

/// Means, quaternions, scales, opacities and colours of the dynamic Gaussians at a time.
fn deformed(scene: &DynamicScene, time: f32) -> [Vec<f32>; 5] {
    let part = scene.dynamic.as_ref().expect("some move");
    let deformed = part.deform(&scene.settings, time).expect("fits");
    let flat = |tensor: Tensor<1>| tensor.into_data().try_into_vec().expect("f32");
    [
        flat(deformed.means.reshape([-1])),
        flat(deformed.quats.reshape([-1])),
        flat(deformed.scales.reshape([-1])),
        flat(deformed.opacities),
        flat(deformed.sh_coeffs.joined().reshape([-1])),
    ]
}

#[test]
fn beyond_what_was_seen_things_go_on_as_they_came_and_files_say_so() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    for (index, device) in devices().into_iter().enumerate() {
        let seen = lively(scene(
            6,
            Some(9),
            OffsetPlacement::BeforeActivation,
            &device,
        ));
        let mut ended = seen.clone();
        ended.settings.gaps = Gaps::between([0.25, 0.375, 0.5, 0.625, 0.75], 1.5);
        for time in [0.25, 0.3, 0.5, 0.75] {
            assert_eq!(deformed(&ended, time), deformed(&seen, time), "{time}");
        }
        for (time, at, inner) in [(0.9, 0.75, 0.6), (1.0, 0.75, 0.5), (0.125, 0.25, 0.375)] {
            let [mut expected, before] = [at, inner].map(|time| deformed(&seen, time));
            for (mean, before) in expected[0].iter_mut().zip(&before[0]) {
                *mean = 2.0 * *mean - before;
            }
            let found = deformed(&ended, time);
            assert_eq!(found[1..], expected[1..], "{time}");
            let error = largest_difference(&found[0], &expected[0]);
            assert!(error <= 1e-6, "{time}: {error}");
            let other = deformed(&seen, time);
            assert!(
                largest_difference(&other[0], &expected[0]) > 1e-3,
                "it bends"
            );
        }
        let path = folder.path().join(index.to_string());
        ended.save(&path).expect("writes");
        let text = std::fs::read_to_string(path.join("scene.json")).expect("reads");
        assert!(text.contains("\"format_version\": 6"), "{text}");
        let loaded = DynamicScene::load(&path, &device).expect("reads");
        assert_eq!(loaded.settings, ended.settings);
    }
}

#[test]
fn through_a_gap_things_go_straight_or_turn_once_and_files_say_so() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    for (index, device) in devices().into_iter().enumerate() {
        for offsets in [
            OffsetPlacement::BeforeActivation,
            OffsetPlacement::AfterActivation,
        ] {
            let seen = lively(scene(6, Some(9), offsets, &device));
            let mut bridged = seen.clone();
            bridged.settings.gaps = Gaps::between([0.0, 0.125, 0.25, 0.75, 0.875, 1.0], 1.5);
            assert_eq!(bridged.settings.gaps.len(), 1);
            let values = |scene: &DynamicScene, time: f32| deformed(scene, time).concat();
            for time in [0.0, 0.2, 0.25, 0.75, 0.8, 1.0] {
                assert_eq!(values(&bridged, time), values(&seen, time), "{time}");
            }
            let [before, from, to, after] = [0.0, 0.25, 0.75, 1.0].map(|time| values(&seen, time));
            for (time, share) in [(0.375, 0.25), (0.5, 0.5), (0.625, 0.75)] {
                let mut expected: Vec<f32> = from
                    .iter()
                    .zip(&to)
                    .map(|(from, to)| {
                        (f64::from(*from) * (1.0 - share) + f64::from(*to) * share) as f32
                    })
                    .collect();
                let mut agreements = Vec::new();
                for row in 0..9 {
                    let place = |values: &[f32]| -> [f64; 3] {
                        std::array::from_fn(|axis| f64::from(values[3 * row + axis]))
                    };
                    let known = [&before, &from, &to, &after].map(|values| place(values));
                    let (place, agree) = through_a_gap(known, 2.0, share);
                    for (axis, value) in place.into_iter().enumerate() {
                        expected[3 * row + axis] = value as f32;
                    }
                    agreements.push(agree);
                }
                assert!(
                    agreements.contains(&0.0) && agreements.iter().any(|agree| *agree > 0.1),
                    "some go straight and some turn: {agreements:?}"
                );
                let found = values(&bridged, time);
                let largest = expected.iter().fold(1.0f32, |m, v| m.max(v.abs()));
                let error = largest_difference(&found, &expected);
                assert!(error <= 1e-6 * largest, "{time}: {error} of {largest}");
                assert!(
                    largest_difference(&values(&seen, time), &expected) > 1e-3,
                    "it bends"
                );
            }
            let path = folder.path().join(format!("{index}-{offsets:?}"));
            bridged.save(&path).expect("writes");
            let text = std::fs::read_to_string(path.join("scene.json")).expect("reads");
            assert!(text.contains("\"format_version\": 5"), "{text}");
            let loaded = DynamicScene::load(&path, &device).expect("reads");
            assert_eq!(loaded.settings, bridged.settings);
            let full = |scene| pixels(scene, 0.5, Layer::Full);
            assert_eq!(full(&loaded), full(&bridged));
            let unsound = text.replace("0.75", "1.75");
            assert_ne!(unsound, text);
            std::fs::write(path.join("scene.json"), unsound).expect("writes");
            let error = DynamicScene::load(&path, &device).expect_err("after the clip");
            assert!(
                error.to_string().contains("gaps [from, to] in [0, 1]"),
                "{error}"
            );
        }
    }
}

#[test]
fn tables_stored_in_half_the_bits_are_read_back_as_announced() {
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
        // The header names shorter types, too: a few bytes more or less.
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
    let still = scene(6, None, OffsetPlacement::BeforeActivation, &device);
    assert!(still.with_half_tables().is_none());
    assert_eq!(
        still.stored_bytes(TablePrecision::Half),
        still.stored_bytes(TablePrecision::Single)
    );
}

#[test]
fn colour_that_few_gaussians_have_is_stored_for_them_only() {
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
    // 38 static and all 4 dynamic ones have none, which saves 9 values each; 2 numbers are added.
    let all = dash_model::scene_file::parameter_bytes(&scene);
    assert_eq!(all - of_parameters, 4 * ((38 + 4) * 9 - 2));
    let loaded = DynamicScene::load(folder.path(), &device).expect("reads");
    assert_eq!(loaded.static_set.to_rows(), rows);
    // A number that no Gaussian has.
    let whole = std::fs::read(&path).expect("reads");
    let numbers: Vec<u8> = [3u32, 17].iter().flat_map(|n| n.to_le_bytes()).collect();
    let at = whole
        .windows(8)
        .position(|bytes| bytes == numbers)
        .expect("the rows are numbered");
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

/// The scene with a field whose offsets differ by far more than rounding.
fn lively(scene: DynamicScene) -> DynamicScene {
    let mut parameters = dash_model::parameters::named_parameters(&scene);
    let field = &scene.dynamic.as_ref().expect("some move").field;
    // Positions, rotations and scales, the last of the decoder's layers.
    let heads = (field.config().hidden + 1) * (3 + 4 + 3);
    for (name, n, factor) in [
        ("dynamic.field.encoder.table", usize::MAX, 1e4),
        ("dynamic.field.decoder.parameters", heads, 1e2),
    ] {
        let values = &mut parameters.get_mut(name).expect("the field's").values;
        let first = values.len().saturating_sub(n);
        for value in &mut values[first..] {
            *value *= factor;
        }
    }
    dash_model::parameters::with_parameters(scene, parameters).expect("the same parameters")
}

#[test]
fn a_field_with_less_does_on_average_what_it_did() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let times = [0.4f32];
    for (index, device) in devices().into_iter().enumerate() {
        let scene = lively(scene(
            6,
            Some(9),
            OffsetPlacement::BeforeActivation,
            &device,
        ));
        let dynamic = scene.dynamic.as_ref().expect("some move");
        for head in [Head::Rotation, Head::Scale] {
            let mut without = scene.clone();
            let part = dynamic.without_head(&scene.settings, head, &times);
            without.dynamic = Some(part.expect("fits"));
            let deformed = |scene: &DynamicScene, time: f32| {
                let part = scene.dynamic.as_ref().expect("some move");
                let deformed = part.deform(&scene.settings, time).expect("fits");
                let tensor = match head {
                    Head::Rotation => deformed.quats,
                    Head::Scale => deformed.scales,
                };
                tensor.into_data().try_into_vec::<f32>().expect("f32")
            };
            // At the only time there is, the average is all.
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
        assert_eq!(part.field.config().encoder.left_out_levels, [1]);
        let typical = part.mean_features(&times).expect("fits");
        let again = part
            .without_levels(&[1], &typical)
            .expect("one level stays");
        assert_eq!(again.field.config().encoder.left_out_levels, [1, 2]);
        // There is no such level, the means are of fewer features, and one level has to stay.
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
fn entries_that_no_gaussian_reads_are_not_stored() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    for (index, device) in devices().into_iter().enumerate() {
        let placement = OffsetPlacement::BeforeActivation;
        let whole = lively(scene(6, Some(2), placement, &device));
        let dynamic = whole.dynamic.as_ref().expect("some move");
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
        // A mark that is missing.
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
                assert!(expected.contains("a mark for each row"), "{expected}");
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn a_level_that_says_the_same_everywhere_is_not_missed() {
    let placement = OffsetPlacement::BeforeActivation;
    for device in devices() {
        let scene = lively(scene(6, Some(9), placement, &device));
        // Every feature of level 1 becomes 0.5.
        let mut parameters = dash_model::parameters::named_parameters(&scene);
        let layout = field_config().encoder.layout().expect("valid");
        let level = layout.levels()[1];
        let table = parameters
            .get_mut("dynamic.field.encoder.table")
            .expect("a hash grid has a table");
        let rows = level.offset as usize..(level.offset + level.size) as usize;
        table.values[2 * rows.start..2 * rows.end].fill(0.5);
        let scene = dash_model::parameters::with_parameters(scene, parameters).expect("fits");
        let mut without = scene.clone();
        let part = scene.dynamic.as_ref().expect("some move");
        let typical = part.mean_features(&[0.1, 0.7]).expect("fits");
        without.dynamic = Some(part.without_levels(&[1], &typical).expect("two stay"));
        for time in [0.0, 0.3, 1.0] {
            let dynamic = |scene| pixels(scene, time, Layer::Dynamic);
            let largest = largest_difference(&dynamic(&scene), &dynamic(&without));
            assert!(largest < 1e-4, "at {time}: {largest}");
        }
    }
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

#[test]
fn an_instant_survives_the_ply_and_draws_alike() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("instant.ply");
    for device in devices() {
        for offsets in [
            OffsetPlacement::BeforeActivation,
            OffsetPlacement::AfterActivation,
        ] {
            let scene = scene(6, Some(5), offsets, &device);
            let clipping = scene.settings.clipping();
            write_splat_ply(&path, &scene.at(0.7).expect("deforms"), &clipping).expect("writes");
            let (read, limits) = read_splat_ply(&path).expect("reads");
            assert_eq!(read, scene.at(0.7).expect("deforms"));
            assert_eq!(limits, clipping);
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
        let canonical = part_logits(&scene);
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

fn part_logits(scene: &DynamicScene) -> Vec<f32> {
    let part = scene.dynamic.as_ref().expect("given");
    part.gaussians.to_rows().opacity_logits
}

#[test]
fn comments_of_a_ply_say_what_pictures_leave_out() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("clipped.ply");
    let clipping = Clipping {
        near_plane: 0.1 + 0.2,
        ndc_limit: Some(8.0),
    };
    write_splat_ply(&path, &rows(3, 5, 3), &clipping).expect("writes");
    assert_eq!(read_splat_ply(&path).expect("reads").1, clipping);
    let plain = Clipping::default();
    write_splat_ply(&path, &rows(3, 5, 3), &plain).expect("writes");
    let bytes = std::fs::read(&path).expect("reads");
    assert!(!String::from_utf8_lossy(&bytes).contains("comment"));
    assert_eq!(read_splat_ply(&path).expect("reads").1, plain);
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
    write_splat_ply(&path, &rows(3, 5, 3), &Clipping::default()).expect("writes");
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
