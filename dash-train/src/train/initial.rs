//! What the first Gaussians are made of.

use dash_model::SpaceBox;
use rand_pcg::Pcg64;

use super::sweep::swept_points;
use crate::cameras::focus_point;
use crate::dataset::{Dataset, View};

/// Views of the first time from which on these alone are looked at.
const MIN_CAMERAS: usize = 4;
/// Most views that points are looked for in.
const MAX_VIEWS: usize = 64;
/// Share of the points on either side that do not count for the scene's size.
const EXTENT_TAIL: f32 = 0.05;

/// Points in world units with colours in [0, 1].
#[derive(Debug, Default)]
pub(crate) struct InitialPoints {
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) colors: Vec<[f32; 3]>,
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
    let mut points = InitialPoints::default();
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
        let swept = swept_points(&views_at_start(dataset, train_views), background, missing, rng);
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

/// Half the diagonal of the box that holds most points, world units: what learning rates and
/// density control measure lengths by.
pub(crate) fn scene_extent(dataset: &Dataset, points: &[[f32; 3]]) -> f32 {
    if points.is_empty() {
        let cameras: Vec<_> = dataset
            .views
            .iter()
            .map(|view| view.camera.clone())
            .collect();
        let (focus, first) = (focus_point(&cameras), cameras[0].position());
        return (0..3)
            .map(|a| (focus[a] - first[a]).powi(2))
            .sum::<f64>()
            .sqrt() as f32;
    }
    0.5 * SpaceBox::around(points, EXTENT_TAIL, 0.0).diagonal()
}
