//! Real spherical harmonics up to degree 3, with the signs of 3DGS.

use num_traits::Float;

/// Coefficients per channel for each degree.
pub const N_COEFFS: [usize; 4] = [1, 4, 9, 16];

pub(super) const C0: f64 = 0.282_094_791_773_878_14;
pub(super) const C1: f64 = 0.488_602_511_902_919_9;
pub(super) const C2: [f64; 5] = [
    1.092_548_430_592_079_2,
    -1.092_548_430_592_079_2,
    0.315_391_565_252_520_05,
    -1.092_548_430_592_079_2,
    0.546_274_215_296_039_6,
];
pub(super) const C3: [f64; 7] = [
    -0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    -0.457_045_799_464_465_8,
    0.373_176_332_590_115_4,
    -0.457_045_799_464_465_8,
    1.445_305_721_320_277,
    -0.590_043_589_926_643_5,
];

#[inline(always)]
fn constant<T: Float>(value: f64) -> T {
    T::from(value).expect("every float type holds the constants")
}

/// The basis functions at unit direction `dir`; entries beyond `degree` are zero.
#[inline(always)]
pub fn sh_basis<T: Float>(dir: [T; 3], degree: usize) -> [T; 16] {
    let c = constant::<T>;
    let [x, y, z] = dir;
    let mut basis = [T::zero(); 16];
    basis[0] = c(C0);
    if degree < 1 {
        return basis;
    }
    basis[1] = -c(C1) * y;
    basis[2] = c(C1) * z;
    basis[3] = -c(C1) * x;
    if degree < 2 {
        return basis;
    }
    let (xx, yy, zz) = (x * x, y * y, z * z);
    basis[4] = c(C2[0]) * x * y;
    basis[5] = c(C2[1]) * y * z;
    basis[6] = c(C2[2]) * (zz + zz - xx - yy);
    basis[7] = c(C2[3]) * x * z;
    basis[8] = c(C2[4]) * (xx - yy);
    if degree < 3 {
        return basis;
    }
    let (three, four) = (c(3.0), c(4.0));
    basis[9] = c(C3[0]) * y * (three * xx - yy);
    basis[10] = c(C3[1]) * x * y * z;
    basis[11] = c(C3[2]) * y * (four * zz - xx - yy);
    basis[12] = c(C3[3]) * z * (zz + zz - three * xx - three * yy);
    basis[13] = c(C3[4]) * x * (four * zz - xx - yy);
    basis[14] = c(C3[5]) * z * (xx - yy);
    basis[15] = c(C3[6]) * x * (xx - three * yy);
    basis
}

/// Gradient of the direction from the gradient of the basis functions.
#[inline(always)]
pub fn sh_basis_vjp<T: Float>(dir: [T; 3], degree: usize, v: &[T; 16]) -> [T; 3] {
    let c = constant::<T>;
    let [x, y, z] = dir;
    let mut v_dir = [T::zero(); 3];
    let mut add = |dx: T, dy: T, dz: T| {
        v_dir[0] = v_dir[0] + dx;
        v_dir[1] = v_dir[1] + dy;
        v_dir[2] = v_dir[2] + dz;
    };
    let zero = T::zero();
    if degree >= 1 {
        add(-c(C1) * v[3], -c(C1) * v[1], c(C1) * v[2]);
    }
    let two = c(2.0);
    if degree >= 2 {
        let [a, b, d, e, f] = [
            c(C2[0]) * v[4],
            c(C2[1]) * v[5],
            c(C2[2]) * v[6],
            c(C2[3]) * v[7],
            c(C2[4]) * v[8],
        ];
        add(a * y, a * x, zero);
        add(zero, b * z, b * y);
        add(-two * d * x, -two * d * y, two * two * d * z);
        add(e * z, zero, e * x);
        add(two * f * x, -two * f * y, zero);
    }
    if degree >= 3 {
        let (three, four, six, eight) = (c(3.0), c(4.0), c(6.0), c(8.0));
        let (xx, yy, zz) = (x * x, y * y, z * z);
        let v: [T; 7] = std::array::from_fn(|k| c(C3[k]) * v[9 + k]);
        add(v[0] * six * x * y, v[0] * three * (xx - yy), zero);
        add(v[1] * y * z, v[1] * x * z, v[1] * x * y);
        add(
            -v[2] * two * x * y,
            v[2] * (four * zz - xx - three * yy),
            v[2] * eight * y * z,
        );
        add(
            -v[3] * six * x * z,
            -v[3] * six * y * z,
            v[3] * (six * zz - three * xx - three * yy),
        );
        add(
            v[4] * (four * zz - three * xx - yy),
            -v[4] * two * x * y,
            v[4] * eight * x * z,
        );
        add(v[5] * two * x * z, -v[5] * two * y * z, v[5] * (xx - yy));
        add(v[6] * three * (xx - yy), -v[6] * six * x * y, zero);
    }
    v_dir
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The basis is orthonormal over the sphere; the quadrature (midpoints in azimuth, which are
    /// exact here, and in z) is good to 1e-4.
    #[test]
    fn orthonormal_over_the_sphere() {
        let (n_z, n_phi) = (400, 16);
        let mut gram = [[0.0f64; 16]; 16];
        for i in 0..n_z {
            let z = (i as f64 + 0.5) / n_z as f64 * 2.0 - 1.0;
            let r = (1.0 - z * z).sqrt();
            for j in 0..n_phi {
                let phi = (j as f64 + 0.5) / n_phi as f64 * std::f64::consts::TAU;
                let basis = sh_basis([r * phi.cos(), r * phi.sin(), z], 3);
                let weight = 4.0 * std::f64::consts::PI / (n_z * n_phi) as f64;
                for (row, a) in gram.iter_mut().zip(basis) {
                    for (entry, b) in row.iter_mut().zip(basis) {
                        *entry += weight * a * b;
                    }
                }
            }
        }
        for (i, row) in gram.iter().enumerate() {
            for (j, &value) in row.iter().enumerate() {
                let expected = f64::from(u8::from(i == j));
                assert!((value - expected).abs() < 1e-4, "({i}, {j}): {value}");
            }
        }
    }

    /// The signs along the axes, as in the CUDA source of 3DGS.
    #[test]
    fn signs_along_the_axes() {
        let x = sh_basis([1.0, 0.0, 0.0], 3);
        let y = sh_basis([0.0, 1.0, 0.0], 3);
        let z = sh_basis([0.0, 0.0, 1.0], 3);
        assert!(x[3] < 0.0 && y[1] < 0.0 && z[2] > 0.0);
        assert!(x[8] > 0.0 && y[8] < 0.0 && z[6] > 0.0 && x[6] < 0.0);
        assert!(x[15] < 0.0 && y[9] > 0.0 && z[12] > 0.0);
    }

    #[test]
    fn gradient_against_central_differences() {
        let dir = [0.36, -0.48, 0.8];
        for degree in 0..4 {
            for k in 0..16 {
                let mut v = [0.0; 16];
                v[k] = 1.0;
                let v_dir = sh_basis_vjp(dir, degree, &v);
                for axis in 0..3 {
                    let at = |step: f64| {
                        let mut moved = dir;
                        moved[axis] += step;
                        sh_basis(moved, degree)[k]
                    };
                    let expected = (at(1e-6) - at(-1e-6)) / 2e-6;
                    assert!(
                        (v_dir[axis] - expected).abs() < 1e-8,
                        "degree {degree}, function {k}, axis {axis}: {} != {expected}",
                        v_dir[axis]
                    );
                }
            }
        }
    }
}
