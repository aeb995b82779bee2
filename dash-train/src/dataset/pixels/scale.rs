//! Whether one factor brings a size to another.

use dash_kernels::Camera;

/// Frames may differ from the poses' aspect ratio by this much and one pixel.
const ASPECT_TOLERANCE: f64 = 0.01;
/// A principal point is near the middle if its double is the image's side up to this share.
const NEAR_MIDDLE: f64 = 0.2;
/// One factor explains both sides up to this share, since principal points are not quite in the middle.
const ONE_FACTOR: f64 = 0.1;
/// Images are mostly downscaled by whole factors: a factor is rounded if it is whole up to this share.
const WHOLE: f64 = 0.05;

/// Whether a principal point lies in the middle half of images of this size. If not, the intrinsics belong to
/// another size.
pub(crate) fn is_in_the_middle([cx, cy]: [f64; 2], (width, height): (usize, usize)) -> bool {
    let is_near = |at: f64, side: usize| (at / side as f64 - 0.5).abs() <= 0.25;
    is_near(cx, width) && is_near(cy, height)
}

/// By how much the images of the intrinsics were larger than this size, judged by the principal point: 1 if it is
/// near the middle, `None` if no one factor explains both coordinates.
pub(crate) fn times_larger([cx, cy]: [f64; 2], (width, height): (usize, usize)) -> Option<f64> {
    let (x, y) = (2.0 * cx / width as f64, 2.0 * cy / height as f64);
    if (x - 1.0).abs() <= NEAR_MIDDLE && (y - 1.0).abs() <= NEAR_MIDDLE {
        return Some(1.0);
    }
    let times = (x * y).sqrt();
    if !(x > 0.0 && times.is_finite() && (y / x - 1.0).abs() <= ONE_FACTOR) {
        return None;
    }
    let whole = match times >= 1.0 {
        true => times.round(),
        false => 1.0 / (1.0 / times).round(),
    };
    let is_whole = (times / whole - 1.0).abs() <= WHOLE;
    Some(if is_whole { whole } else { times })
}

/// Whether one factor scales both sides, each rounded up or down.
pub(crate) fn is_scaled(from: (usize, usize), to: (usize, usize)) -> bool {
    let range = |from: usize, to: usize| {
        let (from, to) = (from as f64, to as f64);
        [(to - 1.0) / from, (to + 1.0) / from]
    };
    let (x, y) = (range(from.0, to.0), range(from.1, to.1));
    x[0] < y[1] && y[0] < x[1]
}

/// Whether pictures of this size are shaped like the camera's.
pub(crate) fn has_shape_of(camera: &Camera, (width, height): (usize, usize)) -> bool {
    let expected_height = width as f64 * camera.height as f64 / camera.width as f64;
    (height as f64 - expected_height).abs() <= 1.0 + ASPECT_TOLERANCE * expected_height
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_scaled_where_a_rounded_factor_explains_them() {
        let stated = (1920, 1080);
        for size in [
            (960, 540),
            (1919, 1080),
            (640, 360),
            (1000, 562),
            (1000, 563),
        ] {
            assert!(is_scaled(stated, size), "{size:?}");
        }
        for size in [(1080, 1920), (1900, 1080), (960, 545), (1920, 1078)] {
            assert!(!is_scaled(stated, size), "{size:?}");
        }
        assert!(is_scaled((96, 72), (95, 72)));
    }

    #[test]
    fn principal_points_tell_of_which_size_pictures_are() {
        let size = (320, 240);
        for (principal_point, expected) in [
            ([160.0, 120.0], Some(1.0)),
            ([190.0, 98.0], Some(1.0)),
            // Somewhat off the middle of pictures twice, four times and half as large.
            ([320.0, 240.0], Some(2.0)),
            ([331.0, 233.0], Some(2.0)),
            ([640.0, 480.0], Some(4.0)),
            ([80.0, 61.0], Some(0.5)),
            ([240.0, 180.0], Some(1.5)),
            // Of another shape, turned, no principal points.
            ([320.0, 180.0], None),
            ([120.0, 160.0], None),
            ([-160.0, -120.0], None),
            ([0.0, 0.0], None),
            ([f64::NAN, 120.0], None),
            ([f64::INFINITY, f64::INFINITY], None),
        ] {
            assert_eq!(
                times_larger(principal_point, size),
                expected,
                "{principal_point:?}"
            );
        }
        assert!(is_in_the_middle([81.0, 179.0], size));
        for outside in [[79.0, 120.0], [160.0, 181.0], [f64::NAN, 120.0]] {
            assert!(!is_in_the_middle(outside, size), "{outside:?}");
        }
    }
}
