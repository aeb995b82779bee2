//! Fields of other methods: a decoder for each resolution of time, and a head for every colour coefficient.

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, Tensor};
use dash_model::{
    DeformationField, DynamicPart, DynamicScene, Gaussians, Layer, ModelError, OffsetPlacement,
    Representation,
};
use rand::SeedableRng;
use rand_pcg::Pcg64;

use crate::common::{deformed, devices, field_config, pixels, scene};

/// Coefficients of degree 1 above the constant one.
const SH_REST: usize = 3;

/// Moves every parameter away from the zeros that some begin with.
struct Shift(f32);

impl ModuleMapper for Shift {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        param.map(|value| value + self.0)
    }
}

/// A scene whose Gaussians have embeddings, and whose field changes so many higher colour coefficients.
fn with_embeddings(sh_rest: usize, device: &Device) -> DynamicScene {
    let mut scene = scene(2, Some(5), OffsetPlacement::BeforeActivation, device);
    let part = scene.dynamic.as_mut().expect("given");
    let mut config = field_config();
    config.representation = Representation::Embedding;
    config.heads.appearance = true;
    config.heads.sh_rest = sh_rest;
    let mut rows = part.gaussians.to_rows();
    rows.embedding_width = config.embedding_width();
    let n = rows.embedding_width * 5;
    rows.embeddings = (0..n).map(|i| (i as f32).sin()).collect();
    part.gaussians = Gaussians::from_rows(&rows, device);
    let mut rng = Pcg64::seed_from_u64(3);
    let field = DeformationField::new(&config, *part.field.space(), &mut rng, device);
    part.field = field.expect("valid").map(&mut Shift(0.05));
    scene
}

#[test]
fn both_decoders_and_all_colours_survive_a_file() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    for device in devices() {
        let scene = with_embeddings(SH_REST, &device);
        scene.save(folder.path()).expect("writes");
        let loaded = DynamicScene::load(folder.path(), &device).expect("reads");
        for time in [0.1, 0.8] {
            assert_eq!(deformed(&loaded, time), deformed(&scene, time));
        }
        assert_eq!(
            pixels(&loaded, 0.4, Layer::Full),
            pixels(&scene, 0.4, Layer::Full)
        );
    }
}

#[test]
fn every_colour_coefficient_depends_on_time_with_a_head_for_it() {
    let device = Device::flex();
    let colours = |sh_rest: usize| {
        let scene = with_embeddings(sh_rest, &device);
        let [.., early] = deformed(&scene, 0.1);
        let [.., late] = deformed(&scene, 0.9);
        let instant = scene.at(0.9).expect("deforms");
        let of_the_first = &instant.sh_rest[2 * 3 * SH_REST..][..3 * SH_REST];
        assert_eq!(
            of_the_first,
            &late[3..][..3 * SH_REST],
            "an exported instant"
        );
        let pairs = early.into_iter().zip(late);
        let changed: Vec<bool> = pairs.map(|(early, late)| early != late).collect();
        changed[..3 * (1 + SH_REST)].to_vec()
    };
    assert_eq!(colours(SH_REST), [true; 3 * (1 + SH_REST)]);
    let constant_only = colours(0);
    assert_eq!(constant_only[..3], [true; 3]);
    assert_eq!(constant_only[3..], [false; 3 * SH_REST]);
}

#[test]
fn features_of_each_resolution_go_to_their_own_decoder() {
    let device = Device::flex();
    let scene = with_embeddings(0, &device);
    let field = &scene.dynamic.as_ref().expect("given").field;
    let own = field.config().embedding_width();
    let of_time = 8 * own;
    let means = |ones: std::ops::Range<usize>| {
        let mut features = vec![0.0f32; own + 2 * of_time];
        features[ones].fill(1.0);
        let features = Tensor::<1>::from_floats(features.as_slice(), &device);
        let offsets = field.decode(features.unsqueeze()).expect("fits");
        offsets
            .means
            .into_data()
            .try_into_vec::<f32>()
            .expect("f32")
    };
    let [none, coarse, fine, both] = [
        0..0,
        own..own + of_time,
        own + of_time..own + 2 * of_time,
        own..own + 2 * of_time,
    ]
    .map(means);
    for axis in 0..3 {
        let [coarse, fine, both] = [&coarse, &fine, &both].map(|m| m[axis] - none[axis]);
        assert!(coarse != 0.0 && fine != 0.0 && coarse != fine);
        assert!(
            (coarse + fine - both).abs() < 1e-5 * (1.0 + both.abs()),
            "{axis}"
        );
    }
    let short = Tensor::<2>::zeros([1, own], &device);
    let refused = field.decode(short).expect_err("too few").to_string();
    assert!(refused.contains("features"), "{refused}");
}

#[test]
fn a_head_for_colours_that_gaussians_lack_is_refused() {
    let device = Device::flex();
    let scene = with_embeddings(SH_REST - 1, &device);
    let part = scene.dynamic.as_ref().expect("given");
    let refused = part.deform(&scene.settings, 0.5);
    assert!(matches!(refused, Err(ModelError::Argument { .. })));
    let plain = DynamicPart {
        field: part.field.without_sh_rest(),
        ..part.clone()
    };
    plain.deform(&scene.settings, 0.5).expect("no such head");
    let folder = tempfile::tempdir().expect("a scratch folder");
    scene.save(folder.path()).expect("writes");
    let refused = DynamicScene::load(folder.path(), &device);
    let refused = refused.expect_err("no such degree").to_string();
    assert!(refused.contains("heads.sh_rest"), "{refused}");
}
