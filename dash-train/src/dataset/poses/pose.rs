//! From the axes of pose files to a camera.

use dash_kernels::Camera;

/// How far from perpendicular two axes may be (cosine).
const SKEW_TOLERANCE: f64 = 1e-3;
/// Poses this close belong to one camera,
const SAME_POSE: f64 = 1e-6;
/// and so are positions within this share of the largest distance between cameras along an axis.
const SAME_POSITION: f64 = 1e-5;

/// Places the intrinsics at `position` with the camera's `right`, `down` and `forward` axes in the
/// world; axes of any length are normalised.
///
/// # Errors
/// Says what is wrong with the pose: not finite, a zero axis, skewed or mirrored.
pub(crate) fn place(
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

/// Places the intrinsics at a world-to-camera pose: a quaternion (w, x, y, z) of any length and a
/// translation.
///
/// # Errors
/// Says what is wrong with the pose: zero or not finite.
pub(crate) fn place_by_quaternion(
    intrinsics: Camera,
    quaternion: [f64; 4],
    translation: [f64; 3],
) -> Result<Camera, String> {
    let norm = quaternion.iter().map(|v| v * v).sum::<f64>().sqrt();
    if !(norm > 1e-12 && norm.is_finite()) {
        return Err("a quaternion that is zero, NaN or infinite".into());
    }
    let [w, x, y, z] = quaternion.map(|v| v / norm);
    let rows = [
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
    ];
    let position = [0, 1, 2].map(|axis| {
        -(0..3)
            .map(|row| rows[row][axis] * translation[row])
            .sum::<f64>()
    });
    place(intrinsics, rows, position)
}

/// For each camera the index of its pose among the distinct ones, and their number.
pub(crate) fn distinct_poses<'a>(
    cameras: impl Iterator<Item = &'a Camera> + Clone,
) -> (Vec<usize>, usize) {
    let mut distinct: Vec<&Camera> = Vec::new();
    let extent = extent(cameras.clone());
    let indices = cameras
        .map(|camera| {
            let is_same = |seen: &&Camera| same_pose(seen, camera, extent);
            let known = distinct.iter().position(is_same);
            known.unwrap_or_else(|| {
                distinct.push(camera);
                distinct.len() - 1
            })
        })
        .collect();
    (indices, distinct.len())
}

/// The largest distance between cameras along an axis of the world.
pub(crate) fn extent<'a>(cameras: impl Iterator<Item = &'a Camera>) -> f64 {
    let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
    for camera in cameras {
        for (value, [low, high]) in camera.position().into_iter().zip(&mut bounds) {
            *low = low.min(value);
            *high = high.max(value);
        }
    }
    let sides = bounds.map(|[low, high]| high - low);
    sides.into_iter().fold(0.0, f64::max)
}

/// Whether two of the cameras of a rig of this `extent` stand at the same place and look the same way.
pub(crate) fn same_pose(a: &Camera, b: &Camera, extent: f64) -> bool {
    let close = |tolerance: f64| move |(x, y): (&f64, &f64)| (x - y).abs() <= tolerance;
    let rotations = a.rotation.iter().flatten().zip(b.rotation.iter().flatten());
    let mut translations = a.translation.iter().zip(&b.translation);
    translations.all(close(SAME_POSE.max(SAME_POSITION * extent)))
        && rotations.into_iter().all(close(SAME_POSE))
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

    #[test]
    fn poses_are_told_apart_in_the_rigs_own_unit() {
        let at = |x: f64| Camera {
            translation: [x, 0.0, 0.0],
            ..Camera::new(1.0, 1.0, 0.5, 0.5, 1, 1)
        };
        for (positions, expected) in [
            // Millimetres, with a hundredth of one between two readings.
            ([0.0, 0.01, 4000.0, 4000.01], vec![0, 0, 1, 1]),
            ([0.0, 1.0, 4000.0, 4001.0], vec![0, 1, 2, 3]),
            ([0.0, 5e-7, 1e-5, 1e-4], vec![0, 0, 1, 2]),
        ] {
            let cameras = positions.map(at);
            assert_eq!(distinct_poses(cameras.iter()).0, expected, "{positions:?}");
        }
    }
}
