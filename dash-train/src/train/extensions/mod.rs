//! Ideas beyond the paper, one file or folder each. An extension owns its section of the configuration, its state, its
//! terms of the loss and its hooks; the preset `paper` runs with none.

mod appearance;
mod averaging;
mod blocks;
mod capture_rates;
mod crowding;
mod demotion;
mod exposure;
mod floaters;
mod following;
mod gaps;
mod prune;
mod rest_cost;
mod scale_limit;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use appearance::{Appearance, AppearanceConfig};
pub use averaging::{Averaging, AveragingConfig};
pub use capture_rates::{CaptureRates, CaptureRatesConfig};
pub use crowding::{Crowding, CrowdingConfig};
pub use demotion::{Demotion, DemotionConfig};
pub use exposure::{Exposure, ExposureConfig};
pub use floaters::{Floaters, FloatersConfig};
pub(crate) use following::{FLOW_END, FLOW_REST, FLOW_WARMUP, FRAME_STEPS, stages_of_flow};
pub use following::{Following, FollowingConfig};
pub use gaps::{GapsConfig, TimeGaps};
pub use prune::{Prune, PruneConfig};
pub use rest_cost::{RestCost, RestCostConfig};
pub use scale_limit::{ScaleLimit, ScaleLimitConfig};

use super::core::{Extension, Ranges, Section};
use super::paper::Dash;

/// The sections, and the list of extensions in the order in which their hooks are called.
macro_rules! extensions {
    ($($(#[doc = $about:literal])+ $name:ident: $config:ty => $extension:ty,)+) => {
        /// The sections `[extensions.NAME]`; an extension without a section does not run.
        #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields)]
        pub struct ExtensionsConfig {
            $(
                $(#[doc = $about])+
                #[serde(default, skip_serializing_if = "Option::is_none")]
                pub $name: Option<$config>,
            )+
        }

        impl ExtensionsConfig {
            /// The extensions that have a section, in the order in which their hooks are called.
            pub fn build(&self) -> Vec<Box<dyn Extension<Dash>>> {
                let mut built: Vec<Box<dyn Extension<Dash>>> = Vec::new();
                $(
                    if let Some(config) = &self.$name {
                        built.push(Box::new(<$extension>::new(config.clone())));
                    }
                )+
                built
            }

            /// The ranges of every section's keys.
            pub(crate) fn check(&self, ranges: &mut Ranges) {
                $(
                    if let Some(config) = &self.$name {
                        ranges.section(stringify!($name), |ranges| config.check(ranges));
                    }
                )+
            }
        }
    };
}

extensions! {
    /// Learning rates by kind of capture.
    capture_rates: CaptureRatesConfig => CaptureRates,
    /// Leaving out what the scene does not need.
    prune: PruneConfig => Prune,
    /// Following motion from frame to frame.
    following: FollowingConfig => Following,
    /// Time gaps in the training views.
    gaps: GapsConfig => TimeGaps,
    /// A gain and an offset per camera.
    exposure: ExposureConfig => Exposure,
    /// A cost of visible motion. On or off. Source: ours.
    rest_cost: RestCostConfig => RestCost,
    /// A cost of floaters: of opacity, and of Gaussians near a camera. On or off. Source: Kheradmand et al. 2024 (MCMC) for opacity, 0.01; ours.
    floaters: FloatersConfig => Floaters,
    /// A limit of scales: a tenth of the extent. On or off. Source: ours; 3DGS prunes above it.
    scale_limit: ScaleLimitConfig => ScaleLimit,
    /// Demotion of resting dynamic Gaussians to static ones.
    demotion: DemotionConfig => Demotion,
    /// A gradient threshold that rises with the number of dynamic Gaussians.
    crowding: CrowdingConfig => Crowding,
    /// Colours that change over time.
    appearance: AppearanceConfig => Appearance,
    /// Weight averaging over the last steps.
    averaging: AveragingConfig => Averaging,
}
