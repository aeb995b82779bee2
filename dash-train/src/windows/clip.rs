//! Windows as one clip.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

use burn::tensor::Device;
use dash_model::{DynamicScene, TimeWindows};

use super::{ClipRun, Windows};
use crate::Error;
use crate::splat_scene::{Drawn, SceneOverTime};
use crate::train::RunFolder;

/// Windows that stay in memory: those of one overlap.
const KEPT: usize = 2;

/// The trained windows of a clip. Only those that a picture needs are read.
pub struct WindowedClip {
    pub(super) out: PathBuf,
    windows: Windows,
    times: TimeWindows,
    device: Device,
    background: Option<[f32; 3]>,
    /// What all windows share, once it is read.
    room: OnceLock<DynamicScene>,
    /// What was read last, the newest first.
    read: Mutex<Vec<(usize, DynamicScene)>>,
}

impl WindowedClip {
    /// Opens the folder of a plan's windows.
    ///
    /// # Errors
    /// When it holds none.
    pub fn open(out: &Path, device: &Device) -> Result<Self, Error> {
        let windows = Windows::read(out)?;
        Ok(Self {
            times: windows.times(),
            windows,
            out: out.to_path_buf(),
            device: device.clone(),
            background: None,
            room: OnceLock::new(),
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

    /// When each window begins and ends.
    pub fn times(&self) -> &TimeWindows {
        &self.times
    }

    /// The scene of a window.
    ///
    /// # Errors
    /// When it is not trained, or its files can't be read.
    pub fn scene(&self, number: usize) -> Result<DynamicScene, Error> {
        let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        let scene = match read.iter().position(|(known, _)| *known == number) {
            Some(place) => read.remove(place).1,
            None => {
                let run = self.run(ClipRun::Window(number))?;
                let mut scene = match self.windows.room {
                    None => run.scene(&self.device)?,
                    Some(_) => run.scene_before(self.room()?, &self.device)?,
                };
                scene.settings.background = self.background.unwrap_or(scene.settings.background);
                scene
            }
        };
        read.insert(0, (number, scene.clone()));
        read.truncate(KEPT);
        Ok(scene)
    }

    fn run(&self, run: ClipRun) -> Result<RunFolder, Error> {
        RunFolder::open(&self.out.join(run.run_name()))
    }

    /// What all windows share.
    fn room(&self) -> Result<&DynamicScene, Error> {
        if let Some(room) = self.room.get() {
            return Ok(room);
        }
        let room = self.run(ClipRun::Room)?.scene(&self.device)?;
        Ok(self.room.get_or_init(|| room))
    }
}

impl SceneOverTime for WindowedClip {
    fn drawn_at(&self, time: f32) -> Result<Vec<Drawn<'_>>, Error> {
        let drawn = |(number, share): (usize, f32)| {
            Ok(Drawn {
                scene: Cow::Owned(self.scene(number)?),
                time: self.times.local(number, time),
                share,
            })
        };
        self.times.shares(time).into_iter().map(drawn).collect()
    }
}
