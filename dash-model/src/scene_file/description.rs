//! `scene.json`: everything about a scene that is not a tensor.

use std::collections::BTreeMap;
use std::path::Path;

use burn::tensor::Device;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::parameters::HostTensor;
use crate::{
    DeformationConfig, DeformationField, DynamicPart, DynamicScene, GaussianRows, Gaussians,
    ModelError, SceneSettings, SpaceBox,
};

/// The only version of scene files.
const FORMAT_VERSION: u32 = 1;
/// Most functions of time in a trajectory basis. A set without rows could claim any number.
const MAX_BASIS_FUNCTIONS: usize = 4096;

/// The contents of `scene.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneDescription {
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

/// The key that decides whether the other keys can be understood.
#[derive(Deserialize)]
struct Version {
    format_version: u32,
}

impl SceneDescription {
    pub(super) fn of(scene: &DynamicScene) -> Self {
        let (n_static, n_dynamic) = scene.counts();
        Self {
            format_version: FORMAT_VERSION,
            settings: scene.settings.clone(),
            n_static,
            n_dynamic,
            sh_degree: scene.static_set.sh_degree(),
            field: scene.dynamic.as_ref().map(|dynamic| FieldDescription {
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

    pub(super) fn to_json(&self) -> Vec<u8> {
        serde_json::to_vec_pretty(self).expect("every key is a string, every value plain")
    }

    /// Reads and checks a description; `path` is for errors.
    ///
    /// # Errors
    /// [`ModelError::Format`] or [`ModelError::Version`].
    pub(super) fn read(text: &[u8], path: &Path) -> Result<Self, ModelError> {
        let damaged =
            |e: serde_json::Error| ModelError::format(path, "a scene description", e.to_string());
        let version: Version = serde_json::from_slice(text).map_err(damaged)?;
        if version.format_version != FORMAT_VERSION {
            return Err(ModelError::Version {
                path: path.to_path_buf(),
                expected: FORMAT_VERSION,
                found: version.format_version,
            });
        }
        let description: Self = serde_json::from_slice(text).map_err(damaged)?;
        description
            .check_settings()
            .map_err(|(expected, found)| ModelError::format(path, expected, found))?;
        Ok(description)
    }

    /// # Errors
    /// What was expected, and what was found.
    fn check_settings(&self) -> Result<(), (String, String)> {
        let settings = &self.settings;
        if self.sh_degree > 3 || settings.sh_degree > self.sh_degree {
            return Err((
                "spherical harmonics of degree 0 to 3".into(),
                format!("{} stored, {} active", self.sh_degree, settings.sh_degree),
            ));
        }
        if let Some(field) = &self.field {
            let (changed, all) = (field.config.heads.sh_rest, (self.sh_degree + 1).pow(2) - 1);
            if changed != 0 && changed != all {
                return Err((
                    format!("`heads.sh_rest` of 0 or {all}, as the Gaussians have"),
                    changed.to_string(),
                ));
            }
        }
        let functions = settings.trajectory_basis.len();
        if functions > MAX_BASIS_FUNCTIONS {
            return Err((
                format!("trajectories of at most {MAX_BASIS_FUNCTIONS} functions of time"),
                functions.to_string(),
            ));
        }
        let anchor = settings.trajectory_basis.anchor();
        if !(0.0..=1.0).contains(&anchor) {
            return Err((
                "trajectories with an anchor in [0, 1]".into(),
                anchor.to_string(),
            ));
        }
        if !settings.gaps.are_valid() {
            return Err((
                "gaps [from, to] in [0, 1] (from -1 the first, to 2 the last), in rising order and without overlap"
                    .into(),
                format!("{:?}", settings.gaps),
            ));
        }
        Ok(())
    }

    /// Every tensor of a set has the number of rows that the description names.
    pub(super) fn check_rows(
        &self,
        parameters: &BTreeMap<String, HostTensor>,
        path: &Path,
    ) -> Result<(), ModelError> {
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

    /// The field has as many values as are stored, rows of zeros included. A description could ask for any amount of
    /// memory otherwise.
    pub(super) fn check_field(
        &self,
        parameters: &BTreeMap<String, HostTensor>,
        [json_path, path]: [&Path; 2],
    ) -> Result<(), ModelError> {
        let Some(field) = &self.field else {
            return Ok(());
        };
        let stored: usize = parameters
            .iter()
            .filter(|(name, _)| name.starts_with("dynamic.field."))
            .map(|(_, tensor)| tensor.values.len())
            .sum();
        let described = field
            .config
            .validate()
            .and_then(|()| field.config.n_values())
            .map_err(|e| ModelError::format(json_path, "a valid `field.config`", e.to_string()))?;
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

    /// Columns of a set's trajectories, 0 where it has none. A set without rows could claim any number of them.
    pub(super) fn trajectory_width(
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

    /// A scene of this structure without Gaussians.
    pub(super) fn skeleton(
        &self,
        static_width: usize,
        device: &Device,
    ) -> Result<DynamicScene, ModelError> {
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
}
