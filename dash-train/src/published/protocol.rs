//! What a protocol pins.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A protocol's name on the command line.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, clap::ValueEnum,
)]
pub enum ProtocolName {
    /// Neural 3D Video: six cooking scenes, 18 to 21 cameras.
    #[serde(rename = "n3dv")]
    #[value(name = "n3dv")]
    N3dv,
    /// Technicolor: five scenes of a 4x4 rig.
    #[serde(rename = "technicolor")]
    #[value(name = "technicolor")]
    Technicolor,
    /// Panoptic Sports: six scenes in a dome of 31 cameras.
    #[serde(rename = "panoptic")]
    #[value(name = "panoptic")]
    Panoptic,
    /// D-NeRF: eight synthetic scenes, one picture per time.
    #[serde(rename = "d-nerf")]
    #[value(name = "d-nerf")]
    DNerf,
    /// NVIDIA Dynamic Scenes: seven scenes of twelve times.
    #[serde(rename = "nvidia")]
    #[value(name = "nvidia")]
    Nvidia,
    /// HyperNeRF's validation rig: four scenes of two cameras.
    #[serde(rename = "hypernerf")]
    #[value(name = "hypernerf")]
    HyperNerf,
}

impl ProtocolName {
    /// All of them, in the order of the help.
    pub const ALL: [Self; 6] = [
        Self::N3dv,
        Self::Technicolor,
        Self::Panoptic,
        Self::DNerf,
        Self::Nvidia,
        Self::HyperNerf,
    ];

    /// The protocol itself.
    pub fn protocol(self) -> &'static Protocol {
        let mut all = super::PROTOCOLS.iter();
        all.find(|protocol| protocol.name == self)
            .expect("tested: each name has one")
    }
}

impl fmt::Display for ProtocolName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::N3dv => "n3dv",
            Self::Technicolor => "technicolor",
            Self::Panoptic => "panoptic",
            Self::DNerf => "d-nerf",
            Self::Nvidia => "nvidia",
            Self::HyperNerf => "hypernerf",
        })
    }
}

/// How results on a dataset are measured, as those of others were.
#[derive(Debug, Clone, PartialEq)]
pub struct Protocol {
    /// Its name.
    pub name: ProtocolName,
    /// The dataset's name in words.
    pub title: &'static str,
    /// The published scenes.
    pub scenes: &'static [Scene],
    /// In which layout the dataset comes, in words.
    pub layout: &'static str,
    /// The numbers in the held-out cameras' names; `None` where the dataset lists its test views.
    pub held_out: Option<&'static [u64]>,
    /// Width and height of the pictures, pixels.
    pub size: [usize; 2],
    /// Distinct times of a scene, where they are the same in all.
    pub n_frames: Option<usize>,
    /// What is behind transparent pixels, in words.
    pub background: &'static str,
    /// With which networks others measure LPIPS, in words.
    pub lpips: &'static str,
    /// Where the protocol is from, in words.
    pub source: &'static str,
}

/// A published scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The name of its folder as it was published.
    pub name: &'static str,
    /// Other names of the folder.
    pub aliases: &'static [&'static str],
    /// The first and the last of the published frames, of a scene that has more.
    pub frames: Option<(u64, u64)>,
    /// What a user should know before the scene is trained.
    pub caution: Option<&'static str>,
}

impl Scene {
    /// Whether a folder of this name may hold the scene, in upper or lower case.
    pub fn is_called(&self, name: &str) -> bool {
        let same = |own: &&str| own.eq_ignore_ascii_case(name);
        std::iter::once(&self.name).chain(self.aliases).any(same)
    }
}

impl Protocol {
    /// The scene of this name, or with it as an alias.
    pub fn scene(&self, name: &str) -> Option<&'static Scene> {
        self.scenes.iter().find(|scene| scene.is_called(name))
    }

    /// The names of the scenes.
    pub fn scene_names(&self) -> Vec<&'static str> {
        self.scenes.iter().map(|scene| scene.name).collect()
    }
}
