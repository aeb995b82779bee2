//! What the first Gaussians are made of.

use std::collections::BTreeMap;

use dash_kernels::splats::NEAR_PLANE;
use dash_model::{Camera, SpaceBox};
use rand_pcg::Pcg64;

use super::capture::TimeSpan;
use super::initial_views::InitialViews;
use super::points::InitialPoints;
use crate::Error;
use crate::cameras::focus_point;
use crate::dataset::{Dataset, Layout, View};

/// Most views that points are looked for in.
const MAX_VIEWS: usize = 64;
/// Share of the points on either side that do not count for the scene's size.
pub(crate) const EXTENT_TAIL: f32 = 0.05;
/// Points that are looked for where pictures change, as a share of how many there should be in all.
pub(crate) const CHANGING_SHARE: f32 = 0.25;
/// Share of the points in a picture that may be nearer than what counts as its nearest.
const NEAR_TAIL: f64 = 0.01;
/// Share of the distance of the nearest at which Gaussians begin to be drawn.
pub(crate) const NEAR_SHARE: f64 = 0.5;
/// Share of the points on either side that a field's box may leave out.
pub(crate) const BOX_TAIL: f32 = 0.01;
/// How much wider than its points a field's box is.
pub(crate) const BOX_MARGIN: f32 = 0.15;

/// The dataset's points, at most `limits[1]`, unless they are random; and where they are fewer than
/// `limits[0]`, points that views agree on: those of the part of the clip that training starts from, if it has
/// one. Then also some where these views differ from other times.
pub(crate) fn initial_points(
    dataset: &Dataset,
    train_views: &[usize],
    start_span: Option<TimeSpan>,
    background: [f32; 3],
    limits: [usize; 2],
    rng: &mut Pcg64,
) -> Result<InitialPoints, Error> {
    let cloud = dataset.points.as_ref();
    let n = cloud.map_or(0, |cloud| cloud.positions.len());
    let kept = n.min(limits[1]);
    let mut points = InitialPoints {
        given: kept,
        ..Default::default()
    };
    if let Some(cloud) = cloud {
        for row in (0..kept).map(|k| k * n / kept) {
            points.positions.push(cloud.positions[row]);
            points
                .colors
                .push(cloud.colors[row].map(|c| f32::from(c) / 255.0));
        }
    }
    let views = views_at_start(dataset, train_views, start_span);
    let seen = InitialViews::new(&views, background)?;
    if kept > 0 && !seen.shows(&points, dataset.layout == Layout::Colmap) {
        let why = match seen.has_in_sight(&points) {
            true => "have other colours than the pictures where they are, as if drawn at random",
            false => "are in no picture that training starts from",
        };
        let root = dataset.root.display();
        tracing::warn!("the {n} points of {root} {why}: they are not used");
        points = InitialPoints::default();
    }
    let missing = limits[0].min(limits[1]).saturating_sub(points.given);
    // A depth that is made up does not go with points.
    let finds_depth = points.given == 0 || !seen.in_one_place();
    if missing > 0 && finds_depth {
        let found = seen.points(missing, rng);
        points.positions.extend(found.positions);
        points.colors.extend(found.colors);
    }
    if start_span.is_some() {
        let others = at_other_times(dataset, train_views, &views);
        let most = (CHANGING_SHARE * limits[0].min(limits[1]) as f32) as usize;
        let found = seen.changing_points(most, &others, background, rng)?;
        points.positions.extend(found.positions);
        points.colors.extend(found.colors);
    }
    Ok(points)
}

/// Of the camera of each of some views, the first and the last training view, where it stands in the same
/// place; beside the index among the views.
fn at_other_times<'a>(
    dataset: &'a Dataset,
    train_views: &[usize],
    views: &[&View],
) -> Vec<(usize, &'a View)> {
    let all = || train_views.iter().map(|&i| &dataset.views[i]);
    let mut others = Vec::new();
    for (index, view) in views.iter().enumerate() {
        let same = || all().filter(|other| other.camera == view.camera && other.time != view.time);
        let first = same().min_by(|a, b| a.time.total_cmp(&b.time));
        let last = same().max_by(|a, b| a.time.total_cmp(&b.time));
        others.extend(first.into_iter().chain(last).map(|other| (index, other)));
    }
    others
}

