//! Images and videos that cannot be read: an error, or left out with `--skip-broken`.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use super::pixels::dimensions;
use crate::Error;

/// What becomes of images and videos that cannot be read.
#[derive(Debug)]
pub(crate) struct Broken {
    /// Whether they are left out; otherwise the first one stops the loading.
    skip: bool,
    /// The errors of those left out; `None` warns of each instead.
    noted: Option<Mutex<Vec<Error>>>,
}

impl Broken {
    /// Stops at the first broken file, or with `skip` warns and leaves it out.
    pub(crate) fn stop_or_warn(skip: bool) -> Self {
        Self { skip, noted: None }
    }

    /// Leaves broken files out and keeps their errors.
    pub(crate) fn note_all() -> Self {
        Self {
            skip: true,
            noted: Some(Mutex::default()),
        }
    }

    /// Whether errors are kept. The caller then looks at every image itself.
    pub(crate) fn is_noted(&self) -> bool {
        self.noted.is_some()
    }

    /// Keeps an error, where errors are kept.
    pub(crate) fn note(&self, error: Error) {
        if let Some(noted) = &self.noted {
            noted
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .push(error);
        }
    }

    /// The errors sorted by message: threads decode in any order.
    pub(crate) fn into_noted(self) -> Vec<Error> {
        let noted = self.noted.unwrap_or_default().into_inner();
        let mut noted = noted.unwrap_or_else(PoisonError::into_inner);
        noted.sort_by_key(ToString::to_string);
        noted
    }

    /// The readable ones of named results, in order; `None` for those left out.
    ///
    /// # Errors
    /// The first error, unless broken files are left out and something remains.
    pub(crate) fn keep_readable<T>(
        &self,
        results: Vec<(String, Result<T, Error>)>,
    ) -> Result<Vec<Option<T>>, Error> {
        let mut first_error = None;
        let mut n_kept = 0;
        let mut kept = Vec::with_capacity(results.len());
        for (name, result) in results {
            kept.push(match result {
                Ok(value) => {
                    n_kept += 1;
                    Some(value)
                }
                Err(error) if !self.skip => return Err(error),
                Err(error) if self.is_noted() => {
                    self.note(error);
                    None
                }
                Err(error) => {
                    tracing::warn!("left out {name}: {error}");
                    first_error.get_or_insert(error);
                    None
                }
            });
        }
        match first_error {
            Some(error) if n_kept == 0 => Err(error),
            _ => Ok(kept),
        }
    }

    /// A named result; `None` where it is left out.
    ///
    /// # Errors
    /// Its error, unless broken files are left out.
    pub(crate) fn readable<T>(
        &self,
        name: &str,
        result: Result<T, Error>,
    ) -> Result<Option<T>, Error> {
        match result {
            Ok(value) => Ok(Some(value)),
            Err(error) if !self.skip => Err(error),
            Err(error) if self.is_noted() => {
                self.note(error);
                Ok(None)
            }
            Err(error) => {
                tracing::warn!("left out {name}: {error}");
                Ok(None)
            }
        }
    }

    /// The size of a camera's first image; of the first readable one where broken files are left out.
    ///
    /// # Errors
    /// The first image's error, where no size is known.
    pub(crate) fn first_size<'a>(
        &self,
        mut files: impl Iterator<Item = &'a Path>,
    ) -> Option<Result<(usize, usize), Error>> {
        let first = dimensions(files.next()?);
        if first.is_ok() || !self.skip {
            return Some(first);
        }
        Some(
            files
                .find_map(|file| dimensions(file).ok())
                .map_or(first, Ok),
        )
    }
}

/// Refuses a dataset of which nothing is left.
pub(crate) fn check_any(listed_in: &Path, any: bool) -> Result<(), Error> {
    if any {
        return Ok(());
    }
    Err(Error::invalid(
        listed_in,
        "at least one readable image",
        "none",
        "put the images there, or write them again",
    ))
}
