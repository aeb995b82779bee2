//! A cost of floaters: dark smoke in empty space, which no training picture tells from what is behind it.

use burn::tensor::Tensor;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::dataset::View;
use crate::train::core::coverage::nearness;
use crate::train::core::loss::opacity;
use crate::train::core::{Extension, Forward, Run, to_host};

/// `[extensions.floaters]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FloatersConfig {
    /// Weight of the mean opacity of the static Gaussians: what no picture needs fades. Source: Kheradmand et al. 2024
    /// (MCMC), 0.01.
    pub opacity: f32,
    /// Weight of what Gaussians cover of the picture from nearer than half of the typical distance. Source: ours.
    pub nearness: f32,
}

/// See [`FloatersConfig`].
pub struct Floaters(pub(crate) FloatersConfig);

impl Floaters {
    /// From its section.
    pub fn new(config: FloatersConfig) -> Self {
        Self(config)
    }
}

impl<M> Extension<M> for Floaters {
    fn name(&self) -> &'static str {
        "floaters"
    }

    fn loss_terms(
        &mut self,
        run: &mut Run<M>,
        _view: &View,
        forward: &Forward,
    ) -> Result<Vec<Tensor<1>>, Error> {
        let mut terms = Vec::new();
        let weight = self.0.opacity;
        if weight > 0.0 {
            terms.extend(opacity(&run.scene.static_set).map(|mean| mean * weight));
        }
        let weight = self.0.nearness;
        if weight > 0.0 {
            let motion = forward
                .motion
                .clone()
                .map(|motion| to_host(motion.detach()));
            let cost = nearness(
                &run.scene.static_set,
                forward.static_probe.coverage(),
                &motion.unwrap_or_default(),
            );
            terms.extend(cost.map(|cost| cost * weight));
            if let (Some(dynamic), Some(probe)) = (&run.scene.dynamic, &forward.dynamic_probe) {
                let cost = nearness(&dynamic.gaussians, probe.coverage(), &[]);
                terms.extend(cost.map(|cost| cost * weight));
            }
        }
        Ok(terms)
    }
}
