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

/// Whether both sides are those of the other size times one factor, each rounded to a neighbouring number.
fn is_scaled(from: (usize, usize), to: (usize, usize)) -> bool {
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
}
