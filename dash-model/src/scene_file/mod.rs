//! A scene on disk: `scene.json` (structure and settings) and `scene.safetensors` (parameters).
//!
//! `docs/scene-format.md` describes the format. Tensors that are mostly zeros are stored without their rows of zeros:
//! `SET.sh_rest` beside the indices `SET.sh_rest.rows`, feature tables beside a bit mask (see `marks`).
//!
//! ```
//! use burn::tensor::Device;
//! use dash_model::scene_file::{TablePrecision, parameter_bytes};
//! # use dash_model::{DynamicScene, GaussianRows, Gaussians, SceneSettings};
//! # let device = Device::flex();
//! # let points = GaussianRows::from_points(&[[0.0; 3], [0.5; 3]], &[[0.8; 3]; 2], 0, 0.1);
//! # let static_set = Gaussians::from_rows(&points, &device);
//! # let scene = DynamicScene { static_set, dynamic: None, settings: SceneSettings::default() };
//! let folder = std::env::temp_dir().join(format!("dash-scene-{}", std::process::id()));
//! scene.save_with(&folder, TablePrecision::Half)?;
//! let loaded = DynamicScene::load(&folder, &device)?;
//! assert!(scene.stored_bytes(TablePrecision::Half) <= parameter_bytes(&scene));
//! assert_eq!(loaded.settings, scene.settings);
//! assert_eq!(loaded.static_set.to_rows(), points);
//! # std::fs::remove_dir_all(folder).expect("written above");
//! # Ok::<(), dash_model::ModelError>(())
//! ```

mod atomic;
mod description;
mod marks;
mod stored;
mod tensors;

use std::fs;
use std::io::Write;
use std::path::Path;

use burn::module::Module;
use burn::tensor::Device;
use stored::{is_table, join_decoder, stored, whole};
use tensors::{Stored, file_bytes, read_stored};

pub use atomic::write_atomically;
pub use tensors::{read_tensors, write_tensors};

use crate::parameters::{named_parameters, with_parameters};
use crate::unfinished::create_dir_all;
use crate::{DynamicScene, ModelError};
use description::SceneDescription;

/// The file of everything that is no tensor.
const DESCRIPTION: &str = "scene.json";
/// The file of the parameters.
const TENSORS: &str = "scene.safetensors";

/// How the feature tables of the deformation field are stored. All other tensors are f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TablePrecision {
    /// As f32.
    Single,
    /// As f16, rounded to the nearest; values beyond its range become the largest.
    Half,
}

impl DynamicScene {
    /// Writes the scene into a folder with f32 tables, see [`DynamicScene::save_with`].
    ///
    /// # Errors
    /// [`ModelError::Io`].
    pub fn save(&self, folder: &Path) -> Result<(), ModelError> {
        self.save_with(folder, TablePrecision::Single)
    }

    /// Writes the scene into a folder and creates it where it is missing. Each file is complete or absent.
    ///
    /// # Errors
    /// [`ModelError::Io`].
    pub fn save_with(&self, folder: &Path, precision: TablePrecision) -> Result<(), ModelError> {
        create_dir_all(folder).map_err(|e| ModelError::io(folder, "create the folder", e))?;
        let [json, tensors] = self.to_bytes(precision)?;
        for (name, bytes) in [(TENSORS, tensors), (DESCRIPTION, json)] {
            write_atomically(&folder.join(name), |mut file| file.write_all(&bytes))?;
        }
        Ok(())
    }

    /// The bytes of the scene's two files: the description (JSON) and the tensors.
    ///
    /// # Errors
    /// [`ModelError::Parameter`] when values do not fill a shape.
    pub fn to_bytes(&self, precision: TablePrecision) -> Result<[Vec<u8>; 2], ModelError> {
        let tensors = file_bytes(&stored(self, precision))?;
        Ok([SceneDescription::of(self).to_json(), tensors])
    }

    /// Reads a scene that [`DynamicScene::save`] wrote.
    ///
    /// # Errors
    /// [`ModelError::Io`], [`ModelError::Format`] or [`ModelError::Version`]; [`ModelError::Kernel`] when a table
    /// is too large for the device.
    pub fn load(folder: &Path, device: &Device) -> Result<Self, ModelError> {
        let paths = [DESCRIPTION, TENSORS].map(|name| folder.join(name));
        let read = |path: &Path| fs::read(path).map_err(|e| ModelError::io(path, "read", e));
        // A newer description says so before its tensors are read.
        let json = read(&paths[0])?;
        let description = SceneDescription::read(&json, &paths[0])?;
        Self::from_parts(
            &description,
            &read(&paths[1])?,
            [&paths[0], &paths[1]],
            device,
        )
    }

    /// Reads what [`DynamicScene::to_bytes`] returned. Errors name the files `scene.json` and `scene.safetensors`.
    ///
    /// # Errors
    /// As [`DynamicScene::load`], but for [`ModelError::Io`].
    pub fn from_bytes(json: &[u8], tensors: &[u8], device: &Device) -> Result<Self, ModelError> {
        let paths = [DESCRIPTION, TENSORS].map(Path::new);
        let description = SceneDescription::read(json, paths[0])?;
        Self::from_parts(&description, tensors, paths, device)
    }

    fn from_parts(
        description: &SceneDescription,
        tensors: &[u8],
        [json_path, path]: [&Path; 2],
        device: &Device,
    ) -> Result<Self, ModelError> {
        let mut parameters = whole(read_stored(tensors, path)?, path)?;
        description.check_rows(&parameters, path)?;
        description.check_field(&parameters, [json_path, path])?;
        // Static Gaussians have trajectories only in checkpoints of the first stage.
        let static_width = description.trajectory_width(&parameters, "static_set", path)?;
        let skeleton = description.skeleton(static_width, device)?;
        join_decoder(&mut parameters, &skeleton)
            .and_then(|()| with_parameters(skeleton, parameters))
            .map_err(|error| {
                ModelError::format(path, "the parameters of scene.json", error.to_string())
            })
    }

    /// The scene that [`DynamicScene::load`] returns after a save with [`TablePrecision::Half`]; `None` without
    /// tables.
    pub fn with_half_tables(&self) -> Option<Self> {
        let mut parameters = named_parameters(self);
        let tables = parameters.iter_mut().filter(|(name, _)| is_table(name));
        let mut found = false;
        for (_, table) in tables {
            found = true;
            for value in &mut table.values {
                *value = tensors::half(*value).to_f32();
            }
        }
        let rounded = found.then(|| with_parameters(self.clone(), parameters));
        rounded.map(|scene| scene.expect("a scene's own parameters fit it"))
    }

    /// Bytes of all tensors in the file, without its header.
    pub fn stored_bytes(&self, precision: TablePrecision) -> usize {
        let tensors = stored(self, precision);
        tensors.values().map(Stored::bytes).sum()
    }
}

/// Bytes that a module's parameters take as f32.
pub fn parameter_bytes<M: Module>(module: &M) -> usize {
    module.num_params() * size_of::<f32>()
}
