//! A scene on disk: `scene.json` (structure) and `scene.safetensors` (parameters), described in `docs/scene-format.md`.
//!
//! Version 2 of the files may hold tables of features as 16-bit floats, and the higher colour
//! coefficients of those Gaussians only that have any, `SET.sh_rest`, with the numbers of these
//! Gaussians, `SET.sh_rest.rows`. In version 3 tables may also lack their rows of zeros, see `marks`. In version 4
//! trajectories may be at rest at another time than the first; in version 5
//! they may have `gaps`, in version 6 also such as go on beyond the clip. A file is of the lowest version that has what is in it.

mod marks;
mod stored;
mod tensors;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::tensor::Device;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use stored::{is_table, join_decoder, stored, whole};
use tensors::{Stored, read_stored, write_stored};
pub use tensors::{read_tensors, write_tensors};

use crate::parameters::{HostTensor, named_parameters, with_parameters};
use crate::{
    DeformationConfig, DeformationField, DynamicPart, DynamicScene, GaussianRows, Gaussians,
    ModelError, SceneSettings, SpaceBox,
};

/// Version of files in which every tensor is whole and f32.
const PLAIN_VERSION: u32 = 1;
/// Version of those in which tensors may also be 16 bits wide, or lack rows of colour.
const REDUCED_VERSION: u32 = 2;
/// Version of those in which tables may also lack rows.
const MARKED_VERSION: u32 = 3;
/// Version of those with an anchor of trajectories.
const LIMITED_VERSION: u32 = 4;
/// Version of those with gaps in time.
const GAPS_VERSION: u32 = 5;
/// Version of those with gaps that go on beyond the clip.
const FORMAT_VERSION: u32 = 6;
/// Most functions of time that trajectories may be made of.
const MAX_BASIS_FUNCTIONS: usize = 4096;

/// Everything about a scene that is not a tensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneDescription {
    format_version: u32,
    settings: SceneSettings,
    n_static: usize,
    n_dynamic: usize,
    sh_degree: usize,
    field: Option<FieldDescription>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FieldDescription {
    config: DeformationConfig,
    space: SpaceBox,
    trajectory_width: usize,
}

/// How the field's tables of features are stored. Everything else is always f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TablePrecision {
    /// As they are.
    Single,
    /// As 16-bit floats, the nearest to each value; values beyond their range become the largest.
    Half,
}

impl DynamicScene {
    /// Writes the scene into a folder, which is made if need be. Each file is complete or absent.
    ///
    /// # Errors
    /// [`ModelError::Io`].
    pub fn save(&self, folder: &Path) -> Result<(), ModelError> {
        self.save_with(folder, TablePrecision::Single)
    }

    /// The same, with the field's tables of features in another precision.
    ///
    /// # Errors
    /// [`ModelError::Io`].
    pub fn save_with(&self, folder: &Path, precision: TablePrecision) -> Result<(), ModelError> {
        fs::create_dir_all(folder).map_err(|e| ModelError::io(folder, "create the folder", e))?;
        let tensors = stored(self, precision);
        let versions = tensors.values().map(Stored::version);
        let version = versions.fold(settings_version(&self.settings), u32::max);
        let description = self.describe(version);
        let json = serde_json::to_vec_pretty(&description)
            .map_err(|e| ModelError::Config(format!("scene settings: {e}")))?;
        write_stored(&folder.join("scene.safetensors"), &tensors)?;
        write_atomically(&folder.join("scene.json"), |mut file| {
            std::io::Write::write_all(&mut file, &json)
        })
    }

