//! Images at another size than the one that their poses were made for.

use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use super::decode::{dimensions, turned};
use super::scale::{has_shape_of, is_scaled};
use crate::Error;

/// The images of one dataset so far: how many are at another size.
#[derive(Debug, Default)]
pub(crate) struct Sizes {
    n_images: usize,
    n_other: usize,
    /// An image of another size, that and the poses' size.
    example: Option<(PathBuf, [(usize, usize); 2])>,
    /// The same of an image that no one factor brings to the poses' size.
    stretched: Option<(PathBuf, [(usize, usize); 2])>,
}

impl Sizes {
    /// The camera at the image's size, if one factor scales both sides; else unchanged, an error when the image is
    /// decoded.
    pub(crate) fn fit(&mut self, camera: Camera, image: &Path) -> Camera {
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

    /// [`resized`], and keeps in mind that a factor for each side was needed.
    pub(crate) fn resized(
        &mut self,
        camera: &Camera,
        size: (usize, usize),
        path: &Path,
        posed_by: &Path,
    ) -> Result<Camera, Error> {
        let fitted = resized(camera, size, path, posed_by)?;
        let stated = (camera.width, camera.height);
        if !is_scaled(stated, size) {
            self.stretched
                .get_or_insert_with(|| (path.to_path_buf(), [size, stated]));
        }
        Ok(fitted)
    }

    /// Warns of images whose sides were scaled by two factors.
    pub(crate) fn warn_of_stretched(&self) {
        if let Some((path, [found, stated])) = &self.stretched {
            tracing::warn!(
                "{}: {}x{}, and its pose is of {}x{}, another shape: taken as stretched; if it was cropped, correct the \
                 size and the principal point of the poses",
                path.display(),
                found.0,
                found.1,
                stated.0,
                stated.1
            );
        }
    }

    /// Warns of images at another size than `posed_by` says.
    pub(crate) fn warn(&self, posed_by: &Path) {
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

/// The camera at another size of nearly the same shape; errors name the image `path` and the poses' file.
fn resized(
    camera: &Camera,
    (width, height): (usize, usize),
    path: &Path,
    posed_by: &Path,
) -> Result<Camera, Error> {
    if !has_shape_of(camera, (width, height)) {
        let posed_by = posed_by.file_name().unwrap_or(posed_by.as_os_str());
        let turned = if has_shape_of(camera, (height, width)) {
            turned(path)
        } else {
            String::new()
        };
        return Err(Error::invalid(
            path,
            format!(
                "frames shaped like the {}x{} of {}",
                camera.width,
                camera.height,
                posed_by.to_string_lossy()
            ),
            format!("{width}x{height}{turned}"),
            "use uncropped frames, or correct height, width and focal length in the poses",
        ));
    }
    Ok(camera.resized(width, height))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_of_nearly_the_same_shape_are_remembered() {
        let camera = Camera::new(900.0, 900.0, 960.0, 540.0, 1920, 1080);
        let stretched = |size: (usize, usize)| {
            let mut sizes = Sizes::default();
            let fitted = sizes.resized(&camera, size, Path::new("a.png"), Path::new("p.npy"))?;
            assert_eq!((fitted.width, fitted.height), size);
            Ok::<bool, Error>(sizes.stretched.is_some())
        };
        for (size, expected) in [
            ((1920, 1080), false),
            ((960, 540), false),
            ((501, 282), false),
            ((1920, 1088), true),
            ((1910, 1080), true),
        ] {
            assert_eq!(
                stretched(size).expect("nearly the same"),
                expected,
                "{size:?}"
            );
        }
        stretched((1080, 1920)).expect_err("turned");
    }
}
