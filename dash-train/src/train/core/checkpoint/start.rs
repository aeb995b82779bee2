//! What a run began with. A resumed run takes it from its checkpoint: to find first points takes as long as hundreds of steps.

use std::path::Path;
use std::sync::Arc;

use dash_model::scene_file::read_tensors;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::{State, damaged};
use crate::Error;
use crate::dataset::Dataset;
use crate::train::core::config::ScheduleConfig;
use crate::train::core::first_points::{FirstPoints, Start};
use crate::train::core::points::InitialPoints;
use crate::train::core::saved::Saved;

/// The file of the points.
pub(super) const POINTS: &str = "points";

/// What of it is not a tensor.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SavedStart {
    given: usize,
    rng: Pcg64,
}

/// For a checkpoint.
pub(super) fn save(start: &Start) -> (SavedStart, Saved) {
    let points = &start.points;
    let mut saved = Saved::default();
    saved.insert("positions", points.positions.concat());
    saved.insert("colors", points.colors.concat());
    let values = SavedStart {
        given: points.given,
        rng: start.rng.clone(),
    };
    (values, saved)
}

impl<C> State<C> {
    /// Lets a run that is made to be put where this one was find the points that this one began with.
    ///
    /// # Errors
    /// When they can't be read or are damaged.
    pub(crate) fn give_points(
        &self,
        checkpoint: &Path,
        config: &ScheduleConfig,
        dataset: &Arc<Dataset>,
        first_points: &FirstPoints,
    ) -> Result<(), Error> {
        let path = checkpoint.join(format!("{POINTS}.safetensors"));
        let mut saved = Saved {
            tensors: read_tensors(&path)?,
            ..Saved::default()
        };
        let mut take = |name: &str| -> Result<Vec<[f32; 3]>, String> {
            let values = saved.take(name)?;
            let (points, rest) = values.as_chunks();
            match rest {
                [] => Ok(points.to_vec()),
                _ => Err(format!("{} numbers of `{name}`, not 3 each", values.len())),
            }
        };
        let given = self.start.given;
        let points = take("positions").and_then(|positions| {
            let (n, colors) = (positions.len(), take("colors")?);
            if n == 0 || colors.len() != n || given > n {
                let found = format!(
                    "{n} points, {} colours, {given} of the dataset",
                    colors.len()
                );
                return Err(found);
            }
            Ok(InitialPoints {
                positions,
                colors,
                given,
            })
        });
        let points = points.map_err(|found| damaged(&path, found))?;
        first_points.give(config, dataset, points, self.start.rng.clone())
    }
}
