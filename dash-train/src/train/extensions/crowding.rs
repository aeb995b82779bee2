//! Crowding: above a number of dynamic Gaussians the gradient threshold of density control rises in proportion to their
//! number, so that each of many has to pay for more.

use serde::{Deserialize, Serialize};

use crate::TrainError;
use crate::train::core::{Extension, Run};
use crate::train::paper::Dash;

/// Share of the Gaussians that the decomposition made dynamic which is no crowd yet. Only where synchronised cameras show
/// every time: of a monocular capture each time has one picture, and more Gaussians show nothing more.
const FREE_SHARE: f32 = 0.5;

/// `[extensions.crowding]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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

    fn before_step(&mut self, run: &mut Run<Dash>) -> Result<(), TrainError> {
        if run.has_just_decomposed() && run.is_synchronized() {
            let (_, n) = run.scene.counts();
            let free = (FREE_SHARE * n as f32) as usize;
            run.dynamic_state.crowd = Some(free.max(self.0.free));
        }
        Ok(())
    }
}
