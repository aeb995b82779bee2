//! Parts of the messages of an error.

use std::path::PathBuf;

/// What to try where cameras were not registered.
pub(super) const REGISTRATION_REMEDY: &str = "neighbouring cameras must share much of a textured picture: try \
     --lens shared if all cameras have the same lens, --start at a moment with more to see, remove these cameras, \
     add cameras between them and the others, or give known poses with --poses";

/// What to do where the system refused a file that was to be written.
pub(super) fn write_remedy(source: &std::io::Error) -> &'static str {
    match source.kind() {
        std::io::ErrorKind::NotFound | std::io::ErrorKind::PermissionDenied => {
            "check the folder and its permissions"
        }
        _ => dash_model::io_remedy(source),
    }
}

/// The cameras without a pose, unless that is all of them.
pub(super) fn not_found(missing: &[String], n_cameras: usize) -> String {
    if missing.len() == n_cameras {
        return String::new();
    }
    format!(", not of {}", missing.join(", "))
}

/// Paths in a row.
pub(super) fn list(files: &[PathBuf]) -> String {
    let names: Vec<String> = files
        .iter()
        .map(|file| file.display().to_string())
        .collect();
    names.join(", ")
}
