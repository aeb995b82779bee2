//! The methods that can be compared, each as a change of a preset.

use std::fmt;

use dash_model::{Heads, Representation};
use serde::{Deserialize, Serialize};

use crate::train::TrainConfig;
use crate::train::config::{Selection, TimeWindow};

/// A base resolution of time: all levels get the finest.
const SAME_TIME: u32 = 0;
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
        if self.brings_its_grid() {
            config.field.cells_with_gaps = 1.0;
        }
        match self {
            Self::Dash => {}
            Self::WithoutDecomposition => everything_moves(&mut config),
            Self::WithoutControl => {
                config.density_dynamic.interval = NEVER;
                config.density_dynamic.opacity_reset_interval = 0;
            }
            Self::WithoutRegulariser => config.loss.smoothness = 0.0,
            Self::HexPlane => {
                everything_moves(&mut config);
                config.stages.window = TimeWindow::All;
                let field = &mut config.field.deformation;
                field.representation = Representation::HexPlane;
                let grid = &mut field.encoder;
                (grid.n_levels, grid.n_features_per_level) = (4, 8);
                set_resolution(&mut grid.base_resolution, 32, SAME_TIME);
                set_resolution(&mut grid.finest_resolution, 128, 0);
            }
            Self::Grid4d => {
                everything_moves(&mut config);
                config.stages.window = TimeWindow::All;
                three_dimensional_grids(&mut config);
            }
            Self::Grid4dDecomposed => three_dimensional_grids(&mut config),
            Self::Embedding => {
                everything_moves(&mut config);
                config.stages.window = TimeWindow::All;
                let field = &mut config.field.deformation;
                field.representation = Representation::Embedding;
                field.heads = Heads {
                    appearance: true,
                    ..field.heads
                };
                let grid = &mut field.encoder;
                (grid.n_levels, grid.n_features_per_level) = (16, 2);
                set_resolution(&mut grid.finest_resolution, 64, 0);
                if let [.., time @ SAME_TIME] = grid.base_resolution.as_mut_slice() {
                    *time = COARSE_TIME;
                }
            }
            Self::Static => config.decomposition.enabled = false,
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
    config.decomposition.select = Selection::All;
    config.decomposition.review_interval = 0;
    let most = config.density_static.max_gaussians + config.density_dynamic.max_gaussians;
    config.density_static.max_gaussians = most;
    // They get what the static Gaussians leave, which is all.
    config.density_dynamic.max_gaussians = 0;
    // A crowd of dynamic Gaussians is none where all Gaussians are dynamic.
    config.density_dynamic.crowd = 0;
    config.density_dynamic.from = config.stages.warmup;
    // It helps block matching, which these methods do without.
    config.learning_rates.means_in_turns = 1.0;
    // They query the field for so many Gaussians that it costs more steps than it is worth.
    config.loss.steadiness = 0.0;
}

/// Grids of 3 dimensions instead of 4. They have fewer hash collisions than the 4D grid, so their resolution is
/// not lowered for that.
fn three_dimensional_grids(config: &mut TrainConfig) {
    config.field.deformation.representation = Representation::Grid4d;
    let finest = &mut config.field.deformation.encoder.finest_resolution;
    for axis in &mut finest[..3] {
        *axis = (*axis).max(64);
    }
}

fn set_resolution(resolution: &mut Vec<u32>, space: u32, time: u32) {
    *resolution = vec![space, space, space, time];
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum;

    use super::*;
    use crate::train::Preset;

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
                for (frames, at_once) in
                    [(1, false), (1, true), (2, true), (15, false), (300, true)]
                {
                    config
                        .for_frames(frames, at_once)
                        .validate()
                        .unwrap_or_else(|e| {
                            panic!("{preset:?} {method}, {frames} frames, {at_once}: {e}")
                        });
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
            let mut config = method.of(&preset);
            config.coarsen_for_gaps();
            let finest = config.field.deformation.encoder.finest_resolution[0];
            assert_eq!(finest, cells, "{method}");
        }
    }
}
