//! Pinhole camera with OpenCV axes.

#[cfg(test)]
mod tests;

use glam::{DAffine3, DMat3, DVec3};

use crate::KernelError;

/// How far from one the products of a rotation's axes may be: poses are often written with four digits.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// A pinhole camera: x right, y down, z forward; pixel centres at +0.5.
///
/// Intrinsics come first, then the pose: [`new`](Self::new) or [`from_fov_y`](Self::from_fov_y), then
/// [`look_at`](Self::look_at), [`with_camera_from_world`](Self::with_camera_from_world) or
/// [`with_world_from_camera`](Self::with_world_from_camera).
///
/// # Units
/// Focal lengths and principal point in pixels, translation in world units.
///
/// ```
/// use dash_kernels::Camera;
/// use dash_kernels::glam::{DAffine3, DVec3};
///
/// let camera = Camera::from_fov_y(60f64.to_radians(), 640, 480).look_at(
///     DVec3::new(0.0, 1.0, 4.0), // eye
///     DVec3::ZERO,               // target
///     DVec3::Y,                  // up
/// );
/// let (pixel, depth) = camera.project([0.0; 3]).expect("in front of the camera");
/// assert!((pixel[0] - 320.0).abs() < 1e-9 && (pixel[1] - 240.0).abs() < 1e-9);
/// assert!((depth - 17f64.sqrt()).abs() < 1e-9);
///
/// // The same pose in OpenGL's axes (y up, z backward), as other programs write it.
/// let opengl = DAffine3::look_at_rh(DVec3::new(0.0, 1.0, 4.0), DVec3::ZERO, DVec3::Y).inverse();
/// let opencv_from_opengl = DAffine3::from_scale(DVec3::new(1.0, -1.0, -1.0));
/// let same = camera.clone().with_world_from_camera(opengl * opencv_from_opengl)?;
/// assert!(same.camera_from_world().abs_diff_eq(camera.camera_from_world(), 1e-12));
/// # Ok::<(), dash_kernels::KernelError>(())
/// ```
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

    /// The camera with square pixels, the principal point in the middle and the given horizontal field of view.
    ///
    /// # Units
    /// `fov_x_radians` in radians, between 0 and pi.
    pub fn from_fov_x(fov_x_radians: f64, width: usize, height: usize) -> Self {
        let focal = 0.5 * width as f64 / (0.5 * fov_x_radians).tan();
        Self::centred(focal, width, height)
    }

    /// The camera with square pixels, the principal point in the middle and the given vertical field of view.
    ///
    /// # Units
    /// `fov_y_radians` in radians, between 0 and pi.
    pub fn from_fov_y(fov_y_radians: f64, width: usize, height: usize) -> Self {
        let focal = 0.5 * height as f64 / (0.5 * fov_y_radians).tan();
        Self::centred(focal, width, height)
    }

    fn centred(focal: f64, width: usize, height: usize) -> Self {
        let (cx, cy) = (0.5 * width as f64, 0.5 * height as f64);
        Self::new(focal, focal, cx, cy, width, height)
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

    /// The same intrinsics at `eye` looking at `target`; `up` is the world's up direction, of any length.
    ///
    /// The pose is NaN where `eye` is `target` or `up` is parallel to the viewing direction.
    pub fn look_at(
        self,
        eye: impl Into<DVec3>,
        target: impl Into<DVec3>,
        up: impl Into<DVec3>,
    ) -> Self {
        let [eye, target, up] = [eye.into(), target.into(), up.into()].map(|v| v.to_array());
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

    /// The same intrinsics with the pose of a rigid transform from world to camera coordinates, as COLMAP's.
    ///
    /// # Errors
    /// [`KernelError::Camera`] when the transform scales, shears or mirrors, or is not finite.
    pub fn with_camera_from_world(
        mut self,
        camera_from_world: DAffine3,
    ) -> Result<Self, KernelError> {
        check_rigid("camera_from_world", &camera_from_world)?;
        self.rotation = camera_from_world.matrix3.transpose().to_cols_array_2d();
        self.translation = camera_from_world.translation.to_array();
        Ok(self)
    }

    /// The same intrinsics with the pose of a rigid transform from camera to world coordinates, as 3DGS'
    /// `cameras.json`; its translation is the camera's centre.
    ///
    /// # Errors
    /// [`KernelError::Camera`] when the transform scales, shears or mirrors, or is not finite.
    pub fn with_world_from_camera(self, world_from_camera: DAffine3) -> Result<Self, KernelError> {
        check_rigid("world_from_camera", &world_from_camera)?;
        let rows = world_from_camera.matrix3.transpose().to_cols_array_2d();
        Ok(self.placed(rows, world_from_camera.translation.to_array()))
    }

    /// The rigid transform from world to camera coordinates.
    pub fn camera_from_world(&self) -> DAffine3 {
        DAffine3 {
            matrix3: DMat3::from_cols_array_2d(&self.rotation).transpose(),
            translation: DVec3::from(self.translation),
        }
    }

    /// The rigid transform from camera to world coordinates.
    pub fn world_from_camera(&self) -> DAffine3 {
        DAffine3 {
            matrix3: DMat3::from_cols_array_2d(&self.rotation),
            translation: DVec3::from(self.position()),
        }
    }

    /// The matrix from camera coordinates to homogeneous pixel coordinates.
    pub fn intrinsics(&self) -> DMat3 {
        DMat3::from_cols(
            DVec3::new(self.fx, 0.0, 0.0),
            DVec3::new(0.0, self.fy, 0.0),
            DVec3::new(self.cx, self.cy, 1.0),
        )
    }

    /// The horizontal field of view, from the left edge of the picture to the right one.
    ///
    /// # Units
    /// Radians.
    pub fn fov_x_radians(&self) -> f64 {
        (self.cx / self.fx).atan() + ((self.width as f64 - self.cx) / self.fx).atan()
    }

    /// The vertical field of view, from the top edge of the picture to the bottom one.
    ///
    /// # Units
    /// Radians.
    pub fn fov_y_radians(&self) -> f64 {
        (self.cy / self.fy).atan() + ((self.height as f64 - self.cy) / self.fy).atan()
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

    /// The viewing direction (camera z) in world coordinates, of length one.
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

    /// The world point at a place in the picture, at a depth: the inverse of [`project`](Self::project).
    ///
    /// # Units
    /// `pixel` in pixels, centres at +0.5; `depth` along the viewing direction, world units.
    ///
    /// ```
    /// use dash_kernels::Camera;
    ///
    /// let camera = Camera::new(500.0, 500.0, 320.0, 240.0, 640, 480);
    /// let point = camera.unproject([100.0, 200.0], 4.0);
    /// let (pixel, depth) = camera.project(point).expect("in front");
    /// assert!((pixel[0] - 100.0).abs() < 1e-9 && (pixel[1] - 200.0).abs() < 1e-9);
    /// assert_eq!(depth, 4.0);
    /// ```
    pub fn unproject(&self, pixel: [f64; 2], depth: f64) -> [f64; 3] {
        let local = [
            (pixel[0] - self.cx) / self.fx * depth - self.translation[0],
            (pixel[1] - self.cy) / self.fy * depth - self.translation[1],
            depth - self.translation[2],
        ];
        std::array::from_fn(|axis| {
            (0..3)
                .map(|row| self.rotation[row][axis] * local[row])
                .sum()
        })
    }

    /// The same view at another image size, intrinsics scaled with it.
    ///
    /// ```
    /// use dash_kernels::Camera;
    ///
    /// let half = Camera::new(500.0, 500.0, 320.0, 240.0, 640, 480).resized(320, 240);
    /// assert_eq!(half, Camera::new(250.0, 250.0, 160.0, 120.0, 320, 240));
    /// ```
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

/// Refuses what is not a rotation and a translation.
fn check_rigid(name: &str, transform: &DAffine3) -> Result<(), KernelError> {
    let axes = transform.matrix3;
    let off = axes.transpose() * axes - DMat3::IDENTITY;
    // In the positive form, so that NaN is refused.
    let is_rotation = off
        .to_cols_array()
        .iter()
        .all(|value| value.abs() <= ROTATION_TOLERANCE)
        && axes.determinant() > 0.0;
    if is_rotation && transform.translation.is_finite() {
        return Ok(());
    }
    Err(KernelError::Camera {
        what: format!(
            "`{name}` is {transform:?}, expected a rotation and a translation without scale or mirroring"
        ),
    })
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
