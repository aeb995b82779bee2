//! Which values a configuration may have.

use super::TrainConfig;
use crate::Error;
use crate::train::core::{CaptureFacts, DensifyConfig};

/// Most units of a hidden layer.
const MAX_UNITS: usize = 4096;

/// A key, its value and whether that is in range.
type Check<'a> = (&'a str, String, bool);

impl TrainConfig {
    /// Checks every value against its range.
    ///
    /// # Errors
    /// The first key that is out of range, its value and the range.
    pub fn validate(&self) -> Result<(), Error> {
        check("in [0, 1]", self.shares())?;
        check("finite and not negative", self.not_negative())?;
        check("at most 1", self.at_most_one())?;
        check("greater than 0", self.positive())?;
        check("at least 1", self.counts())?;
        let within = |name, value: usize, most: usize| {
            let ok = (1..=most).contains(&value);
            check(&format!("1 to {most}"), vec![(name, value.to_string(), ok)])
        };
        let method = &self.method;
        within(
            "method.motion_field.hidden",
            method.motion_field.hidden,
            MAX_UNITS,
        )?;
        within("method.field.hidden", method.field.hidden, MAX_UNITS)?;
        let degree = self.sh_degree;
        check(
            "0 to 3",
            vec![("sh_degree", degree.to_string(), degree <= 3)],
        )?;
        let (stages, points) = (method.stages, self.initial_points);
        check(
            "in order",
            vec![
                (
                    "method.stages",
                    format!("{stages:?}"),
                    stages[0] <= stages[1],
                ),
                (
                    "initial_points",
                    format!("{points:?}"),
                    points[0] <= points[1],
                ),
            ],
        )?;
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

    fn sets(&self) -> [&DensifyConfig; 2] {
        [&self.densify.static_set, &self.densify.dynamic]
    }

    fn shares(&self) -> Vec<Check<'_>> {
        let method = &self.method;
        let mut values = vec![
            ("sh_interval", self.sh_interval),
            ("dssim", self.dssim),
            ("method.stages", method.stages[0]),
            ("method.stages", method.stages[1]),
            ("method.static_quantile", method.static_quantile),
        ];
        if let Some(following) = &self.extensions.following {
            values.push(("extensions.following.handover", following.handover));
            let flow = (
                "extensions.following.flow_handover",
                following.flow_handover,
            );
            values.push(flow);
        }
        if let Some(averaging) = &self.extensions.averaging {
            values.push(("extensions.averaging.share", averaging.share));
        }
        numbers(values, |value| (0.0..=1.0).contains(&value))
    }

