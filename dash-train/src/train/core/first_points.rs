//! What runs on one dataset start from.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use rand::SeedableRng;
use rand_pcg::Pcg64;

use super::capture::{self, TimeSpan};
use super::config::ScheduleConfig;
use super::hold_out;
use super::initial::initial_points;
use super::points::InitialPoints;
use super::shortage;
use crate::Error;
use crate::dataset::Dataset;

/// The first points of runs, which may take as long to find as hundreds of steps. They are found once for each dataset and seed;
/// clones share them.
#[derive(Clone, Default)]
pub struct FirstPoints(Arc<Mutex<Vec<Found>>>);

struct Found {
    dataset: Weak<Dataset>,
    seed: u64,
    limits: [usize; 2],
    start: Arc<Start>,
}

impl FirstPoints {
    /// What a run starts from.
    pub(crate) fn find(
        &self,
        config: &ScheduleConfig,
        dataset: &Arc<Dataset>,
    ) -> Result<Arc<Start>, Error> {
        let (seed, limits) = (config.seed, config.initial_points);
        let own = Arc::downgrade(dataset);
        let is_same = |found: &&Found| {
            found.dataset.ptr_eq(&own) && (found.seed, found.limits) == (seed, limits)
        };
        if let Some(found) = self.found().iter().find(is_same) {
            return Ok(found.start.clone());
        }
        // Not under the lock: Rayon threads that this needs may be waiting for it.
        let start = Arc::new(Start::of(config, dataset)?);
        self.keep(config, dataset, start.clone());
        Ok(start)
    }

    /// Points that were found before, and the generator after them.
    pub(super) fn give(
        &self,
        config: &ScheduleConfig,
        dataset: &Arc<Dataset>,
        points: InitialPoints,
        rng: Pcg64,
    ) -> Result<(), Error> {
        let start = Start {
            points,
            rng,
            ..Start::without_points(config, dataset)?
        };
        self.keep(config, dataset, Arc::new(start));
        Ok(())
    }

    fn keep(&self, config: &ScheduleConfig, dataset: &Arc<Dataset>, start: Arc<Start>) {
        self.found().push(Found {
            dataset: Arc::downgrade(dataset),
            seed: config.seed,
            limits: config.initial_points,
            start,
        });
    }

    fn found(&self) -> MutexGuard<'_, Vec<Found>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What a run knows before its first step.
pub(crate) struct Start {
    /// Indices of the views that are trained on.
    pub(crate) train_views: Vec<usize>,
    /// Indices of views that are neither trained on nor tested.
    pub(crate) validation_views: Vec<usize>,
    /// The part of the clip that training starts from.
    pub(crate) span: Option<TimeSpan>,
    /// At least one.
    pub(crate) points: InitialPoints,
    /// The source of everything random, after the points.
    pub(crate) rng: Pcg64,
}

impl Start {
    /// What takes no time to find.
    fn without_points(config: &ScheduleConfig, dataset: &Dataset) -> Result<Self, Error> {
        let (train_views, validation_views) = hold_out::hold_out(dataset);
        if train_views.is_empty() {
            return Err(Error::NoTrainingViews {
                dataset: dataset.root.clone(),
            });
        }
        Ok(Self {
            span: capture::start_span(dataset, &train_views),
            train_views,
            validation_views,
            points: InitialPoints::default(),
            rng: Pcg64::seed_from_u64(config.seed),
        })
    }

    fn of(config: &ScheduleConfig, dataset: &Dataset) -> Result<Self, Error> {
        let mut start = Self::without_points(config, dataset)?;
        start.points = initial_points(
            dataset,
            &start.train_views,
            start.span,
            dataset.background.unwrap_or_default(),
            config.initial_points,
            &mut start.rng,
        )?;
        if start.points.positions.is_empty() {
            return Err(shortage::nothing_to_start_from(dataset));
        }
        Ok(start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth;
    use crate::train::config::tests::small;

    #[test]
    fn points_are_found_once_for_each_dataset_and_seed() {
        let datasets = [(); 2].map(|()| Arc::new(synth::loaded(4, 2, [24, 18])));
        let config = small(&[]).for_capture(&datasets[0]);
        let (first_points, mut starts) = (FirstPoints::default(), Vec::new());
        for dataset in &datasets {
            for seed in [0, 1] {
                let schedule = ScheduleConfig {
                    seed,
                    ..config.schedule()
                };
                let [once, again] = [(); 2].map(|()| {
                    let start = first_points.clone().find(&schedule, dataset);
                    start.expect("enough views")
                });
                assert!(Arc::ptr_eq(&once, &again));
                let alone = Start::of(&schedule, dataset).expect("enough views");
                assert!(once.points.positions == alone.points.positions);
                assert!(once.rng == alone.rng);
                starts.push(once);
            }
        }
        let rngs: Vec<_> = starts.iter().map(|start| &start.rng).collect();
        assert!(rngs[0] != rngs[1] && rngs[0] == rngs[2]);
        assert_eq!(first_points.found().len(), 4);
    }

    #[test]
    fn points_that_were_found_before_are_not_found_anew() {
        let dataset = Arc::new(synth::loaded(4, 2, [24, 18]));
        let schedule = small(&[]).for_capture(&dataset).schedule();
        let first_points = FirstPoints::default();
        let points = InitialPoints {
            positions: vec![[1.0, 2.0, 3.0]],
            colors: vec![[0.5; 3]],
            given: 1,
        };
        let rng = Pcg64::seed_from_u64(7);
        let given = first_points.give(&schedule, &dataset, points, rng.clone());
        given.expect("enough views");
        let start = first_points.find(&schedule, &dataset).expect("known");
        assert_eq!(start.points.positions, [[1.0, 2.0, 3.0]]);
        assert!(start.rng == rng && start.points.given == 1);
        assert_eq!(start.train_views.len(), 6);
    }
}
