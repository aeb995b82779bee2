//! Vectors, and the projected covariance of one Gaussian.

use cubecl::prelude::*;

use crate::cube::is_finite;

/// Quaternions with a smaller squared length are culled.
const MIN_QUAT_NORM_SQUARED: f32 = 1e-12;

/// Three coordinates.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Vec3 {
    pub x: f32,
    pub y: f32,
    pub z: f32,
}

#[cube]
impl Vec3 {
    pub fn read(values: &[f32], i: usize) -> Vec3 {
        Vec3 {
            x: values[3 * i],
            y: values[3 * i + 1],
            z: values[3 * i + 2],
        }
    }

    pub fn dot(&self, other: &Vec3) -> f32 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    pub fn cross(&self, other: &Vec3) -> Vec3 {
        Vec3 {
            x: self.y * other.z - self.z * other.y,
            y: self.z * other.x - self.x * other.z,
            z: self.x * other.y - self.y * other.x,
        }
    }

    pub fn scaled(&self, factor: f32) -> Vec3 {
        Vec3 {
            x: self.x * factor,
            y: self.y * factor,
            z: self.z * factor,
        }
    }

    pub fn plus(&self, other: &Vec3) -> Vec3 {
        Vec3 {
            x: self.x + other.x,
            y: self.y + other.y,
            z: self.z + other.z,
        }
    }

    /// Coordinate by coordinate.
    pub fn times(&self, other: &Vec3) -> Vec3 {
        Vec3 {
            x: self.x * other.x,
            y: self.y * other.y,
            z: self.z * other.z,
        }
    }

    pub fn is_finite(&self) -> bool {
        is_finite(self.x) && is_finite(self.y) && is_finite(self.z)
    }
}

/// Three rows.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Mat3 {
    pub x: Vec3,
    pub y: Vec3,
    pub z: Vec3,
}

#[cube]
impl Mat3 {
    pub fn times_vector(&self, v: &Vec3) -> Vec3 {
        Vec3 {
            x: self.x.dot(v),
            y: self.y.dot(v),
            z: self.z.dot(v),
        }
    }

    /// The product of the transpose with a vector.
    pub fn transposed_times_vector(&self, v: &Vec3) -> Vec3 {
        let sum = self.x.scaled(v.x).plus(&self.y.scaled(v.y));
        sum.plus(&self.z.scaled(v.z))
    }

    pub fn times(&self, other: &Mat3) -> Mat3 {
        Mat3 {
            x: other.transposed_times_vector(&self.x),
            y: other.transposed_times_vector(&self.y),
            z: other.transposed_times_vector(&self.z),
        }
    }

    pub fn transposed(&self) -> Mat3 {
        Mat3 {
            x: Vec3 {
                x: self.x.x,
                y: self.y.x,
                z: self.z.x,
            },
            y: Vec3 {
                x: self.x.y,
                y: self.y.y,
                z: self.z.y,
            },
            z: Vec3 {
                x: self.x.z,
                y: self.y.z,
                z: self.z.z,
            },
        }
    }
}

/// A [`View`](super::super::View) as launched; `xx` to `zz` are the rotation's entries.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub(super) struct ViewConstants {
    xx: f32,
    xy: f32,
    xz: f32,
    yx: f32,
    yy: f32,
    yz: f32,
    zx: f32,
    zy: f32,
    zz: f32,
    translation_x: f32,
    translation_y: f32,
    translation_z: f32,
    position_x: f32,
    position_y: f32,
    position_z: f32,
    pub focal_x: f32,
    pub focal_y: f32,
    pub principal_x: f32,
    pub principal_y: f32,
    pub width: f32,
    pub height: f32,
    lowest_x: f32,
    lowest_y: f32,
    highest_x: f32,
    highest_y: f32,
    near_plane: f32,
    pub low_pass: f32,
}

#[cube]
impl ViewConstants {
    pub fn rotation(&self) -> Mat3 {
        Mat3 {
            x: Vec3 {
                x: self.xx,
                y: self.xy,
                z: self.xz,
            },
            y: Vec3 {
                x: self.yx,
                y: self.yy,
                z: self.yz,
            },
            z: Vec3 {
                x: self.zx,
                y: self.zy,
                z: self.zz,
            },
        }
    }

    /// Vector from the camera's centre.
    pub fn offset(&self, mean: &Vec3) -> Vec3 {
        Vec3 {
            x: mean.x - self.position_x,
            y: mean.y - self.position_y,
            z: mean.z - self.position_z,
        }
    }

    fn point(&self, mean: &Vec3) -> Vec3 {
        let rotated = self.rotation().times_vector(mean);
        Vec3 {
            x: rotated.x + self.translation_x,
            y: rotated.y + self.translation_y,
            z: rotated.z + self.translation_z,
        }
    }
}

/// Four coordinates (w, x, y, z).
#[derive(CubeType, Clone, Copy)]
pub(super) struct Quat {
    pub w: f32,
    pub x: f32,
    pub y: f32,
    pub z: f32,
}

