//! Pixels: decoding, sizes, masks, lenses, and the frame store.
//!
//! | file | what |
//! | --- | --- |
//! | `decode.rs`, `image_size.rs` | PNG and JPEG files, whole and of a sensible size |
//! | `image.rs`, `shrink.rs` | images in memory, and smaller ones |
//! | `distortion.rs`, `lens.rs` | lens distortion, and its removal |
//! | `masks.rs`, `mask_file.rs` | masks of the pixels that count, and their files |
//! | `scale.rs`, `sizes.rs` | images at another size than their poses state |
//! | `frames/` | how each view's image is made, all at once or on demand within a budget |

pub(crate) mod decode;
pub(crate) mod distortion;
pub(crate) mod frames;
pub(crate) mod image;
mod image_size;
pub(crate) mod lens;
mod mask_file;
pub(crate) mod masks;
pub(crate) mod scale;
pub(crate) mod shrink;
pub(crate) mod sizes;

pub(crate) use decode::{MAX_IMAGE_SIDE, dimensions};
pub(crate) use mask_file::decode_mask;
