//! Images and videos that cannot be read: an error, or left out where the user asked for that.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use super::DatasetError;
use super::decode::dimensions;
use super::plan::Context;

/// What could be read of what is named, in order; with `skip_broken`, without what could not: each is noted in
/// `broken`, or named in a warning where there is no such list.
///
/// # Errors
/// The first reason, when something could not be read and is not to be skipped, or nothing is left.
pub(super) fn keep_readable<T>(
    results: Vec<(String, Result<T, DatasetError>)>,
    skip_broken: bool,
    broken: Option<&Mutex<Vec<DatasetError>>>,
) -> Result<Vec<Option<T>>, DatasetError> {
    let mut first_error = None;
    let mut n_kept = 0;
    let mut kept = Vec::with_capacity(results.len());
    for (name, result) in results {
        kept.push(match result {
            Ok(value) => {
                n_kept += 1;
                Some(value)
            }
            Err(error) if !skip_broken => return Err(error),
            Err(error) => {
                if let Some(broken) = broken {
                    note(broken, error);
                } else {
                    tracing::warn!("left out {name}: {error}");
                    first_error.get_or_insert(error);
                }
                None
            }
        });
    }
    match first_error {
        Some(error) if n_kept == 0 => Err(error),
        _ => Ok(kept),
    }
}

/// What could be read of what is named; `None` where it is left out, which is noted or said as in
/// [`keep_readable`].
///
/// # Errors
/// The reason, when it is not to be skipped.
pub(super) fn readable<T>(
    context: &Context,
    name: &str,
    result: Result<T, DatasetError>,
) -> Result<Option<T>, DatasetError> {
    match (result, &context.broken) {
        (Ok(value), _) => Ok(Some(value)),
        (Err(error), _) if !context.options.skip_broken => Err(error),
        (Err(error), Some(broken)) => {
            note(broken, error);
            Ok(None)
        }
        (Err(error), None) => {
            tracing::warn!("left out {name}: {error}");
            Ok(None)
        }
    }
}

/// Adds to what is broken.
pub(super) fn note(broken: &Mutex<Vec<DatasetError>>, error: DatasetError) {
    let mut broken = broken.lock().unwrap_or_else(PoisonError::into_inner);
    broken.push(error);
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
