//! What the fuzz targets share. A target is a parser of `dash_train::fuzzing` by name:
//!
//! ```text
//! DASH_FUZZ_CORPUS=$PWD/fuzz/corpus cargo test --release --workspace --test hostile corpus
//! fuzz/run all -runs=1000000 -malloc_limit_mb=64
//! ```
//!
//! The first line writes valid files as the corpus; the second needs a C++ compiler, but no nightly one.
//! `cargo +nightly fuzz run npy` works as well, and adds AddressSanitizer; Burn then takes an hour to
//! compile. The same parsers run without coverage in `dash-train/tests/hostile`.

use std::sync::OnceLock;

use tempfile::TempDir;

/// Runs the parser of this name; what it answers does not matter.
///
/// # Panics
/// When there is no such parser or no scratch folder.
pub fn parse(name: &str, bytes: &[u8]) {
    static SCRATCH: OnceLock<TempDir> = OnceLock::new();
    let scratch = SCRATCH.get_or_init(|| {
        tempfile::tempdir_in("/dev/shm")
            .or_else(|_| tempfile::tempdir())
            .expect("a scratch folder can be made")
    });
    let parser = dash_train::fuzzing::PARSERS
        .iter()
        .find(|parser| parser.name == name)
        .expect("targets are named after parsers");
    (parser.accepts)(scratch.path(), bytes);
}
