//! The initial points: how many, whether they were measured or drawn at random, and how many of them lie in the
//! pictures and in the training box.

use std::collections::HashSet;
use std::num::NonZero;

use dash_kernels::Camera;
use dash_model::SpaceBox;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rand::SeedableRng;
use rand_pcg::Pcg64;

use super::finding::{Finding, percent};
use crate::Error;
use crate::dataset::{Dataset, Layout, known_point_file};
use crate::ply::{PointCloud, read_points_counting};
use crate::train::core::capture::start_span;
use crate::train::core::hold_out::hold_out;
use crate::train::core::initial::{Region, views_at_start};
use crate::train::core::initial_views::{InitialViews, difference};
use crate::train::core::points::InitialPoints;
use crate::train::core::shortage::nothing_to_start_from;

/// Points in a sample: enough for a camera that sees a hundredth of a large scene.
const SAMPLES: usize = 50_000;
/// Points whose neighbours are compared.
const NEIGHBOUR_SAMPLES: usize = 3_000;
/// Mean difference between colours below which they are all alike.
const MIN_CONTRAST: f32 = 0.02;
/// Colours belong to no surface when neighbours differ by this share of the difference between random points.
const MAX_INCOHERENCE: f32 = 0.9;
/// Greatest distance between the distribution of coordinates and an even one, on every axis, of points
/// drawn evenly in a box. Those of a surface are farther off on one of them.
const EVEN: f64 = 0.02;
/// Fewer points than this say nothing about their distribution.
const MIN_FOR_KIND: usize = 200;
/// Fewer points than this leave most of the scene to the search along rays.
const FEW: usize = 500;
/// Share of duplicates that is worth a warning.
const MANY_DUPLICATES: f64 = 0.1;
/// Share of points inside two pictures below which the cloud and the cameras hardly meet.
const FEW_INSIDE: f64 = 0.25;
/// Share of points outside the box that is worth a warning.
const MANY_OUTSIDE: f64 = 0.1;
/// Points that are looked for where the dataset has none, to find the box.
const SOUGHT: usize = 1_000;

/// Where points come from, as far as it shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Colours belong to places.
    Measured,
    /// Colours all alike.
    OneColor,
    /// Colours or positions drawn at random.
    Random,
}

/// The cloud's points that checks look at.
pub(super) struct Cloud {
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) colors: Vec<[f32; 3]>,
    pub(super) kind: Kind,
}

impl Cloud {
    pub(super) fn of(points: &PointCloud) -> Self {
        let stride = points.len().div_ceil(SAMPLES).max(1);
        let rows = || (0..points.len()).step_by(stride);
        Self {
            positions: rows()
                .map(|row| points.positions[row].map(f64::from))
                .collect(),
            colors: rows().map(|row| color(points.colors[row])).collect(),
            kind: kind(points),
        }
    }
}

fn color(rgb: [u8; 3]) -> [f32; 3] {
    rgb.map(|c| f32::from(c) / 255.0)
}

fn kind(points: &PointCloud) -> Kind {
    let n = points.len();
    if n < MIN_FOR_KIND {
        return Kind::Measured;
    }
    let tree: ImmutableKdTree<f32, 3> = ImmutableKdTree::new_from_slice(&points.positions);
    let two = NonZero::<usize>::MIN.saturating_add(1);
    let (mut near, mut far) = (0.0, 0.0);
    let mut count = 0.0;
    for row in (0..n).step_by(n.div_ceil(NEIGHBOUR_SAMPLES)) {
        let found = tree.nearest_n::<SquaredEuclidean>(&points.positions[row], two);
        let neighbour = found
            .iter()
            .map(|f| f.item as usize)
            .find(|&item| item != row);
        let own = color(points.colors[row]);
        let stranger = color(points.colors[(row + n / 2) % n]);
        near += neighbour.map_or(0.0, |item| difference(own, color(points.colors[item])));
        far += difference(own, stranger);
        count += 1.0;
    }
    let alike = far < MIN_CONTRAST * count;
    if !alike && near > MAX_INCOHERENCE * far || fills_a_box(points) {
        Kind::Random
    } else if alike {
        Kind::OneColor
    } else {
        Kind::Measured
    }
}

/// Whether the points are evenly spread on every axis.
fn fills_a_box(points: &PointCloud) -> bool {
    (0..3).all(|axis| {
        let mut values: Vec<f64> = points
            .positions
            .iter()
            .map(|p| f64::from(p[axis]))
            .collect();
        values.sort_by(f64::total_cmp);
        let (n, low, high) = (values.len(), values[0], values[values.len() - 1]);
        let width = (high - low).max(f64::MIN_POSITIVE);
        let off = |(i, v): (usize, &f64)| ((v - low) / width - i as f64 / n as f64).abs();
        values.iter().enumerate().map(off).fold(0.0, f64::max) < EVEN
    })
}

