//! Pinhole camera with OpenCV axes.

/// A pinhole camera: x right, y down, z forward; pixel centres at +0.5.
///
/// # Units
/// Focal lengths and principal point in pixels, translation in world units.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Rotation, row-major, of the rigid transform from world to camera coordinates.
    pub rotation: [[f64; 3]; 3],
    /// Translation of the rigid transform from world to camera coordinates.
    pub translation: [f64; 3],
    /// Horizontal focal length.
    pub fx: f64,
    /// Vertical focal length.
    pub fy: f64,
    /// Principal point, from the left edge.
    pub cx: f64,
    /// Principal point, from the top edge.
    pub cy: f64,
    /// Image width.
    pub width: usize,
    /// Image height.
    pub height: usize,
}

impl Camera {
    /// The camera with the given intrinsics at the world's origin, looking along +z.
    pub fn new(fx: f64, fy: f64, cx: f64, cy: f64, width: usize, height: usize) -> Self {
        Self {
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
            fx,
            fy,
            cx,
            cy,
            width,
            height,
        }
    }

    /// The same intrinsics placed at `position` with `world_from_camera` rotation rows
    /// (columns are the camera's right, down and forward axes in the world).
    pub fn placed(mut self, world_from_camera: [[f64; 3]; 3], position: [f64; 3]) -> Self {
        for (row, out) in self.rotation.iter_mut().enumerate() {
            for (col, value) in out.iter_mut().enumerate() {
                *value = world_from_camera[col][row];
            }
        }
        for (row, t) in self.translation.iter_mut().enumerate() {
            *t = -dot(&self.rotation[row], &position);
        }
        self
    }

    /// The same intrinsics at `eye` looking at `target`; `up` is the world's up direction.
    pub fn look_at(self, eye: [f64; 3], target: [f64; 3], up: [f64; 3]) -> Self {
        let forward = normalized(sub(target, eye));
        let right = normalized(cross(forward, up));
        let down = cross(forward, right);
        let world_from_camera = [
            [right[0], down[0], forward[0]],
            [right[1], down[1], forward[1]],
            [right[2], down[2], forward[2]],
        ];
        self.placed(world_from_camera, eye)
    }

    /// The camera's centre in world coordinates.
    pub fn position(&self) -> [f64; 3] {
        let mut position = [0.0; 3];
        for (axis, out) in position.iter_mut().enumerate() {
            *out = -(0..3)
                .map(|row| self.rotation[row][axis] * self.translation[row])
                .sum::<f64>();
        }
        position
    }

    /// The viewing direction (camera z) in world coordinates.
    pub fn forward(&self) -> [f64; 3] {
        self.rotation[2]
    }

    /// A world point in camera coordinates.
    pub fn transform(&self, point: [f64; 3]) -> [f64; 3] {
        let mut out = self.translation;
        for (row, value) in out.iter_mut().enumerate() {
            *value += dot(&self.rotation[row], &point);
        }
        out
    }

    /// Pixel coordinates and depth of a world point; `None` when it is not in front of the camera.
    pub fn project(&self, point: [f64; 3]) -> Option<([f64; 2], f64)> {
        let [x, y, z] = self.transform(point);
        (z > 0.0).then(|| ([self.fx * x / z + self.cx, self.fy * y / z + self.cy], z))
    }

    /// Pixel coordinates and depth of a world point; `None` when it is outside the picture.
    pub fn project_inside(&self, point: [f64; 3]) -> Option<([f64; 2], f64)> {
        self.project(point).filter(|([u, v], _)| {
            (0.0..self.width as f64).contains(u) && (0.0..self.height as f64).contains(v)
        })
    }

    /// The same view at another image size, intrinsics scaled with it.
    pub fn resized(&self, width: usize, height: usize) -> Self {
        let (sx, sy) = (
            width as f64 / self.width as f64,
            height as f64 / self.height as f64,
        );
        Self {
            fx: self.fx * sx,
            fy: self.fy * sy,
            cx: self.cx * sx,
            cy: self.cy * sy,
            width,
            height,
            ..self.clone()
        }
    }
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn normalized(a: [f64; 3]) -> [f64; 3] {
    let norm = dot(&a, &a).sqrt();
    a.map(|v| v / norm)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn look_at_puts_the_target_on_the_principal_point_with_up_upwards() {
        let camera = Camera::new(100.0, 110.0, 40.0, 31.0, 80, 60).look_at(
            [1.0, 2.0, -4.0],
            [0.5, 0.0, 3.0],
            [0.0, 1.0, 0.0],
        );
        let ([u, v], depth) = camera.project([0.5, 0.0, 3.0]).expect("in front");
        assert!((u - 40.0).abs() < 1e-9 && (v - 31.0).abs() < 1e-9 && depth > 7.0);
        let ([_, above], _) = camera.project([0.5, 0.3, 3.0]).expect("in front");
        assert!(above < 31.0, "a higher point has a smaller row");
        for (got, expected) in camera.position().iter().zip([1.0, 2.0, -4.0]) {
            assert!((got - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn a_picture_holds_its_first_row_and_column_and_not_what_is_behind() {
        let camera = Camera::new(2.0, 2.0, 2.0, 1.0, 4, 2);
        assert_eq!(
            camera.project_inside([-1.0, -0.5, 1.0]),
            Some(([0.0, 0.0], 1.0))
        );
        assert_eq!(camera.project_inside([1.0, 0.0, 1.0]), None, "column 4");
        assert_eq!(camera.project_inside([0.0, 0.5, 1.0]), None, "row 2");
        assert_eq!(camera.project_inside([0.0, 0.0, -1.0]), None, "behind");
    }

    #[test]
    fn resized_keeps_rays() {
        let camera = Camera::new(100.0, 110.0, 40.0, 31.0, 80, 60);
        let ([u, v], _) = camera.project([0.3, -0.2, 2.0]).expect("in front");
        let ([u2, v2], _) = camera
            .resized(40, 30)
            .project([0.3, -0.2, 2.0])
            .expect("in front");
        assert!((u / 2.0 - u2).abs() < 1e-12 && (v / 2.0 - v2).abs() < 1e-12);
    }
}
