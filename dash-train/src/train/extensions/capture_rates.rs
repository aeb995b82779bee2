//! Learning rates by kind of capture.
//!
//! In a monocular capture each time has one picture, and means have farther to go; where synchronised cameras show every
//! time, scales and tables learn fast enough to profit from more.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::train::core::{Extension, Ranges, Run, Section};

/// `[extensions.capture_rates]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaptureRatesConfig {
    /// Factor of the means' rate where no time by itself shows the scene from several sides. Source: ours.
    pub monocular: f32,
    /// Factor of the rates of scales and tables where synchronised cameras do. Source: ours.
    pub synchronized: f32,
}

impl Section for CaptureRatesConfig {
    fn check(&self, ranges: &mut Ranges) {
        ranges.positive("monocular", self.monocular);
        ranges.positive("synchronized", self.synchronized);
    }
}

/// See [`CaptureRatesConfig`].
pub struct CaptureRates(CaptureRatesConfig);

impl CaptureRates {
    /// From its section.
    pub fn new(config: CaptureRatesConfig) -> Self {
        Self(config)
    }
}

impl<M> Extension<M> for CaptureRates {
    fn name(&self) -> &'static str {
        "capture_rates"
    }

    fn init(&mut self, run: &mut Run<M>) {
        match run.start {
            Some(span) if span.is_one_time() => {
                run.rates.scales *= self.0.synchronized;
                run.rates.grid *= self.0.synchronized;
            }
            Some(_) => run.rates.means[0] *= self.0.monocular,
            None => {}
        }
    }
}
