//! Images at another size than the one that their poses were made for.

use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use super::decode::dimensions;

/// The images of one dataset so far: how many are at another size.
#[derive(Debug, Default)]
pub(super) struct Sizes {
    n_images: usize,
    n_other: usize,
    /// An image of another size, that and the poses' size.
    example: Option<(PathBuf, [(usize, usize); 2])>,
}

impl Sizes {
    /// The camera at the image's size where that is the camera's made larger or smaller; else as it is, which
    /// is an error when the image is made.
    pub(super) fn fit(&mut self, camera: Camera, image: &Path) -> Camera {
        self.n_images += 1;
        let stated = (camera.width, camera.height);
        match dimensions(image) {
            Ok(size) if size != stated && is_scaled(stated, size) => {
                self.n_other += 1;
                self.example
                    .get_or_insert_with(|| (image.to_path_buf(), [size, stated]));
                camera.resized(size.0, size.1)
            }
            _ => camera,
        }
    }

    /// Warns of images at another size than `posed_by` says.
    pub(super) fn warn(&self, posed_by: &Path) {
        if let Some((image, [found, stated])) = &self.example {
            tracing::warn!(
                "{}: {} of {} images have another size than it says ({} has {}x{} instead of {}x{}): focal \
                 lengths and principal points are scaled",
                posed_by.display(),
                self.n_other,
                self.n_images,
                image.display(),
                found.0,
                found.1,
                stated.0,
                stated.1
            );
        }
    }
}

/// Pictures whose middle a principal point lies near: their sides are its double up to this share.
const NEAR_MIDDLE: f64 = 0.2;
/// One factor explains both sides of a picture of another size up to this share, since principal points are not
/// quite in the middle.
const ONE_FACTOR: f64 = 0.1;
/// Pictures are mostly made smaller by whole numbers, which are taken where the factor is one up to this share.
const WHOLE: f64 = 0.05;

/// Whether a principal point lies in the middle half of pictures of this size. Elsewhere, intrinsics are of
/// pictures of another size.
pub(super) fn is_in_the_middle([cx, cy]: [f64; 2], (width, height): (usize, usize)) -> bool {
    let is_near = |at: f64, side: usize| (at / side as f64 - 0.5).abs() <= 0.25;
    is_near(cx, width) && is_near(cy, height)
}

/// How many times larger than pictures of this size those are in whose middle a principal point lies: 1 where it
/// lies near the middle of these; `None` where no one factor explains both coordinates.
pub(super) fn times_larger([cx, cy]: [f64; 2], (width, height): (usize, usize)) -> Option<f64> {
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

/// Whether both sides are those of the other size times one factor, each rounded to a neighbouring number.
pub(super) fn is_scaled(from: (usize, usize), to: (usize, usize)) -> bool {
    let range = |from: usize, to: usize| {
        let (from, to) = (from as f64, to as f64);
        [(to - 1.0) / from, (to + 1.0) / from]
    };
    let (x, y) = (range(from.0, to.0), range(from.1, to.1));
    x[0] < y[1] && y[0] < x[1]
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
