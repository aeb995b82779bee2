//! The backdrop of a run on disk: `RUN/backdrop.json`, beside the other run that `config.toml` names.

use std::fs;
use std::io::Write;
use std::path::PathBuf;

use burn::tensor::Device;
use dash_model::DynamicScene;
use dash_model::scene_file::write_atomically;

use super::RunFolder;
use crate::Error;
use crate::train::core::{Backdrop, Kept};
use crate::train::trainer::other_backdrop;

impl RunFolder {
    /// The scene of the run that is this one's backdrop, if it has one.
    ///
    /// # Errors
    /// When that can't be read.
    pub(super) fn room(&self, device: &Device) -> Result<Option<DynamicScene>, Error> {
        let Some(room) = self.config()?.data.backdrop else {
            return Ok(None);
        };
        // A relative path is one from this folder.
        let room = self.root().join(room);
        if room.canonicalize().ok() == self.root().canonicalize().ok() {
            return Err(Error::run(
                self.root(),
                "expected another run as data.backdrop in config.toml, found this one",
            ));
        }
        Self::open(&room)?.scene(device).map(Some)
    }

    /// Writes down what is kept of the backdrop.
    pub(super) fn write_kept(&self, backdrop: &Backdrop) -> Result<(), Error> {
        let json = serde_json::to_vec(backdrop.kept()).map_err(|e| Error::Config(e.to_string()))?;
        Ok(write_atomically(&self.kept_path(), |mut file| {
            file.write_all(&json)
        })?)
    }

    /// The run's own scene with its backdrop, of which `room` is the scene.
    pub(super) fn with_backdrop(
        &self,
        own: DynamicScene,
        room: &DynamicScene,
        device: &Device,
    ) -> Result<DynamicScene, Error> {
        let path = self.kept_path();
        let json = fs::read(&path).map_err(|e| Error::io(&path, "read", e))?;
        let kept: Kept = serde_json::from_slice(&json).map_err(|e| {
            let told =
                format!("expected what the run keeps of its backdrop, found {e}; train it anew");
            Error::run(&path, told)
        })?;
        let backdrop = Backdrop::new(room, kept, device);
        let backdrop = backdrop.map_err(|found| other_backdrop(self.root(), &found))?;
        Ok(backdrop.with(&own))
    }

    fn kept_path(&self) -> PathBuf {
        self.root().join("backdrop.json")
    }
}
