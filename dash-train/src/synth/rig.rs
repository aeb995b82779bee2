//! Cameras in front of the room.

use dash_kernels::Camera;

/// The point all cameras look at.
const TARGET_M: [f64; 3] = [0.0, 0.82, -0.35];
/// Distance of the cameras from it.
const DISTANCE_M: f64 = 4.2;
/// Outermost cameras are this far to either side.
const HALF_SPAN_RADIANS: f64 = 0.52;
/// The two heights of the outer cameras; camera 0 is between them.
const HEIGHTS_M: [f64; 2] = [1.15, 1.95];
/// Largest half field of view, horizontally and vertically: the room fills the picture.
const HALF_FOV_RADIANS: [f64; 2] = [0.436, 0.337];

/// Focal length in pixels at a picture size: the room fills the picture at any aspect ratio.
pub fn focal_px(width: usize, height: usize) -> f64 {
    let [across, down] = HALF_FOV_RADIANS;
    (0.5 * width as f64 / across.tan()).max(0.5 * height as f64 / down.tan())
}

/// `cameras` views of the room.
///
/// Camera 0 is in the middle and between the two heights, inside the span of the others, which
/// zigzag along an arc from left to right.
pub fn rig(cameras: usize, width: usize, height: usize) -> Vec<Camera> {
    let focal = focal_px(width, height);
    let place = |angle: f64, eye_height: f64| {
        let eye = [
            TARGET_M[0] + DISTANCE_M * angle.sin(),
            eye_height,
            TARGET_M[2] + DISTANCE_M * angle.cos(),
        ];
        Camera::new(
            focal,
            focal,
            0.5 * width as f64,
            0.5 * height as f64,
            width,
            height,
        )
        .look_at(eye, TARGET_M, [0.0, 1.0, 0.0])
    };
    let others = cameras.saturating_sub(1);
    let mut views = Vec::with_capacity(cameras);
    if cameras > 0 {
        views.push(place(0.0, 0.5 * (HEIGHTS_M[0] + HEIGHTS_M[1])));
    }
    for i in 0..others {
        // A single other camera stands on the right end.
        let along = if others == 1 {
            1.0
        } else {
            i as f64 / (others - 1) as f64
        };
        views.push(place(
            HALF_SPAN_RADIANS * (2.0 * along - 1.0),
            HEIGHTS_M[i % 2],
        ));
    }
    views
}
