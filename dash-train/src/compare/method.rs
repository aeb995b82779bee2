//! The methods that can be compared, each as a change of a preset.

use std::fmt;

use dash_model::Representation;
use serde::{Deserialize, Serialize};

use crate::train::TrainConfig;
use crate::train::paper::{Decomposition, TimeResolution};

/// Cells of the coarse one of two resolutions of time, where the preset has one only.
const COARSE_TIME: u32 = 4;

/// Steps after which no run goes on.
const NEVER: usize = 1 << 40;

/// A method for dynamic scenes: DASH, its ablations, and the Gaussian-based systems that the paper
/// compares it with, all with this project's rasterizer, density control and learning rates.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum,
)]
pub enum Method {
    /// The unchanged preset.
    #[serde(rename = "dash")]
    #[value(name = "dash")]
    Dash,
    /// Without the decomposition: the 4D field deforms every Gaussian.
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
    /// Six planes deform every Gaussian, as in 4DGaussians (Wu et al. 2024).
    #[serde(rename = "hexplane")]
    #[value(name = "hexplane")]
    HexPlane,
    /// One 3D and three temporal 3D hash grids deform every Gaussian, as in Grid4D (Xu et al. 2024).
    #[serde(rename = "grid4d")]
    #[value(name = "grid4d")]
    Grid4d,
    /// The same behind the decomposition: the paper's Grid4D+dec.
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
    pub const ALL: [Self; 9] = [
        Self::Dash,
        Self::WithoutDecomposition,
        Self::WithoutControl,
        Self::WithoutRegulariser,
        Self::HexPlane,
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
            Self::HexPlane => "hexplane",
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

    /// Whether its field has a resolution of its own, whatever the preset says.
    fn brings_its_grid(self) -> bool {
        matches!(
            self,
            Self::HexPlane | Self::Grid4d | Self::Grid4dDecomposed | Self::Embedding
        )
    }

    /// A preset changed into this method.
    pub fn of(self, preset: &TrainConfig) -> TrainConfig {
        let mut config = preset.clone();
        if self.brings_its_grid()
            && let Some(gaps) = &mut config.extensions.gaps
        {
            gaps.coarsen = 1.0;
        }
        match self {
            Self::Dash => {}
            Self::WithoutDecomposition => everything_moves(&mut config),
            Self::WithoutControl => {
                config.densify.dynamic.interval = NEVER;
                config.densify.dynamic.opacity_reset_interval = None;
            }
            Self::WithoutRegulariser => config.method.smoothness = 0.0,
            Self::HexPlane => {
                everything_moves(&mut config);
                config.extensions.following = None;
                let field = &mut config.method.field;
                field.representation = Representation::HexPlane;
                field.n_levels = 4;
                field.resolution = [32, 128];
                field.time_resolution = TimeResolution::PerFrame;
            }
            Self::Grid4d => {
                everything_moves(&mut config);
                config.extensions.following = None;
                three_dimensional_grids(&mut config);
            }
            Self::Grid4dDecomposed => three_dimensional_grids(&mut config),
            Self::Embedding => {
                everything_moves(&mut config);
                config.extensions.following = None;
                let field = &mut config.method.field;
                field.representation = Representation::Embedding;
                field.n_levels = 16;
                field.resolution[1] = 64;
                let coarse = match field.time_resolution {
                    TimeResolution::PerFrame => COARSE_TIME,
                    TimeResolution::UpToFrames(coarse) | TimeResolution::Fixed([coarse, _]) => {
                        coarse
                    }
                };
                field.time_resolution = TimeResolution::UpToFrames(coarse);
            }
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

/// Every Gaussian becomes dynamic after the warm-up, and there may be as many as of both kinds
/// otherwise.
fn everything_moves(config: &mut TrainConfig) {
    config.method.decomposition = Decomposition::All;
    let densify = &mut config.densify;
    densify.static_set.max_gaussians += densify.dynamic.max_gaussians;
    // They have what the static ones leave, which is all.
    densify.dynamic.max_gaussians = 0;
    densify.dynamic.during[0] = config.method.stages[0];
    let extensions = &mut config.extensions;
    extensions.demotion = None;
    // What is a crowd among dynamic Gaussians is none where all are.
    extensions.crowding = None;
    // It helps to follow motion, which these do not.
    if let Some(rates) = &mut extensions.capture_rates {
        rates.monocular = 1.0;
    }
    // It costs them, which ask the field for so many, more steps than it is worth.
    if let Some(gaps) = &mut extensions.gaps {
        gaps.steadiness = 0.0;
    }
}

/// Grids of 3 dimensions instead of 4. They have fewer hash collisions than the 4D grid, so their resolution is
/// not lowered for that.
fn three_dimensional_grids(config: &mut TrainConfig) {
    let field = &mut config.method.field;
    field.representation = Representation::Grid4d;
    field.resolution[1] = field.resolution[1].max(64);
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum;

    use super::*;
    use crate::train::Preset;
    use crate::train::core::CaptureFacts;

    #[test]
    fn every_method_is_a_valid_configuration_of_every_preset() {
        for preset in [
            Preset::Default,
            Preset::Quick,
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
    fn grids_that_methods_bring_are_as_fine_with_gaps() {
        let preset = TrainConfig::preset(Preset::Quick);
        for (method, cells) in [
            (Method::HexPlane, 128),
            (Method::Grid4d, 64),
            (Method::Grid4dDecomposed, 64),
            (Method::Embedding, 64),
            (Method::Dash, 4),
            (Method::WithoutDecomposition, 4),
            (Method::WithoutRegulariser, 4),
        ] {
            let config = method.of(&preset);
            let coarsen = config.extensions.gaps.expect("on").coarsen;
            let finest = config.method.field.resolution[1] as f32 * coarsen;
            assert_eq!(finest, cells as f32, "{method}");
        }
    }
}