#[cube]
impl Quat {
    pub fn rotation(&self) -> Mat3 {
        let (w, x, y, z) = (self.w, self.x, self.y, self.z);
        Mat3 {
            x: Vec3 {
                x: 1.0f32 - 2.0f32 * (y * y + z * z),
                y: 2.0f32 * (x * y - w * z),
                z: 2.0f32 * (x * z + w * y),
            },
            y: Vec3 {
                x: 2.0f32 * (x * y + w * z),
                y: 1.0f32 - 2.0f32 * (x * x + z * z),
                z: 2.0f32 * (y * z - w * x),
            },
            z: Vec3 {
                x: 2.0f32 * (x * z - w * y),
                y: 2.0f32 * (y * z + w * x),
                z: 1.0f32 - 2.0f32 * (x * x + y * y),
            },
        }
    }

    /// Gradient from that of the rotation.
    pub fn rotation_vjp(&self, v: &Mat3) -> Quat {
        let (w, x, y, z) = (self.w, self.x, self.y, self.z);
        let turn_x = v.z.y - v.y.z;
        let turn_y = v.x.z - v.z.x;
        let turn_z = v.y.x - v.x.y;
        let xy = v.x.y + v.y.x;
        let xz = v.x.z + v.z.x;
        let yz = v.y.z + v.z.y;
        Quat {
            w: 2.0f32 * (x * turn_x + y * turn_y + z * turn_z),
            x: 2.0f32 * (w * turn_x + y * xy + z * xz) - 4.0f32 * x * (v.y.y + v.z.z),
            y: 2.0f32 * (w * turn_y + x * xy + z * yz) - 4.0f32 * y * (v.x.x + v.z.z),
            z: 2.0f32 * (w * turn_z + x * xz + y * yz) - 4.0f32 * z * (v.x.x + v.y.y),
        }
    }

    pub fn dot(&self, other: &Quat) -> f32 {
        self.w * other.w + self.x * other.x + self.y * other.y + self.z * other.z
    }
}

/// The projected covariance and what leads to it.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Footprint {
    /// Whether nothing culls the Gaussian so far; the rest means little where it is false.
    pub drawn: bool,
    /// The mean in camera coordinates.
    pub point: Vec3,
    /// x/z and y/z.
    pub ratio_x: f32,
    pub ratio_y: f32,
    /// The same, no further than the Jacobian follows.
    pub slope_x: f32,
    pub slope_y: f32,
    pub unit_quat: Quat,
    pub inverse_quat_norm: f32,
    pub scale: Vec3,
    /// `W R`: the Gaussian's axes in camera coordinates, as columns.
    pub axes: Mat3,
    /// The rows of `J W R S`.
    pub row0: Vec3,
    pub row1: Vec3,
}

#[cube]
pub(super) fn footprint_of(
    means: &[f32],
    quats: &[f32],
    scales: &[f32],
    i: usize,
    view: &ViewConstants,
    #[comptime] exp: bool,
) -> Footprint {
    let mean = Vec3::read(means, i);
    let point = view.point(&mean);
    let raw_scale = Vec3::read(scales, i);
    let quat = Quat {
        w: quats[4 * i],
        x: quats[4 * i + 1],
        y: quats[4 * i + 2],
        z: quats[4 * i + 3],
    };
    let norm_squared = quat.dot(&quat);
    let drawn = point.z >= view.near_plane
        && mean.is_finite()
        && raw_scale.is_finite()
        && point.is_finite()
        && is_finite(norm_squared)
        && norm_squared >= MIN_QUAT_NORM_SQUARED;
    let inverse_quat_norm = 1.0f32 / norm_squared.sqrt();
    let unit_quat = Quat {
        w: quat.w * inverse_quat_norm,
        x: quat.x * inverse_quat_norm,
        y: quat.y * inverse_quat_norm,
        z: quat.z * inverse_quat_norm,
    };
    let mut scale = Vec3 {
        x: raw_scale.x,
        y: raw_scale.y,
        z: raw_scale.z,
    };
    if comptime!(exp) {
        scale.x = raw_scale.x.exp();
        scale.y = raw_scale.y.exp();
        scale.z = raw_scale.z.exp();
    }
    let axes = view.rotation().times(&unit_quat.rotation());
    let inverse_z = 1.0f32 / point.z;
    let ratio_x = point.x * inverse_z;
    let ratio_y = point.y * inverse_z;
    let slope_x = f32::min(f32::max(ratio_x, view.lowest_x), view.highest_x);
    let slope_y = f32::min(f32::max(ratio_y, view.lowest_y), view.highest_y);
    let row0 = axes
        .x
        .plus(&axes.z.scaled(-slope_x))
        .scaled(view.focal_x * inverse_z)
        .times(&scale);
    let row1 = axes
        .y
        .plus(&axes.z.scaled(-slope_y))
        .scaled(view.focal_y * inverse_z)
        .times(&scale);
    Footprint {
        drawn,
        point,
        ratio_x,
        ratio_y,
        slope_x,
        slope_y,
        unit_quat,
        inverse_quat_norm,
        scale,
        axes,
        row0,
        row1,
    }
}