    fn not_negative(&self) -> Vec<Check<'_>> {
        let (method, rates) = (&self.method, &self.optimizer);
        let mut values = vec![
            ("method.motion_floor", method.motion_floor),
            ("method.static_motion", method.static_motion),
            ("method.smoothness", method.smoothness),
            (
                "method.motion_field.grid_rate",
                method.motion_field.grid_rate,
            ),
            (
                "method.motion_field.network_rate",
                method.motion_field.network_rate,
            ),
            ("optimizer.means", rates.means),
            ("optimizer.means_final", rates.means_final),
            ("optimizer.grid", rates.grid),
            ("optimizer.network", rates.network),
            ("optimizer.field_final", rates.field_final),
            (
                "densify.gradient_threshold",
                self.densify.gradient_threshold,
            ),
        ];
        let names = ["densify.static.during", "densify.dynamic.during"];
        for (name, set) in names.into_iter().zip(self.sets()) {
            values.extend(set.during.map(|share| (name, share)));
        }
        let extensions = &self.extensions;
        if let Some(rest) = &extensions.rest_cost {
            values.push(("extensions.rest_cost.field", rest.field));
            values.push(("extensions.rest_cost.gaussians", rest.gaussians));
            values.extend(
                rest.flow
                    .map(|weight| ("extensions.rest_cost.flow", weight)),
            );
        }
        if let Some(floaters) = &extensions.floaters {
            values.push(("extensions.floaters.opacity", floaters.opacity));
            values.push(("extensions.floaters.nearness", floaters.nearness));
        }
        if let Some(gaps) = &extensions.gaps {
            values.push(("extensions.gaps.steadiness", gaps.steadiness));
        }
        numbers(values, |value| value.is_finite() && value >= 0.0)
    }

    fn at_most_one(&self) -> Vec<Check<'_>> {
        let mut values = vec![("method.smoothness_share", self.method.smoothness_share)];
        if let Some(gaps) = &self.extensions.gaps {
            values.push(("extensions.gaps.coarsen", gaps.coarsen));
        }
        numbers(values, |value| value <= 1.0)
    }

    fn positive(&self) -> Vec<Check<'_>> {
        let mut values = vec![("method.smoothness_share", self.method.smoothness_share)];
        values.extend(self.near_plane.map(|near| ("near_plane", near as f32)));
        let extensions = &self.extensions;
        if let Some(gaps) = &extensions.gaps {
            values.push(("extensions.gaps.coarsen", gaps.coarsen));
        }
        if let Some(appearance) = &extensions.appearance {
            values.push(("extensions.appearance.change", appearance.change));
        }
        if let Some(exposure) = &extensions.exposure {
            values.push(("extensions.exposure.rate", exposure.rate));
        }
        if let Some(rates) = &extensions.capture_rates {
            values.push(("extensions.capture_rates.monocular", rates.monocular));
            values.push(("extensions.capture_rates.synchronized", rates.synchronized));
        }
        let mut checks = numbers(values, |value| value.is_finite() && value > 0.0);
        if let Some(prune) = &extensions.prune {
            let most = prune.max_loss_db;
            let ok = most.is_finite() && most > 0.0;
            checks.push(("extensions.prune.max_loss_db", most.to_string(), ok));
        }
        checks
    }

    fn counts(&self) -> Vec<Check<'_>> {
        let mut values = vec![
            ("iterations", self.iterations),
            ("batch", self.batch),
            ("checkpoint_interval", self.checkpoint_interval),
            ("validation_interval", self.validation_interval),
            (
                "method.smoothness_interval",
                self.method.smoothness_interval,
            ),
        ];
        values.extend(self.visits.map(|visits| ("visits", visits)));
        let names = [
            [
                "densify.static.interval",
                "densify.static.opacity_reset_interval",
            ],
            [
                "densify.dynamic.interval",
                "densify.dynamic.opacity_reset_interval",
            ],
        ];
        for ([rounds, resets], set) in names.into_iter().zip(self.sets()) {
            values.push((rounds, set.interval));
            values.extend(
                set.opacity_reset_interval
                    .map(|interval| (resets, interval)),
            );
        }
        values.extend(self.densify.pixels.map(|pixels| ("densify.pixels", pixels)));
        if let Some(demotion) = &self.extensions.demotion {
            values.push(("extensions.demotion.interval", demotion.interval));
        }
        if let Some(crowding) = &self.extensions.crowding {
            values.push(("extensions.crowding.free", crowding.free));
        }
        let checks = values.into_iter();
        checks
            .map(|(name, value)| (name, value.to_string(), value > 0))
            .collect()
    }
}

fn numbers(values: Vec<(&str, f32)>, ok: impl Fn(f32) -> bool) -> Vec<Check<'_>> {
    let checks = values.into_iter();
    checks
        .map(|(name, value)| (name, value.to_string(), ok(value)))
        .collect()
}

/// Names the first key that is not in its range.
fn check(range: &str, checks: Vec<Check<'_>>) -> Result<(), Error> {
    match checks.into_iter().find(|(.., ok)| !ok) {
        None => Ok(()),
        Some((key, value, _)) => Err(Error::Config(format!(
            "{key}: expected {range}, found {value}"
        ))),
    }
}