/// Number, kind, duplicates and points that are not finite.
pub(super) fn numbers(dataset: &Dataset, cloud: Option<&Cloud>) -> Vec<Finding> {
    let (Some(points), Some(cloud)) = (&dataset.points, cloud) else {
        let text = "no point cloud: training looks for points along the rays of pixels, by colours that \
                    several views agree on";
        return vec![Finding::note("points", text)];
    };
    let mut findings = Vec::new();
    let n = points.len();
    findings.push(match cloud.kind {
        Kind::Random => Finding::note(
            "points",
            format!(
                "{n} points that were drawn at random (neighbours have nothing in common): they say nothing \
                 about the scene"
            ),
        ),
        Kind::OneColor => Finding::note("points", format!("{n} points, all of one colour")),
        Kind::Measured if n < FEW => Finding::note(
            "points",
            format!("{n} points, few: training looks for more along the rays of pixels"),
        ),
        Kind::Measured => Finding::ok("points", format!("{n} points with colours")),
    });
    let distinct: HashSet<[u32; 3]> = points
        .positions
        .iter()
        .map(|p| p.map(|v| (v + 0.0).to_bits()))
        .collect();
    let duplicates = n - distinct.len();
    if duplicates as f64 > MANY_DUPLICATES * n as f64 {
        let text = format!(
            "{} of the points are where another one is ({duplicates})",
            percent(duplicates, n)
        );
        let mend =
            "remove the duplicates: they become Gaussians that split the same light among them";
        findings.push(Finding::warning("points", text, mend));
    } else if duplicates > 0 {
        findings.push(Finding::note("points", format!("{duplicates} duplicates")));
    }
    let dropped = known_point_file(&dataset.root)
        .and_then(|file| read_points_counting(&file).ok())
        .map_or(0, |read| read.1);
    if dropped > 0 {
        let text =
            format!("{dropped} points have coordinates that are not finite, and are left out");
        findings.push(Finding::warning(
            "points",
            text,
            "write the point cloud again without them",
        ));
    }
    findings
}

/// How many points at least two cameras have in their pictures.
pub(super) fn inside(cloud: &Cloud, cameras: &[Camera]) -> Option<Finding> {
    if cloud.kind == Kind::Random || cloud.positions.is_empty() {
        return None;
    }
    let needed = cameras.len().min(2);
    let seen = |point: &&[f64; 3]| {
        let mut seeing = cameras
            .iter()
            .filter(|c| c.project_inside(**point).is_some());
        seeing.by_ref().take(needed).count() == needed
    };
    let n = cloud.positions.len();
    let count = cloud.positions.iter().filter(seen).count();
    let text = format!(
        "{} of the points are inside the pictures of two cameras",
        percent(count, n)
    );
    if (count as f64) < FEW_INSIDE * n as f64 {
        let mend = "bring points and poses into one coordinate system (see `colours` and `poses`), or make \
                    the points again from these cameras";
        return Some(Finding::warning("points", text, mend));
    }
    Some(Finding::ok("points", text))
}

/// The box that training would give to the 4D field, and whether it would use the points for it: if the
/// pictures show their colours. Otherwise it is the box of what several views agree on.
pub(super) fn training_box(dataset: &Dataset) -> Result<(SpaceBox, bool), Error> {
    let (train_views, _) = hold_out(dataset);
    let views = views_at_start(dataset, &train_views, start_span(dataset, &train_views));
    let seen = InitialViews::new(&views, dataset.background.unwrap_or([0.0; 3]))?;
    let mut points = InitialPoints::default();
    if let Some(cloud) = &dataset.points {
        points.positions = cloud.positions.clone();
        points.colors = cloud.colors.iter().map(|&c| color(c)).collect();
        points.given = points.positions.len();
    }
    let used = points.given > 0 && seen.shows(&points, dataset.layout == Layout::Colmap);
    if !used {
        points = seen.points(SOUGHT, &mut Pcg64::seed_from_u64(0));
    }
    if points.positions.is_empty() {
        return Err(nothing_to_start_from(dataset));
    }
    Ok((Region::of(dataset, &points).space, used))
}

/// How many points are outside the training box; `used`: whether training starts from them.
pub(super) fn outside(cloud: &Cloud, space: &SpaceBox, used: bool) -> Option<Finding> {
    let side = |axis: usize| space.max[axis] - space.min[axis];
    let size = format!("{:.3} x {:.3} x {:.3}", side(0), side(1), side(2));
    if !used {
        let text = format!(
            "training does not start from the points, since pictures do not show their colours; what views \
             agree on is in a box of {size}"
        );
        return Some(Finding::note("box", text));
    }
    let out = |p: &&[f64; 3]| {
        (0..3).any(|axis| {
            p[axis] < f64::from(space.min[axis]) || p[axis] > f64::from(space.max[axis])
        })
    };
    let n = cloud.positions.len();
    let count = cloud.positions.iter().filter(out).count();
    let text = format!(
        "{} of the points are outside the box of the 4D field ({size})",
        percent(count, n)
    );
    if count as f64 > MANY_OUTSIDE * n as f64 {
        let mend =
            "remove points that are far from the scene: what moves outside the box is not followed";
        return Some(Finding::warning("box", text, mend));
    }
    Some(Finding::ok("box", text))
}
