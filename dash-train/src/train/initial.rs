//! What the first Gaussians are made of.

use dash_kernels::Camera;
use dash_model::SpaceBox;
use rand::Rng;
use rand_pcg::Pcg64;

use crate::dataset::{Dataset, View};

/// Points drawn where the dataset brings none.
const RANDOM_POINTS: usize = 20_000;
/// Depths between which they are drawn, in units of the distance to where the cameras look.
const RANDOM_DEPTHS: [f64; 2] = [0.4, 3.0];
/// Share of the points on either side that do not count for the scene's size.
const EXTENT_TAIL: f32 = 0.05;

/// Points in world units with colours in [0, 1].
pub(crate) struct InitialPoints {
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) colors: Vec<[f32; 3]>,
}

/// The dataset's points, at most `limit`; without any, points drawn along the rays of training
/// pixels, evenly in inverse depth, that some other view has in sight too.
pub(crate) fn initial_points(
    dataset: &Dataset,
    train_views: &[usize],
    background: [f32; 3],
    limit: usize,
    rng: &mut Pcg64,
) -> InitialPoints {
    let Some(cloud) = dataset
        .points
        .as_ref()
        .filter(|cloud| !cloud.positions.is_empty())
    else {
        let views: Vec<&View> = train_views.iter().map(|&i| &dataset.views[i]).collect();
        return random_points(&views, background, RANDOM_POINTS.min(limit), rng);
    };
    let n = cloud.positions.len();
    let kept = n.min(limit);
    let rows = (0..kept).map(|k| k * n / kept);
    let (positions, colors) = rows
        .map(|row| {
            (
                cloud.positions[row],
                cloud.colors[row].map(|c| f32::from(c) / 255.0),
            )
        })
        .unzip();
    InitialPoints { positions, colors }
}

fn random_points(
    views: &[&View],
    background: [f32; 3],
    n: usize,
    rng: &mut Pcg64,
) -> InitialPoints {
    let cameras: Vec<_> = views.iter().map(|view| view.camera.clone()).collect();
    let focus = focus_point(&cameras);
    let images: Vec<Vec<f32>> = {
        let stride = views.len().div_ceil(64).max(1);
        views
            .iter()
            .step_by(stride)
            .map(|view| view.rgb(background))
            .collect()
    };
    let stride = views.len().div_ceil(64).max(1);
    let mut points = InitialPoints {
        positions: Vec::new(),
        colors: Vec::new(),
    };
    // A rig whose views share nothing would never fill the quota: the number of draws is bounded.
    for draw in 0..20 * n {
        if points.positions.len() == n {
            break;
        }
        let image = draw % images.len();
        let camera = &views[image * stride].camera;
        let (x, y) = (
            rng.random_range(0..camera.width),
            rng.random_range(0..camera.height),
        );
        let position = camera.position();
        let distance = (0..3)
            .map(|a| (focus[a] - position[a]).powi(2))
            .sum::<f64>()
            .sqrt()
            .max(1e-6);
        let inverse = rng.random_range(1.0 / RANDOM_DEPTHS[1]..1.0 / RANDOM_DEPTHS[0]);
        let depth = distance / inverse;
        let local = [
            (x as f64 + 0.5 - camera.cx) / camera.fx * depth,
            (y as f64 + 0.5 - camera.cy) / camera.fy * depth,
            depth,
        ];
        let world: [f64; 3] = std::array::from_fn(|axis| {
            position[axis]
                + (0..3)
                    .map(|row| camera.rotation[row][axis] * local[row])
                    .sum::<f64>()
        });
        let sees = |camera: &Camera| {
            camera.project(world).is_some_and(|([u, v], _)| {
                (0.0..camera.width as f64).contains(&u) && (0.0..camera.height as f64).contains(&v)
            })
        };
        let seen = cameras
            .iter()
            .step_by(stride)
            .filter(|camera| sees(camera))
            .count();
        if seen < 2.min(images.len()) {
            continue;
        }
        let pixel = (y * camera.width + x) * 3;
        points.positions.push(world.map(|v| v as f32));
        points
            .colors
            .push(std::array::from_fn(|c| images[image][pixel + c]));
    }
    points
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

/// The point nearest to all cameras' axes, in the least-squares sense; one unit ahead of the first
/// camera when the axes are parallel.
fn focus_point(cameras: &[Camera]) -> [f64; 3] {
    let mut normal = glam::DMat3::ZERO;
    let mut right = glam::DVec3::ZERO;
    for camera in cameras {
        let axis = glam::DVec3::from(camera.forward());
        let across = glam::DMat3::IDENTITY
            - glam::DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        normal += across;
        right += across * glam::DVec3::from(camera.position());
    }
    let ahead = |camera: &Camera| {
        (glam::DVec3::from(camera.position()) + glam::DVec3::from(camera.forward())).to_array()
    };
    if normal.determinant().abs() < 1e-9 * (cameras.len() as f64).powi(3) {
        return cameras.first().map_or([0.0; 3], ahead);
    }
    (normal.inverse() * right).to_array()
}
