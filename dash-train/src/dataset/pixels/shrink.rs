//! Copies of image files at a smaller size.

use std::path::Path;

use image::{ExtendedColorType, save_buffer};

use super::decode::decode;
use crate::Error;

/// Writes the image `from` at a smaller size to the PNG file `to`; each pixel is the mean of the area
/// it covers.
///
/// # Errors
/// When `from` is damaged or `to` can't be written.
pub(crate) fn write_resized(
    from: &Path,
    to: &Path,
    [width, height]: [usize; 2],
) -> Result<(), Error> {
    let image = decode(from)?.resized(width, height);
    let color = if image.has_alpha() {
        ExtendedColorType::Rgba8
    } else {
        ExtendedColorType::Rgb8
    };
    save_buffer(to, &image.pixels, width as u32, height as u32, color).map_err(|e| match e {
        image::ImageError::IoError(source) => Error::access(to)(source),
        other => Error::image_decode(to, other),
    })
}
