//! Whether an image file can hold the pixels that its header announces.
//!
//! A decoder makes room for a whole image before it reads the first pixel, so a damaged header of a few
//! bytes could ask for a gigabyte.

use std::io::Cursor;

use image::{ImageFormat, ImageReader};

/// Deflate's largest compression: 258 bytes in two bits.
const PNG_BYTES_PER_BYTE: u128 = 1032;
/// JPEG spends at least a bit on every block of 8x8 samples; the sparsest usual sampling (4:1:0, 18
/// blocks on 32x32 pixels) then holds 1365 bytes of RGB in one.
const JPEG_BYTES_PER_BYTE: u128 = 2048;
/// Room for images of a few pixels, whose files are mostly header.
const SMALL_BYTES: u128 = 1 << 16;

/// Whether a file of this format can be as large as it says; `true` for headers that can't be read,
/// which decoders refuse.
pub(crate) fn can_hold_its_pixels(bytes: &[u8], format: ImageFormat) -> bool {
    let (pixel_bytes, per_byte) = match format {
        ImageFormat::Png => (png_bytes(bytes), PNG_BYTES_PER_BYTE),
        _ => (jpeg_bytes(bytes), JPEG_BYTES_PER_BYTE),
    };
    pixel_bytes.is_none_or(|needed| needed <= SMALL_BYTES + per_byte * bytes.len() as u128)
}

/// Bytes of the uncompressed samples, from the header chunk that every PNG starts with.
fn png_bytes(bytes: &[u8]) -> Option<u128> {
    let number = |at: usize| {
        let field = bytes.get(at..)?.first_chunk()?;
        Some(u128::from(u32::from_be_bytes(*field)))
    };
    let (width, height) = (number(16)?, number(20)?);
    let channels = match bytes.get(25)? {
        2 => 3,
        4 => 2,
        6 => 4,
        _ => 1,
    };
    let bits = width * height * channels * u128::from(*bytes.get(24)?);
    Some(bits / 8)
}

fn jpeg_bytes(bytes: &[u8]) -> Option<u128> {
    let reader = ImageReader::with_format(Cursor::new(bytes), ImageFormat::Jpeg);
    let (width, height) = reader.into_dimensions().ok()?;
    Some(u128::from(width) * u128::from(height) * 3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::DynamicImage;

    #[test]
    fn the_most_compressible_images_pass_and_false_claims_do_not() {
        for format in [ImageFormat::Png, ImageFormat::Jpeg] {
            for blank in [
                DynamicImage::new_rgb8(3000, 2000),
                DynamicImage::new_luma8(3000, 2000),
            ] {
                let mut file = Cursor::new(Vec::new());
                blank.write_to(&mut file, format).expect("encodes");
                let bytes = file.into_inner();
                assert!(can_hold_its_pixels(&bytes, format), "{format:?}");
                // The header alone, with the size it had.
                assert!(!can_hold_its_pixels(&bytes[..700], format), "{format:?}");
            }
            assert!(can_hold_its_pixels(b"", format));
        }
    }
}
