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

/// A symmetric matrix as its entries (0, 0), (0, 1) and (1, 1).
pub(super) type Sym2<T> = [T; 3];

/// `a^T m b`.
fn between<T: Float>(a: [T; 2], [xx, xy, yy]: Sym2<T>, b: [T; 2]) -> T {
    a[0] * (xx * b[0] + xy * b[1]) + a[1] * (xy * b[0] + yy * b[1])
}

/// Gradient of a matrix from that of its inverse, `-inverse v inverse`, in the frame of its axes: the product's small
/// entries are what large ones leave of each other.
pub(super) fn inverse_vjp<T: Float>(matrix: Sym2<T>, v_inverse: Sym2<T>) -> Sym2<T> {
    let [xx, xy, yy] = matrix;
    let half = (xx - yy) / (T::one() + T::one());
    let more = half.abs() + half.hypot(xy);
    let long = match (more > T::zero(), half >= T::zero()) {
        (false, _) => [T::one(), T::zero()],
        (true, true) => [more, xy],
        (true, false) => [xy, more],
    };
    let length = long[0].hypot(long[1]);
    let long = long.map(|x| x / length);
    let short = [-long[1], long[0]];
    let [by_short, by_long] = [short, long].map(|axis| T::one() / between(axis, matrix, axis));
    let of_short = -by_short * by_short * between(short, v_inverse, short);
    let mixed = -by_short * by_long * between(short, v_inverse, long);
    let of_long = -by_long * by_long * between(long, v_inverse, long);
    [(0, 0), (0, 1), (1, 1)].map(|(r, c)| {
        let both = short[r] * long[c] + long[r] * short[c];
        of_short * short[r] * short[c] + mixed * both + of_long * long[r] * long[c]
    })
}

pub(super) fn scale_columns<T: Float>(m: &Mat3<T>, scale: [T; 3]) -> Mat3<T> {
    m.map(|row| std::array::from_fn(|k| row[k] * scale[k]))
}
