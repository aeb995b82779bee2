//! What the first Gaussians are made of.

use dash_model::SpaceBox;
use rand_pcg::Pcg64;

use super::sweep::Sweep;
use crate::cameras::focus_point;
use crate::dataset::{Dataset, View};

/// Views of the first time from which on these alone are looked at.
const MIN_CAMERAS: usize = 4;
/// Most views that points are looked for in.
const MAX_VIEWS: usize = 64;
/// Share of the points on either side that do not count for the scene's size.
const EXTENT_TAIL: f32 = 0.05;
/// Share of the points on either side that the scene's box may leave out.
const BOX_TAIL: f32 = 0.01;
/// How much wider the box is than its points.
const BOX_MARGIN: f32 = 0.15;

/// Points in world units with colours in [0, 1].
#[derive(Debug, Default)]
pub(crate) struct InitialPoints {
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) colors: Vec<[f32; 3]>,
    /// Those of them, the first, that the dataset brought.
    pub(crate) given: usize,
}

/// The dataset's points, at most `limits[1]`, and where they are fewer than `limits[0]`, points that
/// views agree on.
pub(crate) fn initial_points(
    dataset: &Dataset,
    train_views: &[usize],
    background: [f32; 3],
    limits: [usize; 2],
    rng: &mut Pcg64,
) -> InitialPoints {
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
    let missing = limits[0].min(limits[1]).saturating_sub(kept);
    if missing > 0 {
        let views = views_at_start(dataset, train_views);
        let swept = Sweep::new(&views, background).points(missing, rng);
        points.positions.extend(swept.positions);
        points.colors.extend(swept.colors);
    }
    points
}

/// The views of the first time, where there are several; else some of all times.
fn views_at_start<'a>(dataset: &'a Dataset, train_views: &[usize]) -> Vec<&'a View> {
    let views = || train_views.iter().map(|&i| &dataset.views[i]);
    let first = views().map(|view| view.time).fold(1.0, f32::min);
    let at_first: Vec<&View> = views().filter(|view| view.time == first).collect();
    if at_first.len() >= MIN_CAMERAS {
        return at_first;
    }
    let stride = train_views.len().div_ceil(MAX_VIEWS).max(1);
    views().step_by(stride).collect()
}

/// The part of space that a capture is about; backgrounds far behind do not count.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Core {
    /// The box that the coarse field covers.
    pub(crate) space: SpaceBox,
    /// Diagonal of the box that holds most points, world units: what learning rates and
    /// density control measure lengths by.
    pub(crate) extent: f32,
}

impl Core {
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
    [-0.5, 0.5]
        .map(|side: f64| (focus + side * reach.max(1e-3)).as_vec3().to_array())
        .to_vec()
}
