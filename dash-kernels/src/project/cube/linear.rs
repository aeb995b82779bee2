//! Vectors, matrices and quaternions of the projection's kernels.

use cubecl::prelude::*;

use crate::cube::is_finite;

/// Three coordinates.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub(super) struct Vec3 {
    pub x: f32,
    pub y: f32,
    pub z: f32,
}

#[cube]
impl Vec3 {
    pub fn zero() -> Vec3 {
        Vec3 {
            x: 0.0f32,
            y: 0.0f32,
            z: 0.0f32,
        }
    }

    /// Row `i` of `values`.
    pub fn read(
        values: &[f32], // [N, 3]
        i: usize,
    ) -> Vec3 {
        Vec3 {
            x: values[3 * i],
            y: values[3 * i + 1],
            z: values[3 * i + 2],
        }
    }

    /// Writes row `i` of `values`.
    pub fn write(
        &self,
        values: &mut [f32], // [N, 3]
        i: usize,
    ) {
        values[3 * i] = self.x;
        values[3 * i + 1] = self.y;
        values[3 * i + 2] = self.z;
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

    pub fn add(&mut self, other: &Vec3) {
        self.x += other.x;
        self.y += other.y;
        self.z += other.z;
    }

    /// Coordinate by coordinate.
    pub fn times(&self, other: &Vec3) -> Vec3 {
        Vec3 {
            x: self.x * other.x,
            y: self.y * other.y,
            z: self.z * other.z,
        }
    }

    pub fn exponentials(&self) -> Vec3 {
        Vec3 {
            x: self.x.exp(),
            y: self.y.exp(),
            z: self.z.exp(),
        }
    }

    pub fn is_finite(&self) -> bool {
        is_finite(self.x) && is_finite(self.y) && is_finite(self.z)
    }
}

/// Three rows.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
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
    pub fn zero() -> Quat {
        Quat {
            w: 0.0f32,
            x: 0.0f32,
            y: 0.0f32,
            z: 0.0f32,
        }
    }

    /// Row `i` of `values`.
    pub fn read(
        values: &[f32], // [N, 4]
        i: usize,
    ) -> Quat {
        Quat {
            w: values[4 * i],
            x: values[4 * i + 1],
            y: values[4 * i + 2],
            z: values[4 * i + 3],
        }
    }

    /// Writes row `i` of `values`.
    pub fn write(
        &self,
        values: &mut [f32], // [N, 4]
        i: usize,
    ) {
        values[4 * i] = self.w;
        values[4 * i + 1] = self.x;
        values[4 * i + 2] = self.y;
        values[4 * i + 3] = self.z;
    }

    pub fn scaled(&self, factor: f32) -> Quat {
        Quat {
            w: self.w * factor,
            x: self.x * factor,
            y: self.y * factor,
            z: self.z * factor,
        }
    }

    pub fn is_finite(&self) -> bool {
        is_finite(self.w) && is_finite(self.x) && is_finite(self.y) && is_finite(self.z)
    }

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

    /// The pullback of [`rotation`](Self::rotation).
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
