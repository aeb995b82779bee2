//! Real and simulated captures.

use std::path::PathBuf;

/// Names the folder of the captures.
const VARIABLE: &str = "DASH_TEST_DATA";

/// The path of a capture; `None` where `DASH_TEST_DATA` is not set.
///
/// # Panics
/// When the variable is set and the capture is missing.
pub(crate) fn real_capture(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(std::env::var_os(VARIABLE)?).join(name);
    assert!(path.exists(), "{VARIABLE}: {} is missing", path.display());
    Some(path)
}
