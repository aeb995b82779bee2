//! Three by three matrices.

use num_traits::Float;

/// Rows.
pub(super) type Mat3<T> = [[T; 3]; 3];

pub(super) fn rotation_from_quat<T: Float>([w, x, y, z]: [T; 4]) -> Mat3<T> {
    let (one, two) = (T::one(), T::one() + T::one());
    [
        [
            one - two * (y * y + z * z),
            two * (x * y - w * z),
            two * (x * z + w * y),
        ],
        [
            two * (x * y + w * z),
            one - two * (x * x + z * z),
            two * (y * z - w * x),
        ],
        [
            two * (x * z - w * y),
            two * (y * z + w * x),
            one - two * (x * x + y * y),
        ],
    ]
}

pub(super) fn dot<T: Float>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn mat_vec<T: Float>(m: &Mat3<T>, v: [T; 3]) -> [T; 3] {
    m.map(|row| dot(row, v))
}

pub(super) fn transpose<T: Float>(m: &Mat3<T>) -> Mat3<T> {
    std::array::from_fn(|r| std::array::from_fn(|c| m[c][r]))
}

pub(super) fn mat_mul<T: Float>(a: &Mat3<T>, b: &Mat3<T>) -> Mat3<T> {
    let columns = transpose(b);
    a.map(|row| columns.map(|column| dot(row, column)))
}

pub(super) fn mat2_mul<T: Float>(a: &[[T; 2]; 2], b: &[[T; 2]; 2]) -> [[T; 2]; 2] {
    std::array::from_fn(|r| std::array::from_fn(|c| a[r][0] * b[0][c] + a[r][1] * b[1][c]))
}

pub(super) fn scale_columns<T: Float>(m: &Mat3<T>, scale: [T; 3]) -> Mat3<T> {
    m.map(|row| std::array::from_fn(|k| row[k] * scale[k]))
}
