//! Frames: how a view's image is made, held in memory or made on demand.
//!
//! A [`Recipe`] says where an image is and how it is processed on loading. If all images of a dataset
//! fit the memory budget, they are decoded at once ([`Pixels::Ready`]). Otherwise a [`FrameStore`]
//! decodes them on demand, ahead of time in the order that the trainer announces. Both give the same
//! pixels.

mod batch;
mod groups;
mod handle;
mod memory;
mod recipe;
mod store;
#[cfg(test)]
mod tests;

pub(crate) use batch::{make_all, salvage};
pub(crate) use handle::Pixels;
pub(crate) use memory::{bytes_in_words, default_budget};
pub(crate) use recipe::{Recipe, Source, check_size};
pub use store::FrameStatistics;
pub(crate) use store::FrameStore;
