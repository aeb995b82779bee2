//! What can be played: a file, a file for each frame, or a clip of linear motions.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use burn::tensor::Device;
use dash_model::DynamicScene;

use super::{splat_files, splat_scene};
use crate::Error;

/// A scene at one of its times, with its share in a picture.
pub struct Drawn<'a> {
    /// The scene.
    pub scene: Cow<'a, DynamicScene>,
    /// The time of the scene, in [0, 1].
    pub time: f32,
    /// Its share; those of a picture add up to 1.
    pub share: f32,
}

/// A scene that can be drawn at any time.
pub trait SceneOverTime {
    /// What is drawn at `time`, in [0, 1] over the clip: one scene, or several whose pictures are mixed.
    ///
    /// # Errors
    /// When a file can't be read.
    fn drawn_at(&self, time: f32) -> Result<Vec<Drawn<'_>>, Error>;
}

impl SceneOverTime for DynamicScene {
    fn drawn_at(&self, time: f32) -> Result<Vec<Drawn<'_>>, Error> {
        Ok(vec![Drawn {
            scene: Cow::Borrowed(self),
            time,
            share: 1.0,
        }])
    }
}

/// Gaussians from files, over time.
///
/// # Example
/// ```no_run
/// use burn::tensor::Device;
/// use dash_train::SplatClip;
///
/// let clip = SplatClip::open("out/plys".as_ref(), &Device::flex())?;
/// println!("{} frames", clip.n_frames());
/// let half = clip.scene_at(0.5)?;
/// println!("{} Gaussians", half.counts().0);
/// # Ok::<(), dash_train::Error>(())
/// ```
pub struct SplatClip {
    kind: Kind,
    device: Device,
    background: [f32; 3],
}

enum Kind {
    /// One file, the same at all times.
    Still(Box<DynamicScene>),
    /// A file for each frame.
    Frames(Vec<PathBuf>),
    #[cfg(feature = "fourdgs")]
    Motions(Box<super::four_dgs::Motions>),
}

/// The ending of clips of linear motions.
const MOTIONS: &str = "4dgs";

impl SplatClip {
    /// Whether a path is named as such a clip.
    pub fn is_motions(path: &Path) -> bool {
        path.extension()
            .is_some_and(|ending| ending.eq_ignore_ascii_case(MOTIONS))
    }

    /// Opens a `.4dgs`, a file of Gaussians, or a folder of these, one for each frame.
    ///
    /// # Errors
    /// When it can't be read, or is none of them.
    pub fn open(path: &Path, device: &Device) -> Result<Self, Error> {
        let kind = if path.is_dir() {
            Kind::Frames(splat_files(path)?)
        } else if Self::is_motions(path) {
            motions(path)?
        } else {
            let scene = splat_scene(path, device)?;
            if scene.static_set.is_empty() {
                let remedy = "write it again, or name another file";
                return Err(Error::invalid(
                    path,
                    "Gaussians",
                    "none that can be seen",
                    remedy,
                ));
            }
            Kind::Still(Box::new(scene))
        };
        Ok(Self {
            kind,
            device: device.clone(),
            background: [0.0; 3],
        })
    }

    /// Its frames; 1 of a file in which nothing moves.
    pub fn n_frames(&self) -> usize {
        match &self.kind {
            Kind::Still(_) => 1,
            Kind::Frames(files) => files.len(),
            #[cfg(feature = "fourdgs")]
            Kind::Motions(motions) => motions.n_frames(),
        }
    }

    /// Frames per second, where the files say it.
    pub fn frame_rate(&self) -> Option<f64> {
        match &self.kind {
            Kind::Still(_) | Kind::Frames(_) => None,
            #[cfg(feature = "fourdgs")]
            Kind::Motions(motions) => Some(motions.frame_rate()),
        }
    }

    /// Draws over another colour than black.
    pub fn set_background(&mut self, background: [f32; 3]) {
        self.background = background;
    }

    /// The scene of a frame.
    ///
    /// # Errors
    /// When its file can't be read.
    pub fn frame(&self, frame: usize) -> Result<DynamicScene, Error> {
        let last = self.n_frames().saturating_sub(1).max(1);
        self.scene_at(frame as f32 / last as f32)
    }

    /// What is there at `time`, in [0, 1] over the clip.
    ///
    /// # Errors
    /// When a file can't be read.
    pub fn scene_at(&self, time: f32) -> Result<DynamicScene, Error> {
        let mut scene = match &self.kind {
            Kind::Still(scene) => (**scene).clone(),
            Kind::Frames(files) => {
                let last = files.len() - 1;
                let frame = (time * last as f32).round() as usize;
                splat_scene(&files[frame.min(last)], &self.device)?
            }
            #[cfg(feature = "fourdgs")]
            Kind::Motions(motions) => motions.scene_at(time, &self.device),
        };
        scene.settings.background = self.background;
        Ok(scene)
    }
}

impl SceneOverTime for SplatClip {
    fn drawn_at(&self, time: f32) -> Result<Vec<Drawn<'_>>, Error> {
        Ok(vec![Drawn {
            scene: Cow::Owned(self.scene_at(time)?),
            time,
            share: 1.0,
        }])
    }
}

#[cfg(feature = "fourdgs")]
fn motions(path: &Path) -> Result<Kind, Error> {
    Ok(Kind::Motions(Box::new(super::four_dgs::Motions::read(
        path,
    )?)))
}

#[cfg(not(feature = "fourdgs"))]
fn motions(path: &Path) -> Result<Kind, Error> {
    Err(Error::invalid(
        path,
        "a kind of file that this program was built to read",
        "a .4dgs, which needs the feature `fourdgs`",
        "build with --features fourdgs",
    ))
}
