//! Small matrices and quaternions.

#[inline(always)]
pub fn rotation_from_quat([w, x, y, z]: [f32; 4]) -> [[f32; 3]; 3] {
    [
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        ],
        [
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
        ],
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ]
}

#[inline(always)]
pub fn rotation_from_quat_vjp([w, x, y, z]: [f32; 4], v: &[[f32; 3]; 3]) -> [f32; 4] {
    let (turn_x, turn_y, turn_z) = (v[2][1] - v[1][2], v[0][2] - v[2][0], v[1][0] - v[0][1]);
    let (xy, xz, yz) = (v[0][1] + v[1][0], v[0][2] + v[2][0], v[1][2] + v[2][1]);
    [
        2.0 * (x * turn_x + y * turn_y + z * turn_z),
        2.0 * (w * turn_x + y * xy + z * xz) - 4.0 * x * (v[1][1] + v[2][2]),
        2.0 * (w * turn_y + x * xy + z * yz) - 4.0 * y * (v[0][0] + v[2][2]),
        2.0 * (w * turn_z + x * xz + y * yz) - 4.0 * z * (v[0][0] + v[1][1]),
    ]
}

#[inline(always)]
pub fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[inline(always)]
pub fn mat_mul(a: &[[f32; 3]; 3], b: &[[f32; 3]; 3]) -> [[f32; 3]; 3] {
    std::array::from_fn(|r| {
        std::array::from_fn(|c| a[r][0] * b[0][c] + a[r][1] * b[1][c] + a[r][2] * b[2][c])
    })
}

#[inline(always)]
pub fn transpose(m: &[[f32; 3]; 3]) -> [[f32; 3]; 3] {
    std::array::from_fn(|r| std::array::from_fn(|c| m[c][r]))
}
