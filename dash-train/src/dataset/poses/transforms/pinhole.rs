//! Focal lengths and principal points of `transforms*.json`.

use std::f64::consts::PI;

use super::Intrinsics;
use crate::dataset::poses::intrinsics::{Wrong, check_finite};

/// Focal lengths and principal point for images of this size, or what was expected and found.
pub(super) fn pinhole(
    own: &Intrinsics,
    shared: &Intrinsics,
    [w, h]: [f64; 2],
) -> Result<[f64; 4], Wrong> {
    let from_angle = |angle: Option<f64>, side: f64| angle.map(|a| 0.5 * side / (0.5 * a).tan());
    let angle_x = |i: &Intrinsics| i.camera_angle_x.or(i.x_fov.map(f64::to_radians));
    let angle_y = |i: &Intrinsics| i.camera_angle_y.or(i.y_fov.map(f64::to_radians));
    let focal = |i: &Intrinsics| i.fl_x.or(from_angle(angle_x(i), w));
    let from_height = |i: &Intrinsics| i.fl_y.or(from_angle(angle_y(i), h));
    let of_height = || from_height(own).or(from_height(shared));
    for i in [own, shared] {
        // What is not needed beside a focal length may be anything.
        let lengths_x = own.fl_x.or(i.fl_x);
        let lengths_y = own.fl_y.or(i.fl_y).or(lengths_x);
        for (length, angle, degrees) in [
            (lengths_x, i.camera_angle_x, i.x_fov),
            (lengths_y, i.camera_angle_y, i.y_fov),
        ] {
            if length.is_some() {
                continue;
            }
            let (radians, expected) = match (angle, degrees) {
                (Some(angle), _) => (
                    angle,
                    "`camera_angle_x` and `camera_angle_y` in radians, below pi",
                ),
                (None, Some(degrees)) => (
                    degrees.to_radians(),
                    "`x_fov` and `y_fov` in degrees, below 180",
                ),
                (None, None) => continue,
            };
            if radians >= PI {
                return Err((
                    expected,
                    format!("{}", angle.or(degrees).unwrap_or(radians)),
                ));
            }
        }
    }
    let Some(fx) = focal(own).or(focal(shared)).or_else(of_height) else {
        let expected =
            "a focal length: `fl_x`, `camera_angle_x`, `camera_angle_y`, `x_fov` or `y_fov`";
        return Err((expected, "none of these".into()));
    };
    let focal_y = |i: &Intrinsics| {
        i.fl_y
            .or(i.fl_x)
            .or(from_angle(angle_y(i), h))
            .or(from_angle(angle_x(i), w))
    };
    let fy = focal_y(own).or(focal_y(shared)).unwrap_or(fx);
    let cx = own.cx.or(shared.cx).unwrap_or(w / 2.0);
    let cy = own.cy.or(shared.cy).unwrap_or(h / 2.0);
    check_finite([fx, fy], [cx, cy])?;
    Ok([fx, fy, cx, cy])
}
