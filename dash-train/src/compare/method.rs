//! The methods that can be compared, each as a change of a preset.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::train::TrainConfig;
use crate::train::paper::Decomposition;
use crate::train::paper::published::{EMBEDDING, GRID4D, HEXPLANE, Published, Schedule};
use crate::train::paper::scale::Scale;

/// A method for dynamic scenes: DASH, its ablations, and the Gaussian-based systems that the paper
/// compares it with, all with this project's rasterizer and density control. Other methods have their authors' sizes,
/// learning rates and schedules, see [`published`](crate::train::paper::published).
///
/// ```
/// use dash_train::compare::Method;
///
/// let names = Method::ALL.map(Method::name);
/// assert!(names.contains(&"hexplane+dec"));
/// ```
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum,
)]
pub enum Method {
    /// The unchanged preset.
    #[serde(rename = "dash")]
    #[value(name = "dash")]
    Dash,
    /// Without the decomposition: every Gaussian has coarse motion, and the 4D field deforms it.
    #[serde(rename = "w/o-dec")]
    #[value(name = "w/o-dec")]
    WithoutDecomposition,
    /// Without density control of the dynamic Gaussians.
    #[serde(rename = "w/o-ctrl")]
    #[value(name = "w/o-ctrl")]
    WithoutControl,
    /// Without the smoothness regulariser (Eq. 11).
    #[serde(rename = "w/o-reg")]
    #[value(name = "w/o-reg")]
    WithoutRegulariser,
    /// The 4D hash grid alone: no motion is followed, and the field deforms every Gaussian.
    #[serde(rename = "hash")]
    #[value(name = "hash")]
    Hash,
    /// Six planes deform every Gaussian, as in 4DGaussians (Wu et al. 2024).
    #[serde(rename = "hexplane")]
    #[value(name = "hexplane")]
    HexPlane,
    /// The same planes behind following and decomposition.
    #[serde(rename = "hexplane+dec")]
    #[value(name = "hexplane+dec")]
    HexPlaneDecomposed,
    /// One 3D and three temporal 3D hash grids deform every Gaussian, as in Grid4D (Xu et al. 2024).
    #[serde(rename = "grid4d")]
    #[value(name = "grid4d")]
    Grid4d,
    /// The same grids behind following and decomposition: the paper's Grid4D+dec.
    #[serde(rename = "grid4d+dec")]
    #[value(name = "grid4d+dec")]
    Grid4dDecomposed,
    /// An embedding per Gaussian and a network of it and time, as in E-D3DGS (Bae et al. 2024).
    #[serde(rename = "embedding")]
    #[value(name = "embedding")]
    Embedding,
    /// 3DGS: nothing moves.
    #[serde(rename = "static")]
    #[value(name = "static")]
    Static,
}

impl Method {
    /// All of them, in the order of the tables.
    pub const ALL: [Self; 11] = [
        Self::Dash,
        Self::WithoutDecomposition,
        Self::WithoutControl,
        Self::WithoutRegulariser,
        Self::Hash,
        Self::HexPlane,
        Self::HexPlaneDecomposed,
        Self::Grid4d,
        Self::Grid4dDecomposed,
        Self::Embedding,
        Self::Static,
    ];