    /// Reads a scene that [`DynamicScene::save`] wrote.
    ///
    /// # Errors
    /// [`ModelError::Io`] or [`ModelError::Format`].
    pub fn load(folder: &Path, device: &Device) -> Result<Self, ModelError> {
        let json_path = folder.join("scene.json");
        let text = fs::read(&json_path).map_err(|e| ModelError::io(&json_path, "read", e))?;
        let description: SceneDescription = serde_json::from_slice(&text)
            .map_err(|e| ModelError::format(&json_path, "a scene description", e.to_string()))?;
        if !(PLAIN_VERSION..=FORMAT_VERSION).contains(&description.format_version) {
            return Err(ModelError::format(
                &json_path,
                format!("format version {PLAIN_VERSION} to {FORMAT_VERSION}"),
                description.format_version.to_string(),
            ));
        }
        let tensor_path = folder.join("scene.safetensors");
        let mut parameters = whole(read_stored(&tensor_path)?, &tensor_path)?;
        description.check(&parameters, &tensor_path)?;
        // Static Gaussians have trajectories only in checkpoints, before the split.
        let static_width = description.trajectory_width(&parameters, "static_set", &tensor_path)?;
        description.check_field(&parameters, &tensor_path)?;
        let skeleton = description.skeleton(static_width, device)?;
        join_decoder(&mut parameters, &skeleton)
            .and_then(|()| with_parameters(skeleton, parameters))
            .map_err(|found| {
                ModelError::format(&tensor_path, "the parameters of scene.json", found)
            })
    }

    /// The scene as it is read back after [`TablePrecision::Half`]; `None` without tables.
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

    /// Bytes that the scene takes on disk, names and sizes aside.
    pub fn stored_bytes(&self, precision: TablePrecision) -> usize {
        let tensors = stored(self, precision);
        tensors.values().map(Stored::bytes).sum()
    }

    fn describe(&self, format_version: u32) -> SceneDescription {
        let (n_static, n_dynamic) = self.counts();
        SceneDescription {
            format_version,
            settings: self.settings.clone(),
            n_static,
            n_dynamic,
            sh_degree: self.static_set.sh_degree(),
            field: self.dynamic.as_ref().map(|dynamic| FieldDescription {
                config: dynamic.field.config().clone(),
                space: *dynamic.field.space(),
                trajectory_width: dynamic
                    .gaussians
                    .trajectories
                    .as_ref()
                    .map_or(0, |coefficients| coefficients.dims()[1]),
            }),
        }
    }
}

/// The first version of scenes that has such settings.
fn settings_version(settings: &SceneSettings) -> u32 {
    if settings.gaps.are_open() {
        FORMAT_VERSION
    } else if !settings.gaps.is_empty() {
        GAPS_VERSION
    } else if settings.trajectory_basis.anchor() != 0.0 {
        LIMITED_VERSION
    } else {
        PLAIN_VERSION
    }
}

impl SceneDescription {
    /// A scene of the right structure without Gaussians.
    fn skeleton(&self, static_width: usize, device: &Device) -> Result<DynamicScene, ModelError> {
        let sh_rest_width = ((self.sh_degree + 1).pow(2) - 1) * 3;
        let empty = |trajectory_width, embedding_width| {
            let rows = GaussianRows {
                sh_rest_width,
                trajectory_width,
                embedding_width,
                ..Default::default()
            };
            Gaussians::from_rows(&rows, device)
        };
        let dynamic = match &self.field {
            None => None,
            Some(field) => Some(DynamicPart {
                gaussians: empty(field.trajectory_width, field.config.embedding_width()),
                field: DeformationField::new(
                    &field.config,
                    field.space,
                    &mut Pcg64::seed_from_u64(0),
                    device,
                )?,
            }),
        };
        Ok(DynamicScene {
            static_set: empty(static_width, 0),
            dynamic,
            settings: self.settings.clone(),
        })
    }

