//! What a capture lacks for its shape to be found, told before training and by the doctor.

use std::collections::BTreeMap;

use dash_kernels::Camera;
use glam::DVec3;

use crate::Error;
use crate::cameras::{in_one_place, one_place};
use crate::dataset::{Dataset, Partition, View};

/// Directions this close are the same: a hundredth of a degree.
const SAME_DIRECTION: f64 = 1.5e-8;
/// Parts of matrices that differ by less are equal.
const SAME_ROTATION: f64 = 1e-6;

/// Something that a capture lacks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Shortage {
    /// What it concerns: `poses`, `points` or `views`.
    pub(crate) concerns: &'static str,
    /// What was found.
    pub(crate) text: String,
    /// What to do about it.
    pub(crate) mend: &'static str,
    /// Whether training can't begin.
    pub(crate) is_fatal: bool,
}

/// What the dataset lacks.
pub(crate) fn shortages(dataset: &Dataset) -> Vec<Shortage> {
    let train: Vec<&View> = dataset.views_of(Partition::Train).collect();
    let checks = [
        places(dataset, &train),
        points_in_sight(dataset, &train),
        held_out_and_trained(dataset, &train),
    ];
    checks.into_iter().flatten().collect()
}

/// Warns of what the dataset lacks.
///
/// # Errors
/// [`Error::TooLittle`] where training can't begin.
pub(crate) fn check(dataset: &Dataset) -> Result<(), Error> {
    for shortage in shortages(dataset) {
        if shortage.is_fatal {
            return Err(Error::TooLittle {
                dataset: dataset.root.clone(),
                found: shortage.text,
                remedy: shortage.mend,
            });
        }
        tracing::warn!("{}; {}", shortage.text, shortage.mend);
    }
    Ok(())
}

/// Of a run that would begin without any Gaussians.
pub(crate) fn nothing_to_start_from(dataset: &Dataset) -> Error {
    let n_views = dataset.views_of(Partition::Train).count();
    let n_points = dataset.points.as_ref().map_or(0, |cloud| cloud.len());
    Error::TooLittle {
        dataset: dataset.root.clone(),
        found: format!(
            "{n_points} points, and no point that the {n_views} training views agree on: no Gaussian to start from"
        ),
        remedy: "check that the poses belong to the pictures and that neighbouring views see the same, or add points",
    }
}

/// Of training views from one place, or from two.
fn places(dataset: &Dataset, train: &[&View]) -> Option<Shortage> {
    let has_points = dataset
        .points
        .as_ref()
        .is_some_and(|cloud| !cloud.is_empty());
    let positions: Vec<DVec3> = train.iter().map(|v| v.camera.position().into()).collect();
    let held_out = match dataset.views.len() - train.len() {
        0 => String::new(),
        n => format!(" ({n} held out)"),
    };
    let shortage = |text: String, mend| Shortage {
        concerns: "poses",
        text,
        mend,
        is_fatal: false,
    };
    if train.len() == 1 {
        return Some(match has_points {
            true => shortage(
                format!("one view to train on{held_out}: only the points tell how far anything is"),
                "add pictures from other places, or hold fewer out (--test-cameras)",
            ),
            false => Shortage {
                is_fatal: true,
                ..shortage(
                    format!(
                        "one view to train on{held_out} and no points: nothing tells how far anything is"
                    ),
                    "add pictures from other places or a point cloud, or hold fewer views out (--test-cameras none)",
                )
            },
        });
    }
    if in_one_place(&positions) {
        let first = DVec3::from(train[0].camera.forward());
        let turns = train
            .iter()
            .any(|v| 1.0 - first.dot(v.camera.forward().into()) > SAME_DIRECTION);
        let camera = if turns {
            "a camera that only turns"
        } else {
            "a fixed camera"
        };
        let scale = if has_points {
            "only the points tell how far anything is"
        } else {
            "nothing tells how far anything is, and the scene is put at distance 1"
        };
        return Some(shortage(
            format!(
                "no parallax: all {} training views{held_out} are taken from one place ({camera}); {scale}",
                train.len()
            ),
            "views from there can be rendered, others not: move the camera, or add cameras in other places",
        ));
    }
    (n_places(&positions) == 2).then(|| {
        shortage(
            format!(
                "the {} training views{held_out} are taken from two places only: what one of them does not see, and \
                 edges along the line between them, have no certain depth",
                train.len()
            ),
            "add cameras in other places, or hold fewer out (--test-cameras)",
        )
    })
}

