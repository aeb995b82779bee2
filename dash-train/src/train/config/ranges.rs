//! Which values a configuration may have.

use super::TrainConfig;
use crate::Error;
use crate::train::core::{CaptureFacts, Ranges};

impl TrainConfig {
    /// Checks every value against its range.
    ///
    /// # Errors
    /// The first key that is out of range, the range and the value.
    pub fn validate(&self) -> Result<(), Error> {
        let mut ranges = Ranges::default();
        ranges.at_least_one("iterations", self.iterations);
        ranges.at_least_one("batch", self.batch);
        if let Some(visits) = self.visits {
            ranges.at_least_one("visits", visits);
        }
        ranges.expect("sh_degree", "0 to 3", self.sh_degree, self.sh_degree <= 3);
        ranges.share("sh_interval", self.sh_interval);
        ranges.share("dssim", self.dssim);
        if let Some(near) = self.near_plane {
            ranges.positive("near_plane", near as f32);
        }
        ranges.in_order("initial_points", self.initial_points);
        ranges.at_least_one("initial_points", self.initial_points[1]);
        ranges.at_least_one("checkpoint_interval", self.checkpoint_interval);
        ranges.section("method", |ranges| self.method.check(ranges));
        ranges.section("optimizer", |ranges| self.optimizer.check(ranges));
        ranges.section("densify", |ranges| self.densify.check(ranges));
        ranges.section("extensions", |ranges| self.extensions.check(ranges));
        ranges.finish()?;
        self.validate_fields()
    }

    /// The grids, for a clip of two frames.
    fn validate_fields(&self) -> Result<(), Error> {
        let facts = CaptureFacts {
            n_frames: 2,
            is_synchronized: false,
        };
        self.method
            .motion_encoder()
            .layout()
            .map_err(|e| Error::Config(format!("method.motion_field: {e}")))?;
        self.method
            .deformation(&facts)
            .validate()
            .map_err(|e| Error::Config(format!("method.field: {e}")))
    }
}
