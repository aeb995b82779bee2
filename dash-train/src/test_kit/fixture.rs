//! A folder with files for one test.

use std::fs;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

/// Size of the fixtures' images.
pub(crate) const W: usize = 8;
pub(crate) const H: usize = 6;

/// A folder that is removed at the end of the test.
pub(crate) struct Fixture(TempDir);

impl Fixture {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().expect("temporary folder"))
    }

    pub(crate) fn root(&self) -> &Path {
        self.0.path()
    }

    /// A path below the root, whose folder is there.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        let path = self.root().join(name);
        fs::create_dir_all(path.parent().expect("below the root")).expect("folders");
        path
    }

    /// Writes a file and returns its path.
    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, bytes).expect("fixture file");
        path
    }

    pub(crate) fn remove(&self, name: &str) {
        fs::remove_file(self.root().join(name)).expect("fixture file");
    }

    /// An RGB image of one shade.
    pub(crate) fn image(&self, name: &str, width: usize, height: usize, shade: [u8; 3]) {
        image::RgbImage::from_pixel(width as u32, height as u32, image::Rgb(shade))
            .save(self.path(name))
            .expect("fixture image");
    }
}
