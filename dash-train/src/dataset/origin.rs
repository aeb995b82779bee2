//! Scenes far from the origin, such as those in map coordinates.

use glam::DVec3;

use super::view::View;
use crate::cameras::in_one_place;
use crate::ply::PointCloud;

/// At this distance from the origin, in sizes of the scene, single precision rounds positions to about a
/// thousandth of the scene.
const FAR: f64 = 1e4;

/// A scene that is too far from the origin for positions in single precision.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FarScene {
    center: [f64; 3],
    /// Distance of the centre from the origin, in sizes of the scene.
    sizes: f64,
}

impl FarScene {
    /// The scene of these cameras and points; `None` when it is near enough, or all cameras stand in one place
    /// and there are no points.
    pub(crate) fn of(views: &[View], points: Option<&PointCloud>) -> Option<Self> {
        let positions: Vec<[f64; 3]> = views.iter().map(|v| v.camera.position()).collect();
        let n = positions.len() as f64;
        let center = [0, 1, 2].map(|axis| positions.iter().map(|p| p[axis]).sum::<f64>() / n);
        let to_center = |p: &[f64; 3]| distance(*p, center);
        let places: Vec<DVec3> = positions.iter().map(|&p| p.into()).collect();
        let cameras = match in_one_place(&places) {
            true => 0.0,
            false => positions.iter().map(to_center).fold(0.0, f64::max),
        };
        let mut to_points: Vec<f64> = points.map_or_else(Vec::new, |points| {
            let positions = points.positions.iter().map(|p| p.map(f64::from));
            positions.map(|p| distance(p, center)).collect()
        });
        to_points.sort_by(f64::total_cmp);
        let size = to_points
            .get(to_points.len() / 2)
            .map_or(cameras, |middle| middle.max(cameras));
        let sizes = distance(center, [0.0; 3]) / size;
        (size > 0.0 && sizes > FAR).then_some(Self { center, sizes })
    }

    /// What is wrong, in words.
    pub(crate) fn text(&self) -> String {
        format!(
            "the scene is {:.0} times its size from the origin, where positions in single precision are \
             rounded to {:.2} % of that size",
            self.sizes,
            100.0 * self.sizes * f64::from(f32::EPSILON)
        )
    }

    /// What to do about it.
    pub(crate) fn mend(&self) -> String {
        let [x, y, z] = self.center;
        format!("subtract ({x:.1}, {y:.1}, {z:.1}) from all positions of cameras and points")
    }
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dash_kernels::Camera;

    fn views(center: [f64; 3], radius: f64) -> Vec<View> {
        let view = |side: f64| {
            let eye = [center[0] + side * radius, center[1], center[2]];
            let up = [0.0, 1.0, 0.0];
            let target = [center[0], center[1], center[2] + 1.0];
            let camera = Camera::new(1.0, 1.0, 0.5, 0.5, 1, 1).look_at(eye, target, up);
            View::from_rgb8("v", camera, 0.0, vec![0; 3])
        };
        vec![view(-1.0), view(1.0)]
    }

    #[test]
    fn scenes_in_map_coordinates_are_far() {
        let map = [690_000.0, 5_330_000.0, 500.0];
        let far = FarScene::of(&views(map, 5.0), None).expect("far");
        assert!((far.sizes - 1.0749e6).abs() < 1e3, "{far:?}");
        assert!(far.text().contains("rounded to 12."), "{}", far.text());
        let mend = "subtract (690000.0, 5330000.0, 500.0) from all positions of cameras and points";
        assert_eq!(far.mend(), mend);
        // Of a thousand metres and more, the same place is near.
        assert_eq!(FarScene::of(&views(map, 1000.0), None), None);
        assert_eq!(FarScene::of(&views([10.0, 0.0, 0.0], 1.0), None), None);
    }

    #[test]
    fn points_say_how_large_a_scene_of_one_camera_is() {
        let center = [1e5, 0.0, 0.0];
        let one = &views(center, 0.0);
        assert_eq!(FarScene::of(one, None), None);
        let points = |distance: f32| PointCloud {
            positions: vec![[1e5, 0.0, distance]; 3],
            colors: vec![[0; 3]; 3],
        };
        assert!(FarScene::of(one, Some(&points(2.0))).is_some());
        assert_eq!(FarScene::of(one, Some(&points(200.0))), None);
    }
}
