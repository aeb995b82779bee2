//! Upright copies of image files, at their own or a smaller size.

use std::path::Path;

use image::{ExtendedColorType, save_buffer};

use super::decode::decode_upright;
use crate::Error;

/// Writes the image `from`, turned upright, to the PNG file `to`, at its own size or a smaller one; there each pixel is
/// the mean of the area it covers.
///
/// # Errors
/// When `from` is damaged or `to` can't be written.
pub(crate) fn write_upright(from: &Path, to: &Path, size: Option<[usize; 2]>) -> Result<(), Error> {
    let mut image = decode_upright(from)?;
    if let Some([width, height]) = size {
        image = image.resized(width, height);
    }
    let color = if image.has_alpha() {
        ExtendedColorType::Rgba8
    } else {
        ExtendedColorType::Rgb8
    };
    let [width, height] = [image.width, image.height].map(|side| side as u32);
    save_buffer(to, &image.pixels, width, height, color).map_err(|e| match e {
        image::ImageError::IoError(source) => Error::access(to)(source),
        other => Error::image_decode(to, other),
    })
}