/// The views of the part of the clip that training starts from, where it has one; else some of all times.
pub(crate) fn views_at_start<'a>(
    dataset: &'a Dataset,
    train_views: &[usize],
    start_span: Option<TimeSpan>,
) -> Vec<&'a View> {
    let views = || train_views.iter().map(|&i| &dataset.views[i]);
    if let Some(span) = start_span {
        return views().filter(|view| span.holds(view.time)).collect();
    }
    let stride = train_views.len().div_ceil(MAX_VIEWS).max(1);
    views().step_by(stride).collect()
}

/// How near a Gaussian may come to a camera and be drawn, world units: well before the first that any
/// training camera sees. Where cameras see each other, their stands and lamps become part of the
/// scene, and would block the view of a camera that takes their place.
pub(crate) fn near_plane<'a>(views: impl Iterator<Item = &'a View>, points: &InitialPoints) -> f64 {
    let shown = &points.positions[..match points.given {
        0 => points.positions.len(),
        given => given,
    }];
    let nearest = |camera: &Camera| {
        let mut depths: Vec<f64> = shown
            .iter()
            .filter_map(|point| Some(camera.project_inside(point.map(f64::from))?.1))
            .collect();
        depths.sort_by(f64::total_cmp);
        depths
            .get((NEAR_TAIL * depths.len() as f64) as usize)
            .copied()
    };
    let cameras: BTreeMap<usize, &Camera> = views
        .map(|view| (view.camera_index, &view.camera))
        .collect();
    cameras
        .values()
        .filter_map(|camera| nearest(camera))
        .reduce(f64::min)
        .map_or(NEAR_PLANE, |depth| NEAR_SHARE * depth)
}

/// The part of space that a capture is about; backgrounds far behind do not count.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Region {
    /// The box that the coarse field covers.
    pub(crate) space: SpaceBox,
    /// Diagonal of the box that holds most points, world units: what learning rates and
    /// density control measure lengths by.
    pub(crate) extent: f32,
}

impl Region {
    /// Around the points that the dataset brought, or without these around what was found near where
    /// the cameras look.
    pub(crate) fn of(dataset: &Dataset, points: &InitialPoints) -> Self {
        let near;
        let core = if points.given > 0 {
            &points.positions[..points.given]
        } else {
            near = near_focus(dataset, &points.positions);
            &near
        };
        Self {
            space: SpaceBox::around(core, BOX_TAIL, BOX_MARGIN),
            extent: SpaceBox::around(core, EXTENT_TAIL, 0.0).diagonal(),
        }
    }
}

/// The points that are nearer to where the cameras look than the cameras are; without any, corners
/// of a box there.
fn near_focus(dataset: &Dataset, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let cameras: Vec<_> = dataset
        .views
        .iter()
        .map(|view| view.camera.clone())
        .collect();
    let focus = glam::DVec3::from(focus_point(&cameras));
    let distances = cameras
        .iter()
        .map(|camera| focus.distance(camera.position().into()));
    let reach = distances.sum::<f64>() / cameras.len().max(1) as f64;
    let near: Vec<[f32; 3]> = points
        .iter()
        .copied()
        .filter(|&p| glam::Vec3::from(p).as_dvec3().distance(focus) <= reach)
        .collect();
    if !near.is_empty() {
        return near;
    }
    // Cameras in one place don't say how large the scene is.
    let reach = if reach > 0.0 { reach } else { 1e-3 };
    [-0.5, 0.5]
        .map(|side: f64| (focus + side * reach).as_vec3().to_array())
        .to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(index: usize, eye: [f64; 3]) -> View {
        let camera =
            Camera::new(16.0, 16.0, 8.0, 8.0, 16, 16).look_at(eye, [0.0; 3], [0.0, 1.0, 0.0]);
        View {
            camera_index: index,
            ..View::from_rgb8("made", camera, 0.0, vec![0; 16 * 16 * 3])
        }
    }

    #[test]
    fn the_near_plane_is_halfway_to_what_the_nearest_camera_sees() {
        // A ball of radius 1 seen from 5 and 4 away, and a few points beside the nearer camera.
        let mut points = InitialPoints::default();
        for i in 0..400 {
            let angle = i as f32;
            points.positions.push([angle.cos(), 0.0, angle.sin()]);
        }
        points.positions.push([0.0, 0.0, -3.9]);
        points.positions.push([0.0, 9.0, -4.0]);
        let views = [view(0, [0.0, 0.0, -5.0]), view(1, [0.0, 0.0, -4.0])];
        let near = near_plane(views.iter(), &points);
        assert!((near - 1.5).abs() < 0.01, "{near}");
        assert_eq!(
            near_plane(views.iter(), &InitialPoints::default()),
            NEAR_PLANE
        );
    }
}