    /// The field's sizes are those of the stored values, rows of zeros put back: a description must not ask for
    /// more memory than these.
    fn check_field(
        &self,
        parameters: &BTreeMap<String, HostTensor>,
        path: &Path,
    ) -> Result<(), ModelError> {
        let Some(field) = &self.field else {
            return Ok(());
        };
        let stored: usize = parameters
            .iter()
            .filter(|(name, _)| name.starts_with("dynamic.field."))
            .map(|(_, tensor)| tensor.values.len())
            .sum();
        field.config.validate()?;
        let described = field.config.n_values()?;
        if described != stored as u128 {
            return Err(ModelError::format(
                path,
                format!("the {described} values of the field that scene.json describes"),
                stored.to_string(),
            ));
        }
        let width = self.trajectory_width(parameters, "dynamic.gaussians", path)?;
        if width != field.trajectory_width {
            return Err(ModelError::format(
                path,
                format!("trajectories of {} columns", field.trajectory_width),
                width.to_string(),
            ));
        }
        Ok(())
    }

    /// Columns of a set's trajectories, 0 where it has none: a set without rows could claim any
    /// number of them.
    fn trajectory_width(
        &self,
        parameters: &BTreeMap<String, HostTensor>,
        set: &str,
        path: &Path,
    ) -> Result<usize, ModelError> {
        let name = format!("{set}.trajectories");
        let Some(tensor) = parameters.get(&name) else {
            return Ok(0);
        };
        let functions = self.settings.trajectory_basis.len();
        match tensor.shape[..] {
            [_, width] if width > 0 && width == 3 * functions => Ok(width),
            _ => Err(ModelError::format(
                path,
                format!("`{name}` with three columns for each of {functions} functions of time"),
                format!("shape {:?}", tensor.shape),
            )),
        }
    }

    /// Every per-Gaussian tensor has the number of rows that the description names.
    fn check(
        &self,
        parameters: &BTreeMap<String, HostTensor>,
        path: &Path,
    ) -> Result<(), ModelError> {
        if self.sh_degree > 3 || self.settings.sh_degree > self.sh_degree {
            return Err(ModelError::format(
                path,
                "spherical harmonics of degree 0 to 3",
                format!(
                    "{} stored, {} active",
                    self.sh_degree, self.settings.sh_degree
                ),
            ));
        }
        let functions = self.settings.trajectory_basis.len();
        if functions > MAX_BASIS_FUNCTIONS {
            return Err(ModelError::format(
                path,
                format!("trajectories of at most {MAX_BASIS_FUNCTIONS} functions of time"),
                functions.to_string(),
            ));
        }
        let anchor = self.settings.trajectory_basis.anchor();
        if !(0.0..=1.0).contains(&anchor) {
            return Err(ModelError::format(
                path,
                "trajectories with an anchor in [0, 1]",
                anchor.to_string(),
            ));
        }
        if !self.settings.gaps.are_sound() {
            return Err(ModelError::format(
                path,
                "gaps [from, to] in [0, 1] (from -1 the first, to 2 the last), in rising order and without overlap",
                format!("{:?}", self.settings.gaps),
            ));
        }
        for (name, tensor) in parameters {
            let expected = if name.starts_with("static_set.") {
                self.n_static
            } else if name.starts_with("dynamic.gaussians.") {
                self.n_dynamic
            } else {
                continue;
            };
            if tensor.shape.first() != Some(&expected) {
                return Err(ModelError::format(
                    path,
                    format!("{expected} rows in `{name}`"),
                    format!("shape {:?}", tensor.shape),
                ));
            }
        }
        Ok(())
    }
}

/// Writes a file through a sibling scratch file that replaces it once complete and on disk.
///
/// # Errors
/// [`ModelError::Io`] that names `path`.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&File) -> std::io::Result<()>,
) -> Result<(), ModelError> {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".partial");
    let scratch: PathBuf = path.with_file_name(name);
    let result = File::create(&scratch).and_then(|file| {
        write(&file)?;
        file.sync_all()?;
        fs::rename(&scratch, path)
    });
    result.map_err(|e| {
        // The scratch file may not exist; what matters to the user is the first error.
        let _ = fs::remove_file(&scratch);
        ModelError::io(path, "write", e)
    })
}

/// The number of bytes that a module's parameters take, f32.
pub fn parameter_bytes<M: Module>(module: &M) -> usize {
    module.num_params() * size_of::<f32>()
}
