//! What can be done about a checkpoint that can't be read.

use std::io;
use std::path::Path;

use dash_model::ModelError;

use super::list;
use crate::Error;

/// The error with what can be done, where files of the checkpoint are damaged or missing; another one as it
/// is.
pub(crate) fn with_remedy(checkpoint: &Path, error: Error) -> Error {
    let is_missing = |path: &Path, source: &io::Error| {
        path.starts_with(checkpoint) && source.kind() == io::ErrorKind::NotFound
    };
    let (file, found) = match error {
        Error::Checkpoint { path, found } => (path, found),
        Error::Model(ModelError::Format {
            path,
            expected,
            found,
        }) => (path, format!("{found} instead of {expected}")),
        Error::Model(ModelError::Io { path, source, .. }) | Error::Io { path, source, .. }
            if is_missing(&path, &source) =>
        {
            (path, "no such file".into())
        }
        other => return other,
    };
    let found = match file.strip_prefix(checkpoint) {
        Ok(inside) if inside != Path::new("") => format!("{}: {found}", inside.display()),
        _ => found,
    };
    let path = checkpoint.to_path_buf();
    if has_older(checkpoint) {
        Error::Checkpoint { path, found }
    } else {
        let what = format!(
            "expected a complete checkpoint, found {found}; remove its folder to begin the run again"
        );
        Error::Run { path, what }
    }
}

/// Whether an older checkpoint lies beside it.
fn has_older(checkpoint: &Path) -> bool {
    let beside = checkpoint.parent().and_then(|folder| list(folder).ok());
    let oldest = beside.and_then(|complete| complete.into_iter().next());
    oldest.is_some_and(|oldest| oldest != checkpoint)
}