    /// The name on the command line and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dash => "dash",
            Self::WithoutDecomposition => "w/o-dec",
            Self::WithoutControl => "w/o-ctrl",
            Self::WithoutRegulariser => "w/o-reg",
            Self::Hash => "hash",
            Self::HexPlane => "hexplane",
            Self::HexPlaneDecomposed => "hexplane+dec",
            Self::Grid4d => "grid4d",
            Self::Grid4dDecomposed => "grid4d+dec",
            Self::Embedding => "embedding",
            Self::Static => "static",
        }
    }

    /// The name of its folder.
    pub fn folder(self) -> String {
        self.name().replace('/', "")
    }

    /// What its authors published of it, where its field is not the preset's.
    pub fn published(self) -> Option<&'static Published> {
        match self {
            Self::HexPlane | Self::HexPlaneDecomposed => Some(&HEXPLANE),
            Self::Grid4d | Self::Grid4dDecomposed => Some(&GRID4D),
            Self::Embedding => Some(&EMBEDDING),
            Self::Dash
            | Self::WithoutDecomposition
            | Self::WithoutControl
            | Self::WithoutRegulariser
            | Self::Hash
            | Self::Static => None,
        }
    }

    /// A preset changed into this method.
    pub fn of(self, preset: &TrainConfig) -> TrainConfig {
        let mut config = preset.clone();
        if let Some(published) = self.published() {
            take_field(&mut config, published);
        }
        match self {
            Self::Dash | Self::HexPlaneDecomposed | Self::Grid4dDecomposed => {}
            Self::WithoutDecomposition => {
                deform_everything(&mut config, Decomposition::AllWithMotion);
            }
            Self::WithoutControl => {
                let [_, end] = config.densify.dynamic.during;
                config.densify.dynamic.during = [end; 2];
            }
            Self::WithoutRegulariser => config.method.smoothness = 0.0,
            Self::Hash => field_alone(&mut config, &GRID4D.schedule),
            Self::HexPlane => field_alone(&mut config, &HEXPLANE.schedule),
            Self::Grid4d => field_alone(&mut config, &GRID4D.schedule),
            Self::Embedding => field_alone(&mut config, &EMBEDDING.schedule),
            Self::Static => config.method.decomposition = Decomposition::None,
        }
        config
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The sizes and rates of a published field, at the preset's scale.
fn take_field(config: &mut TrainConfig, published: &Published) {
    let scale = Scale::of(&config.method.field, &config.optimizer);
    config.method.field = scale.field(&published.field);
    config.optimizer = scale.rates(&published.rates, &config.optimizer);
    // Cells are as published, beside time gaps as elsewhere.
    if let Some(gaps) = &mut config.extensions.gaps {
        gaps.coarsen = 1.0;
    }
}

/// Every Gaussian becomes dynamic, and there may be as many as of both kinds otherwise.
fn deform_everything(config: &mut TrainConfig, decomposition: Decomposition) {
    config.method.decomposition = decomposition;
    let densify = &mut config.densify;
    densify.static_set.max_gaussians += densify.dynamic.max_gaussians;
    // They have what the static ones leave, which is all.
    densify.dynamic.max_gaussians = 0;
    let extensions = &mut config.extensions;
    extensions.demotion = None;
    // What is a crowd among dynamic Gaussians is none where all are.
    extensions.crowding = None;
}

/// A field deforms every Gaussian from the warm-up on, by itself: what the preset does to find and follow motion is left
/// out, and warm-up, density control and opacity resets come when the schedule says.
fn field_alone(config: &mut TrainConfig, schedule: &Schedule) {
    deform_everything(config, Decomposition::All);
    let warmup = schedule.share(schedule.warmup);
    config.method.stages = [warmup, config.method.stages[1].max(warmup)];
    let iterations = config.iterations;
    let densify = &mut config.densify;
    let [from, until] = schedule.densify.map(|step| schedule.share(step));
    densify.static_set.during = [from, until];
    densify.dynamic.during = [from.max(warmup), until];
    let interval = schedule.opacity_reset_interval;
    let interval = interval.map(|interval| schedule.interval(interval, iterations));
    densify.opacity_reset_interval = interval;
    let extensions = &mut config.extensions;
    extensions.following = None;
    // Learning rates and steadiness of motion following.
    if let Some(rates) = &mut extensions.capture_rates {
        rates.monocular = 1.0;
    }
    if let Some(gaps) = &mut extensions.gaps {
        gaps.steadiness = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::Device;
    use clap::ValueEnum;

    use super::*;
    use crate::synth;
    use crate::train::config::tests::small;
    use crate::train::core::CaptureFacts;
    use crate::train::{Preset, Trainer};

    #[test]
    fn every_method_is_a_valid_configuration_of_every_preset() {
        for preset in [
            Preset::Default,
            Preset::Quick,
            Preset::Best,
            Preset::Paper,
            Preset::Reference,
        ] {
            for method in Method::ALL {
                let config = method.of(&TrainConfig::preset(preset));
                config
                    .validate()
                    .unwrap_or_else(|e| panic!("{preset:?} {method}: {e}"));
                for (n_frames, is_synchronized) in
                    [(1, false), (1, true), (2, true), (15, false), (300, true)]
                {
                    let facts = CaptureFacts {
                        n_frames,
                        is_synchronized,
                    };
                    config
                        .method
                        .deformation(&facts)
                        .validate()
                        .unwrap_or_else(|e| panic!("{preset:?} {method}, {facts:?}: {e}"));
                }
            }
        }
    }

    #[test]
    fn names_are_the_same_everywhere() {
        assert_eq!(Method::value_variants(), Method::ALL);
        for method in Method::ALL {
            let on_the_command_line = method.to_possible_value().expect("not hidden");
            assert_eq!(on_the_command_line.get_name(), method.name());
            assert_eq!(
                serde_json::to_string(&method).expect("serialises"),
                format!("\"{}\"", method.name())
            );
            assert!(!method.folder().contains('/'));
        }
    }

    #[test]
    fn only_dash_is_the_preset_itself() {
        let preset = TrainConfig::preset(Preset::Quick);
        for method in Method::ALL {
            assert_eq!(
                method.of(&preset) == preset,
                method == Method::Dash,
                "{method}"
            );
        }
    }

    #[test]
    fn published_cells_are_as_fine_with_gaps() {
        let preset = TrainConfig::preset(Preset::Quick);
        for (method, cells) in [
            (Method::HexPlane, 128.0),
            (Method::HexPlaneDecomposed, 128.0),
            (Method::Grid4d, 2048.0),
            (Method::Grid4dDecomposed, 2048.0),
            (Method::Dash, 4.0),
            (Method::Hash, 4.0),
            (Method::WithoutDecomposition, 4.0),
            (Method::WithoutRegulariser, 4.0),
        ] {
            let config = method.of(&preset);
            let coarsen = config.extensions.gaps.expect("on").coarsen;
            let finest = config.method.field.resolution[1] as f32 * coarsen;
            assert_eq!(finest, cells, "{method}");
        }
    }

    /// What a row of the 2 x 2 has in common, and what a column.
    #[test]
    fn representation_and_decomposition_are_changed_apart() {
        let preset = TrainConfig::preset(Preset::Quick);
        let of = |method: Method| method.of(&preset);
        let [dash, hash] = [Method::Dash, Method::Hash].map(of);
        for (with, without) in [
            (Method::Dash, Method::Hash),
            (Method::Grid4dDecomposed, Method::Grid4d),
            (Method::HexPlaneDecomposed, Method::HexPlane),
        ] {
            let [with, without] = [with, without].map(of);
            assert_eq!(with.method.field, without.method.field);
            assert_eq!(with.optimizer, without.optimizer);
            assert_eq!(with.method.stages, dash.method.stages);
            assert_eq!(with.densify, dash.densify);
            assert_eq!(with.extensions.following, dash.extensions.following);
            assert_eq!(without.method.decomposition, Decomposition::All);
            assert_eq!(without.extensions.following, None);
        }
        let grid4d = of(Method::Grid4d);
        assert_eq!(grid4d.method.stages, hash.method.stages);
        assert_eq!(grid4d.densify, hash.densify);
    }

    #[test]
    fn other_methods_keep_their_authors_schedule() {
        let preset = TrainConfig::preset(Preset::Quick);
        let of = |method: Method| {
            let config = method.of(&preset);
            let reset = config.densify.opacity_reset_interval;
            (
                config.method.stages[0],
                config.densify.dynamic.during,
                reset,
            )
        };
        // 6,000 of 50,000 steps are 720 of 6,000.
        assert_eq!(of(Method::Grid4d), (0.06, [0.06, 0.3], Some(720)));
        assert_eq!(of(Method::Embedding), (0.0, [0.0625, 1.0], None));
        let (warmup, during, reset) = of(Method::HexPlane);
        assert_eq!((warmup, during), (3.0 / 17.0, [3.0 / 17.0, 13.0 / 17.0]));
        assert_eq!(reset, None);
    }

    #[test]
    fn without_decomposition_every_gaussian_keeps_its_coarse_motion() {
        let mut preset = small(&["iterations=40"]);
        preset.seed = 3;
        let dataset = Arc::new(synth::loaded(4, 4, [32, 24]));
        let trained = |method: Method| {
            let config = method.of(&preset);
            let mut trainer =
                Trainer::new(config, dataset.clone(), &Device::flex()).expect("valid");
            while !trainer.is_finished() {
                trainer.step().expect("trains");
            }
            let scene = trainer.scene();
            let dynamic = scene.dynamic.as_ref().expect("something moves");
            let trajectories = dynamic.gaussians.trajectories.as_ref();
            let moves = trajectories.map(|own| own.val().abs().sum().into_scalar::<f32>());
            (scene.counts().0, moves)
        };
        let (n_static, moves) = trained(Method::WithoutDecomposition);
        assert_eq!(n_static, 0);
        assert!(moves.expect("trajectories") > 0.0);
        for method in [
            Method::Hash,
            Method::HexPlane,
            Method::Grid4d,
            Method::Embedding,
        ] {
            assert_eq!(trained(method), (0, None), "{method}");
        }
        let (n_static, moves) = trained(Method::Dash);
        assert!(n_static > 0 && moves.is_some());
    }
}
