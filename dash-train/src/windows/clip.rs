//! Windows as one clip.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use burn::tensor::Device;
use dash_model::{DynamicScene, Gaps, GaussianRows, Gaussians, SceneSettings, logit};

use super::Windows;
use crate::Error;
use crate::splat_scene::{Drawn, SceneOverTime};
use crate::train::RunFolder;

/// Windows that stay in memory: those of one overlap.
const KEPT: usize = 2;

/// The trained windows of a clip. Only those that a picture needs are read.
pub struct WindowedClip {
    pub(super) out: PathBuf,
    windows: Windows,
    device: Device,
    background: Option<[f32; 3]>,
    /// What was read last, the newest first.
    read: Mutex<Vec<(usize, DynamicScene)>>,
}

impl WindowedClip {
    /// Opens the folder of a plan's windows.
    ///
    /// # Errors
    /// When it holds none.
    pub fn open(out: &Path, device: &Device) -> Result<Self, Error> {
        Ok(Self {
            windows: Windows::read(out)?,
            out: out.to_path_buf(),
            device: device.clone(),
            background: None,
            read: Mutex::default(),
        })
    }

    /// The clip and its windows.
    pub fn windows(&self) -> &Windows {
        &self.windows
    }

    /// Draws over another colour than the windows' own.
    pub fn set_background(&mut self, background: [f32; 3]) {
        self.background = Some(background);
    }

    /// What it is drawn over.
    pub(super) fn background(&self) -> Result<[f32; 3], Error> {
        Ok(self.scene(0)?.settings.background)
    }

    fn scene(&self, number: usize) -> Result<DynamicScene, Error> {
        let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        let scene = match read.iter().position(|(known, _)| *known == number) {
            Some(place) => read.remove(place).1,
            None => {
                let root = self.out.join(Windows::run_name(number));
                let mut scene = RunFolder::open(&root)?.scene(&self.device)?;
                scene.settings.background = self.background.unwrap_or(scene.settings.background);
                scene
            }
        };
        read.insert(0, (number, scene.clone()));
        read.truncate(KEPT);
        Ok(scene)
    }

    /// A frame as a scene at rest. Where windows overlap it has the Gaussians of both, each with as much opacity as leaves the
    /// two layers together as opaque as each by itself.
    ///
    /// # Errors
    /// When a window is not trained, or its files can't be read.
    pub fn frame(&self, frame: usize) -> Result<DynamicScene, Error> {
        let last = self.windows.n_frames.saturating_sub(1).max(1);
        let (mut rows, mut settings) = (Vec::new(), Vec::new());
        for Drawn { scene, time, share } in self.drawn_at(frame as f32 / last as f32)? {
            let mut own = scene.at(time)?;
            if share < 1.0 {
                for opacity in &mut own.opacity_logits {
                    *opacity = thinned(*opacity, share);
                }
            }
            rows.push(own);
            settings.push(scene.settings.clone());
        }
        // One window may have been found to need no higher colour coefficients.
        let degree = rows.iter().map(GaussianRows::sh_degree).max();
        let mut rows = rows
            .into_iter()
            .map(|rows| rows.with_sh_degree(degree.unwrap_or(0)));
        let mut all = rows.next().unwrap_or_default();
        rows.for_each(|more| all.append(&more));
        let active = settings.iter().map(|settings| settings.sh_degree).max();
        let first = settings.into_iter().next();
        let first = first.ok_or_else(|| Error::run(&self.out, "expected a window, found none"))?;
        Ok(DynamicScene {
            static_set: Gaussians::from_rows(&all, &self.device),
            dynamic: None,
            settings: SceneSettings {
                sh_degree: active.unwrap_or(first.sh_degree),
                gaps: Gaps::default(),
                ..first
            },
        })
    }
}

impl SceneOverTime for WindowedClip {
    fn drawn_at(&self, time: f32) -> Result<Vec<Drawn<'_>>, Error> {
        let drawn = |(number, share): (usize, f32)| {
            Ok(Drawn {
                scene: Cow::Owned(self.scene(number)?),
                time: self.windows.windows[number].local(time),
                share,
            })
        };
        self.windows.shares(time).into_iter().map(drawn).collect()
    }
}

/// The logit of an opacity that lets through a power of what another one does: two layers of shares that add up to 1 let
/// through what one whole layer does.
pub(super) fn thinned(opacity_logit: f32, share: f32) -> f32 {
    let through = 1.0 / (1.0 + f64::from(opacity_logit).exp());
    logit((1.0 - through.powf(f64::from(share))) as f32)
}
