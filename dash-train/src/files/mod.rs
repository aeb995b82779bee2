//! The files of a user's dataset: names, listings, first bytes, and what is wrong with them.
//!
//! | file | what |
//! | --- | --- |
//! | `names.rs`, `order.rs`, `folder.rs` | order, numbers and extensions of names; whether the order is sure; listings |
//! | `unicode.rs` | letters in one piece or in two |
//! | `inside.rs`, `find_image.rs` | from a path that a file lists to the file that is meant |
//! | `claim.rs`, `free_output.rs` | folders to write into |
//! | `first_bytes.rs` | byte order marks, Git LFS pointers |

mod claim;
mod find_image;
mod first_bytes;
mod folder;
mod free_output;
mod inside;
mod names;
mod order;
mod unicode;

pub(crate) use claim::{claim, read_owner, write_owner};
pub(crate) use find_image::find_image;
pub(crate) use first_bytes::{parse_json, refuse_pointer, refuse_pointer_file, without_mark};
pub(crate) use folder::{is_occupied, list, list_images, require_folder, unread_images};
pub(crate) use free_output::free_parent;
pub(crate) use inside::confined;
pub(crate) use names::{
    IMAGE_EXTENSIONS, VIDEO_EXTENSIONS, frame_numbers, has_extension, natural_cmp, stem,
};
pub(crate) use order::{Order, check_order, order};
pub(crate) use unicode::{in_either_form, one_form};
