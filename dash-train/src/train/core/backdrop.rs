//! A backdrop: Gaussians at rest of another run, which a run draws and does not train.
//!
//! The room of a long recording is trained once; each window of time trains only what is not there, or differs. Which of the
//! room's Gaussians differ is seen in the window's own pictures: one is kept if it shows what a picture has where it is seen,
//! at some time at least. The others are what the run begins with.

use std::sync::{Mutex, PoisonError};

use burn::tensor::{Device, Tensor};
use dash_kernels::Camera;
use dash_model::{DynamicScene, GaussianRows, Gaussians, SceneSettings};

use serde::{Deserialize, Serialize};

use crate::Error;
use crate::hash::Fnv1a;

/// Most cameras whose splats are kept.
const MOST_CAMERAS: usize = 64;

/// Which Gaussians of another run are kept.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kept {
    /// How many static Gaussians the other run has.
    of: usize,
    /// A hash of where they are and what colours they have.
    hash: u64,
    /// The rows of those that are not kept, in order.
    left_out: Vec<usize>,
}

impl Kept {
    pub(super) fn new(room: &GaussianRows, left_out: Vec<usize>) -> Self {
        let mut hash = Fnv1a::default();
        for value in room.means.iter().chain(&room.sh_dc).flatten() {
            hash.write(&value.to_bits().to_le_bytes());
        }
        Self {
            of: room.len(),
            hash: hash.value(),
            left_out,
        }
    }
}

/// The Gaussians of another run that a run keeps.
#[derive(Debug)]
pub struct Backdrop {
    /// Those Gaussians, and how they are drawn.
    scene: DynamicScene,
    kept: Kept,
    /// Their packed splats for the cameras that were first asked for: a rig has the same ones in every step.
    projected: Mutex<Vec<(Camera, Tensor<2>)>>,
}

impl Backdrop {
    /// What is kept of another run's scene.
    ///
    /// # Errors
    /// What was found, where it is not the scene that the choice was made for.
    pub fn new(room: &DynamicScene, kept: Kept, device: &Device) -> Result<Self, String> {
        let rows = room.static_set.to_rows();
        let found = Kept::new(&rows, Vec::new());
        if (found.of, found.hash) != (kept.of, kept.hash) {
            return Err(match found.of == kept.of {
                true => "the same number with other values".into(),
                false => format!("{} where there were {}", found.of, kept.of),
            });
        }
        let mut stays = vec![true; rows.len()];
        for &row in &kept.left_out {
            let row = stays
                .get_mut(row)
                .ok_or_else(|| format!("no Gaussian {row}"))?;
            *row = false;
        }
        let stay: Vec<usize> = (0..rows.len()).filter(|&row| stays[row]).collect();
        let scene = still(&rows.gather(&stay), &room.settings, &device.clone().inner());
        Ok(Self {
            scene,
            kept,
            projected: Mutex::default(),
        })
    }

    /// Which Gaussians are kept.
    pub fn kept(&self) -> &Kept {
        &self.kept
    }

    /// How many Gaussians are kept.
    pub fn len(&self) -> usize {
        self.scene.static_set.len()
    }

    /// Whether none is.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Their packed splats `[N, C]`, without a graph.
    ///
    /// # Errors
    /// When a shape does not fit.
    pub(crate) fn splats(&self, camera: &Camera) -> Result<Tensor<2>, Error> {
        let mut known = self
            .projected
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if let Some((_, splats)) = known.iter().find(|(known, _)| known == camera) {
            return Ok(splats.clone());
        }
        let splats = self.scene.static_splats(camera)?;
        if known.len() < MOST_CAMERAS {
            known.push((camera.clone(), splats.clone()));
        }
        Ok(splats)
    }

    /// A scene together with them: they follow its own static Gaussians.
    pub fn with(&self, scene: &DynamicScene) -> DynamicScene {
        let device = scene.static_set.means.device();
        let mut scene = scene.clone();
        let (mut own, kept) = (scene.static_set.to_rows(), self.scene.static_set.to_rows());
        // Rendering does not read them.
        own.trajectories.clear();
        own.trajectory_width = 0;
        let degree = own.sh_degree().max(kept.sh_degree());
        if own.sh_degree() < degree {
            own = own.with_sh_degree(degree);
            if let Some(dynamic) = &mut scene.dynamic {
                let rows = dynamic.gaussians.to_rows().with_sh_degree(degree);
                dynamic.gaussians = Gaussians::from_rows(&rows, &device);
            }
        }
        own.append(&kept.with_sh_degree(degree));
        scene.static_set = Gaussians::from_rows(&own, &device);
        let settings = &mut scene.settings;
        settings.sh_degree = settings.sh_degree.max(self.scene.settings.sh_degree);
        scene
    }
}

/// Rows as a scene in which nothing moves.
pub(super) fn still(
    rows: &GaussianRows,
    settings: &SceneSettings,
    device: &Device,
) -> DynamicScene {
    DynamicScene {
        static_set: Gaussians::from_rows(rows, device),
        dynamic: None,
        settings: settings.clone(),
    }
}