/// Number of places, at most 3.
fn n_places(positions: &[DVec3]) -> usize {
    let within = one_place(positions);
    let mut places: Vec<DVec3> = Vec::new();
    for &position in positions {
        if places.iter().all(|place| place.distance(position) > within) {
            places.push(position);
        }
        if places.len() > 2 {
            break;
        }
    }
    places.len()
}

/// Where no training picture shows any of the points.
fn points_in_sight(dataset: &Dataset, train: &[&View]) -> Option<Shortage> {
    let cloud = dataset.points.as_ref().filter(|cloud| !cloud.is_empty())?;
    let mut cameras: BTreeMap<usize, &Camera> = BTreeMap::new();
    for view in train {
        cameras.entry(view.camera_index).or_insert(&view.camera);
    }
    let all = || cloud.positions.iter().map(|point| point.map(f64::from));
    let in_sight = |point| cameras.values().any(|c| c.project_inside(point).is_some());
    if cameras.is_empty() || all().any(in_sight) {
        return None;
    }
    let behind = |point: [f64; 3]| {
        let point = DVec3::from(point);
        let depth = |c: &&Camera| DVec3::from(c.forward()).dot(point - DVec3::from(c.position()));
        cameras.values().all(|camera| depth(camera) <= 0.0)
    };
    let n_behind = all().filter(|&point| behind(point)).count();
    Some(Shortage {
        concerns: "points",
        text: format!(
            "none of the {} points is in a training picture, {n_behind} are behind all cameras",
            cloud.len()
        ),
        mend: "bring points and poses into one coordinate system; poses of another convention (y and z axes negated) \
               turn cameras around",
        is_fatal: false,
    })
}

/// Of held-out views that are trained on, too.
fn held_out_and_trained(dataset: &Dataset, train: &[&View]) -> Option<Shortage> {
    let tests: Vec<&View> = dataset.views_of(Partition::Test).collect();
    let positions: Vec<DVec3> = train.iter().map(|v| v.camera.position().into()).collect();
    let within = one_place(&positions);
    let mut at_time: BTreeMap<u32, Vec<&View>> = BTreeMap::new();
    for view in train {
        at_time.entry(view.time.to_bits()).or_default().push(view);
    }
    let is_trained = |test: &&&View| {
        let others = at_time.get(&test.time.to_bits());
        others.is_some_and(|others| others.iter().any(|other| same_view(other, test, within)))
    };
    let n = tests.iter().filter(is_trained).count();
    (n > 0).then(|| Shortage {
        concerns: "views",
        text: format!(
            "{n} of the {} held-out views are training views, too (same pose, same time): their scores tell nothing \
             of other views",
            tests.len()
        ),
        mend: "hold other views out (--test-cameras), or remove them from the training views",
        is_fatal: false,
    })
}

fn same_view(a: &View, b: &View, within: f64) -> bool {
    let (one, other) = (&a.camera, &b.camera);
    let rotations = one
        .rotation
        .as_flattened()
        .iter()
        .zip(other.rotation.as_flattened());
    DVec3::from(one.position()).distance(other.position().into()) <= within
        && rotations
            .into_iter()
            .all(|(a, b)| (a - b).abs() <= SAME_ROTATION)
}

#[cfg(test)]
mod tests;
