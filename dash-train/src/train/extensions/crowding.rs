//! Crowding: above a number of dynamic Gaussians the gradient threshold of density control rises in proportion to their
//! number, so that each of many has to pay for more.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::train::core::{Extension, Ranges, Rules, Run, Saved, Section, Set};
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

impl Section for CrowdingConfig {
    fn check(&self, ranges: &mut Ranges) {
        ranges.at_least_one("free", self.free);
    }
}

/// See [`CrowdingConfig`].
pub struct Crowding {
    config: CrowdingConfig,
    /// Dynamic Gaussians above which the threshold rises.
    crowd: usize,
}

impl Crowding {
    /// From its section.
    pub fn new(config: CrowdingConfig) -> Self {
        let crowd = config.free;
        Self { config, crowd }
    }
}

impl Extension<Dash> for Crowding {
    fn name(&self) -> &'static str {
        "crowding"
    }

    fn before_step(&mut self, run: &mut Run<Dash>) -> Result<(), Error> {
        if run.has_just_decomposed() {
            let (_, n) = run.scene.counts();
            let free = (FREE_SHARE * n as f32) as usize;
            self.crowd = free.max(self.config.free);
        }
        Ok(())
    }

    fn density_rules(&self, set: Set, n: usize, rules: &mut Rules) {
        if set == Set::Dynamic {
            rules.gradient_threshold *= (n as f32 / self.crowd as f32).max(1.0);
        }
    }

    fn save(&self) -> Saved {
        Saved::of_values(&self.crowd)
    }

    fn restore(&mut self, _run: &Run<Dash>, saved: Saved) -> Result<(), String> {
        self.crowd = saved.read()?;
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

    /// Factors of both sets' thresholds for these numbers of Gaussians, once a decomposition made `n` of them dynamic.
    fn factors_after(n: usize, counts: [usize; 3]) -> [[f32; 3]; 2] {
        let mut config = TrainConfig::preset(Preset::Quick);
        config
            .set("extensions.crowding.free=400")
            .expect("a known key");
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
        let crowding = trainer.hooks.get_mut::<Crowding>().expect("on");
        crowding.before_step(&mut trainer.run).expect("counts");
        let saved = crowding.save();
        let mut resumed = Crowding::new(CrowdingConfig { free: 400 });
        resumed.restore(&trainer.run, saved).expect("a number");
        let base = 2e-4;
        Set::BOTH.map(|set| {
            counts.map(|n| {
                let mut rules = Rules {
                    gradient_threshold: base,
                    prunes_oversized: true,
                };
                resumed.density_rules(set, n, &mut rules);
                rules.gradient_threshold / base
            })
        })
    }

    #[test]
    fn half_of_what_the_decomposition_makes_dynamic_is_no_crowd() {
        let few = factors_after(1, [0, 400, 1_000]);
        assert_eq!(few, [[1.0; 3], [1.0, 1.0, 2.5]]);
        let more = factors_after(900, [400, 450, 900]);
        assert_eq!(more, [[1.0; 3], [1.0, 1.0, 2.0]]);
    }
}
