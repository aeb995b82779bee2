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

use super::core::Extension;
use super::paper::Dash;

/// The sections `[extensions.NAME]`; an extension without a section does not run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExtensionsConfig {
    /// Learning rates by kind of capture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capture_rates: Option<CaptureRatesConfig>,
    /// Leaving out what the scene does not need.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prune: Option<PruneConfig>,
    /// Following motion from frame to frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub following: Option<FollowingConfig>,
    /// Time gaps in the training views.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gaps: Option<GapsConfig>,
    /// A gain and an offset per camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure: Option<ExposureConfig>,
    /// A cost of visible motion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rest_cost: Option<RestCostConfig>,
    /// A cost of floaters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floaters: Option<FloatersConfig>,
    /// A limit of scales.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale_limit: Option<ScaleLimitConfig>,
    /// Demotion of resting dynamic Gaussians to static ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub demotion: Option<DemotionConfig>,
    /// A gradient threshold that rises with the number of dynamic Gaussians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crowding: Option<CrowdingConfig>,
    /// Colours that change over time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub appearance: Option<AppearanceConfig>,
    /// Weight averaging over the last steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub averaging: Option<AveragingConfig>,
}

impl ExtensionsConfig {
    /// The extensions that have a section, in the order in which their hooks are called.
    pub fn build(&self) -> Vec<Box<dyn Extension<Dash>>> {
        fn boxed<C: Clone, E: Extension<Dash>>(
            config: &Option<C>,
            build: impl FnOnce(C) -> E,
        ) -> Option<Box<dyn Extension<Dash>>> {
            let config = config.clone()?;
            Some(Box::new(build(config)))
        }
        let all = [
            boxed(&self.capture_rates, CaptureRates::new),
            boxed(&self.prune, Prune::new),
            boxed(&self.following, Following::new),
            boxed(&self.gaps, TimeGaps::new),
            boxed(&self.exposure, Exposure::new),
            boxed(&self.rest_cost, RestCost::new),
            boxed(&self.floaters, Floaters::new),
            boxed(&self.scale_limit, ScaleLimit::new),
            boxed(&self.demotion, Demotion::new),
            boxed(&self.crowding, Crowding::new),
            boxed(&self.appearance, Appearance::new),
            boxed(&self.averaging, Averaging::new),
        ];
        all.into_iter().flatten().collect()
    }
}
