//! Crowding: above a number of dynamic Gaussians the gradient threshold of density control rises in proportion to their
//! number, so that each of many has to pay for more.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::train::core::{Extension, Run};
use crate::train::paper::Dash;

/// Share of the Gaussians that the decomposition made dynamic which is no crowd yet.
const FREE_SHARE: f32 = 0.5;

/// `[extensions.crowding]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CrowdingConfig {
    /// Dynamic Gaussians above which the threshold rises, at least. Source: ours.
    pub free: usize,
}

/// See [`CrowdingConfig`].
pub struct Crowding(CrowdingConfig);

impl Crowding {
    /// From its section.
    pub fn new(config: CrowdingConfig) -> Self {
        Self(config)
    }
}

impl Extension<Dash> for Crowding {
    fn name(&self) -> &'static str {
        "crowding"
    }

    fn init(&mut self, run: &mut Run<Dash>) {
        run.dynamic_state.crowd = Some(self.0.free);
    }

    fn before_step(&mut self, run: &mut Run<Dash>) -> Result<(), Error> {
        if run.has_just_decomposed() {
            let (_, n) = run.scene.counts();
            let free = (FREE_SHARE * n as f32) as usize;
            run.dynamic_state.crowd = Some(free.max(self.0.free));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use burn::tensor::Device;
    use dash_model::{DeformationField, DynamicPart, GaussianRows, Gaussians, SpaceBox};

    use super::*;
    use crate::synth;
    use crate::train::{Preset, TrainConfig, Trainer};

    /// The crowd once a decomposition made `n` Gaussians dynamic.
    fn crowd_after(n: usize, set: &str) -> Option<usize> {
        let mut config = TrainConfig::preset(Preset::Quick);
        config.set(set).expect("a known key");
        let dataset = Arc::new(synth::loaded(6, 4, [32, 24]));
        let mut trainer = Trainer::new(config, dataset, &Device::flex()).expect("valid");
        let run = &mut trainer.run;
        run.step = run.stages().end;
        let points = vec![[0.0; 3]; n];
        let rows = GaussianRows::from_points(&points, &points, 0, 0.1);
        let (space, device) = (SpaceBox::fixed(1.0), &run.device);
        let field = DeformationField::new(&run.method.field, space, &mut run.rng, device);
        run.scene.dynamic = Some(DynamicPart {
            gaussians: Gaussians::from_rows(&rows, device),
            field: field.expect("valid"),
        });
        if let Some(crowding) = trainer.hooks.get_mut::<Crowding>() {
            crowding.before_step(&mut trainer.run).expect("counts");
        }
        trainer.run.dynamic_state.crowd
    }

    #[test]
    fn half_of_what_the_decomposition_makes_dynamic_is_no_crowd() {
        let on = "extensions.crowding.free=400";
        let after = |n| crowd_after(n, on);
        let expected = [1, 800, 900, 6_000].map(after);
        assert_eq!(expected, [400, 400, 450, 3_000].map(Some));
        assert_eq!(crowd_after(6_000, "extensions.crowding=none"), None);
    }
}
