//! The pixels of a view: in memory, or in the store.

use std::sync::Arc;

use super::store::FrameStore;
use crate::Error;
use crate::dataset::pixels::image::ImageData;

/// The pixels of a view.
#[derive(Debug, Clone)]
pub(crate) enum Pixels {
    /// In memory.
    Ready(Arc<ImageData>),
    /// Made on demand.
    Stored {
        store: Arc<FrameStore>,
        index: usize,
    },
}

impl Pixels {
    /// The place in the store, where they are in one.
    pub(crate) fn place(&self) -> Option<usize> {
        match self {
            Self::Ready(_) => None,
            Self::Stored { index, .. } => Some(*index),
        }
    }

    pub(crate) fn get(&self) -> Result<Arc<ImageData>, Error> {
        match self {
            Self::Ready(image) => Ok(image.clone()),
            Self::Stored { store, index } => store.get(*index),
        }
    }
}
