//! A small run that the tests of training share.

use std::sync::{Arc, OnceLock};

use super::{Preset, TrainConfig};
use crate::dataset::{Dataset, LoadOptions, load};
use crate::synth::{self, SynthConfig};

/// The split of [`config`].
pub(super) const SPLIT: usize = 12;

/// `bounce`, 4 cameras, 4 frames, 32x24 pixels.
pub(super) fn dataset() -> Arc<Dataset> {
    static LOADED: OnceLock<Arc<Dataset>> = OnceLock::new();
    LOADED
        .get_or_init(|| {
            let folder = tempfile::tempdir().expect("a scratch folder");
            let config = SynthConfig {
                cameras: 4,
                frames: 4,
                width: 32,
                height: 24,
                ..SynthConfig::default()
            };
            synth::write(folder.path(), &config).expect("writes");
            Arc::new(load(folder.path(), &LoadOptions::default()).expect("sound"))
        })
        .clone()
}

/// Of 40 steps, half of 300 Gaussians dynamic, no density control.
pub(super) fn config() -> TrainConfig {
    let mut config = TrainConfig::preset(Preset::Quick);
    for assignment in [
        "iterations=40",
        "max_initial_points=300",
        "min_initial_points=0",
        "stages.warmup=0.1",
        "stages.min_following=0",
        "stages.settle=0.5",
        "stages.decomposition=0.3",
        "decomposition.floor=0",
        "decomposition.quantile=0.5",
        "decomposition.review_interval=0",
        "decomposition.encoder.log2_hashmap_size=8",
        "field.deformation.encoder.log2_hashmap_size=8",
        "field.deformation.hidden=8",
        "density_static.until=0",
        "density_dynamic.until=0",
    ] {
        config.set(assignment).expect("a known key");
    }
    config
}
