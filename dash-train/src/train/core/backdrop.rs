//! A backdrop: Gaussians at rest of another run, which a run draws and does not train.
//!
//! The room of a long recording is trained once; each window of time trains only what is not there, or differs. Which of the
//! room's Gaussians differ is seen in the window's own pictures: one is kept if it shows what a picture has where it is seen,
//! at some time at least. The others are what the run begins with.

mod misfit;

use std::sync::{Mutex, PoisonError};

use burn::module::Module as _;
use burn::tensor::{Device, Tensor};
use dash_kernels::Camera;
use dash_model::{DynamicScene, GaussianRows, Gaussians, SceneSettings};

use serde::{Deserialize, Serialize};

use self::misfit::Misfit;
use super::run::Run;
use super::view_sums::ViewSums;
use crate::Error;
use crate::hash::Fnv1a;

/// Most cameras whose splats are kept.
const MOST_CAMERAS: usize = 64;
/// Fewest points that a run with a backdrop begins with, if there are as many.
const MIN_POINTS: usize = 100;

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
    fn new(room: &GaussianRows, left_out: Vec<usize>) -> Self {
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
fn still(rows: &GaussianRows, settings: &SceneSettings, device: &Device) -> DynamicScene {
    DynamicScene {
        static_set: Gaussians::from_rows(rows, device),
        dynamic: None,
        settings: settings.clone(),
    }
}

impl<M> Run<M> {
    /// Draws the room of another run behind a run that has not begun: its Gaussians are kept where they show what this run's
    /// training views have. This run begins with the others, and with those of its own first ones that lie where the room
    /// differs.
    ///
    /// # Errors
    /// When an image can't be read or a shape does not fit.
    pub fn put_before(&mut self, room: &DynamicScene) -> Result<(), Error> {
        let room = room.valid();
        let rows = room.static_set.to_rows();
        let device = self.device.clone().inner();
        let whole = still(&rows, &room.settings, &device);
        let misfit = Misfit::of(&whole, self)?;
        let left_out = misfit.of_gaussians();
        let own = self.scene.static_set.to_rows();
        let new = misfit.of_points(&own.means, MIN_POINTS);
        let mut first = own.gather(&new);
        let released = rows.gather(&left_out);
        first.append(&of_degree(released, first.sh_degree()));
        tracing::info!(
            "backdrop: {} of {} Gaussians are kept; {} of {} points are where it differs by {:.3} or more",
            rows.len() - left_out.len(),
            rows.len(),
            new.len(),
            own.len(),
            misfit.threshold()
        );
        self.scene.static_set = Gaussians::from_rows(&first, &self.device);
        self.scene.settings.near_plane = room.settings.near_plane;
        self.static_state.gathered = ViewSums::new(first.len(), &self.device);
        let backdrop = Backdrop::new(&room, Kept::new(&rows, left_out), &device);
        self.backdrop = Some(backdrop.expect("rows of this scene"));
        Ok(())
    }

    /// A scene of the run together with the backdrop, if it has one.
    pub fn whole(&self, scene: &DynamicScene) -> DynamicScene {
        match &self.backdrop {
            Some(backdrop) => backdrop.with(scene),
            None => scene.clone(),
        }
    }
}

/// Rows with colour coefficients up to a degree: more are zeros, fewer are left out.
fn of_degree(mut rows: GaussianRows, degree: usize) -> GaussianRows {
    let width = ((degree + 1).pow(2) - 1) * 3;
    if rows.sh_rest_width <= width {
        return rows.with_sh_degree(degree);
    }
    let all = rows.sh_rest.chunks_exact(rows.sh_rest_width);
    rows.sh_rest = all.flat_map(|row| &row[..width]).copied().collect();
    rows.sh_rest_width = width;
    rows
}
