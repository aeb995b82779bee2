//! From the axes of pose files to a camera.

use dash_kernels::Camera;

/// How far from perpendicular two axes may be (cosine).
const SKEW_TOLERANCE: f64 = 1e-3;
/// Poses this close are one camera's.
const SAME_POSE: f64 = 1e-6;

/// Places the intrinsics at `position` with the camera's `right`, `down` and `forward` axes in the
/// world; axes of any length are normalised.
///
/// # Errors
/// Says what is wrong with the pose: not finite, a zero axis, skewed or mirrored.
pub(super) fn place(
    intrinsics: Camera,
    [right, down, forward]: [[f64; 3]; 3],
    position: [f64; 3],
) -> Result<Camera, String> {
    if ![right, down, forward, position]
        .iter()
        .flatten()
        .all(|v| v.is_finite())
    {
        return Err("a pose with NaN or infinity".into());
    }
    let unit = |axis: [f64; 3]| {
        let length = dot(axis, axis).sqrt();
        (length > 1e-12 && length.is_finite()).then(|| axis.map(|v| v / length))
    };
    let (Some(right), Some(down), Some(forward)) = (unit(right), unit(down), unit(forward)) else {
        return Err("a rotation with a column of zeros".into());
    };
    let skew = [dot(right, down), dot(down, forward), dot(forward, right)]
        .into_iter()
        .fold(0.0, |worst: f64, cosine| worst.max(cosine.abs()));
    if skew > SKEW_TOLERANCE {
        return Err(format!(
            "a rotation whose axes are not perpendicular (cosine {skew:.3})"
        ));
    }
    let cross = [
        right[1] * down[2] - right[2] * down[1],
        right[2] * down[0] - right[0] * down[2],
        right[0] * down[1] - right[1] * down[0],
    ];
    if dot(cross, forward) < 0.0 {
        return Err("a mirrored rotation (determinant -1)".into());
    }
    let rows = [0, 1, 2].map(|row| [right[row], down[row], forward[row]]);
    Ok(intrinsics.placed(rows, position))
}

/// Whether two cameras stand at the same place and look the same way.
pub(super) fn same_pose(a: &Camera, b: &Camera) -> bool {
    let close = |(x, y): (&f64, &f64)| (x - y).abs() <= SAME_POSE;
    a.translation.iter().zip(&b.translation).all(close)
        && a.rotation
            .iter()
            .flatten()
            .zip(b.rotation.iter().flatten())
            .all(close)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn broken_poses_are_told_apart() {
        let camera = || Camera::new(1.0, 1.0, 0.5, 0.5, 1, 1);
        let (x, y, z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        assert_eq!(
            place(camera(), [x, [0.0, 3.0, 0.0], z], [0.0; 3]),
            Ok(camera())
        );
        for (axes, position, word) in [
            ([x, y, [0.0, 0.0, f64::NAN]], [0.0; 3], "NaN"),
            ([x, y, z], [f64::INFINITY, 0.0, 0.0], "infinity"),
            ([x, y, [0.0; 3]], [0.0; 3], "zeros"),
            ([x, [0.1, 1.0, 0.0], z], [0.0; 3], "perpendicular"),
            ([x, y, [0.0, 0.0, -1.0]], [0.0; 3], "mirrored"),
        ] {
            let error = place(camera(), axes, position).expect_err(word);
            assert!(error.contains(word), "{error}");
        }
    }
}
