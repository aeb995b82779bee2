//! What the tests across crates share.

use std::path::{Path, PathBuf};

/// A file or folder of the test data, which is not part of the repository: below the folder that the variable
/// `DASH_TEST_DATA` names. `None` without the variable.
///
/// # Panics
/// When the variable is set and the data is missing.
pub fn test_data(name: &str) -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("DASH_TEST_DATA") else {
        eprintln!("DASH_TEST_DATA is not set: {name} is not tried");
        return None;
    };
    let path = Path::new(&folder).join(name);
    assert!(
        path.exists(),
        "{}: not there; DASH_TEST_DATA must name the folder of the test data",
        path.display()
    );
    Some(path)
}
