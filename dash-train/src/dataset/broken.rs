//! Images that cannot be read: an error, or left out where the user asked for that.

use std::path::Path;

use rayon::prelude::*;

use super::DatasetError;
use super::image::dimensions;
use super::view::{Context, PlannedView};

/// The views whose image has a readable header, in order; all of them unless `skip_broken` is set.
/// Each view that is left out is named in a warning.
///
/// # Errors
/// When no view is left, the first one's reason.
pub(super) fn leave_out(
    context: &Context,
    planned: Vec<PlannedView>,
) -> Result<Vec<PlannedView>, DatasetError> {
    if !context.options.skip_broken {
        return Ok(planned);
    }
    let errors: Vec<Option<DatasetError>> = planned
        .par_iter()
        .map(|view| dimensions(&view.file).err())
        .collect();
    let mut kept = Vec::with_capacity(planned.len());
    let mut first_error = None;
    for (view, error) in planned.into_iter().zip(errors) {
        let Some(error) = error else {
            kept.push(view);
            continue;
        };
        tracing::warn!("left out the view {}: {error}", view.name);
        first_error.get_or_insert(error);
    }
    match first_error {
        Some(error) if kept.is_empty() => Err(error),
        _ => Ok(kept),
    }
}

/// Refuses a dataset of which nothing is left.
pub(super) fn check_any(listed_in: &Path, any: bool) -> Result<(), DatasetError> {
    if any {
        return Ok(());
    }
    Err(DatasetError::invalid(
        listed_in,
        "at least one readable image",
        "none",
        "put the images there, or write them again",
    ))
}

/// The size of the first of a camera's images; with `skip_broken`, of the first readable one.
///
/// # Errors
/// The first image's reason when it, or with `skip_broken` every one, is unreadable.
pub(super) fn first_size<'a>(
    context: &Context,
    mut files: impl Iterator<Item = &'a Path>,
) -> Option<Result<(usize, usize), DatasetError>> {
    let first = dimensions(files.next()?);
    if first.is_ok() || !context.options.skip_broken {
        return Some(first);
    }
    Some(
        files
            .find_map(|file| dimensions(file).ok())
            .map_or(first, Ok),
    )
}
