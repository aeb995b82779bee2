//! Cameras that are left out of a scene.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::Error;
use crate::published::Protocol;

/// A camera to leave out, of one scene or of all: `SCENE:CAMERA` or `CAMERA`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct DroppedCamera {
    /// The scene's name; `None` for every scene.
    pub scene: Option<String>,
    /// The camera's name.
    pub camera: String,
}

impl DroppedCamera {
    /// The names of the cameras that a scene is to lack.
    pub(super) fn of_scene(all: &[Self], scene: &str) -> Vec<String> {
        let is_of_it = |dropped: &&Self| dropped.scene.as_deref().is_none_or(|own| own == scene);
        let own = all.iter().filter(is_of_it);
        own.map(|dropped| dropped.camera.clone()).collect()
    }

    /// Checks that the scenes are the protocol's.
    pub(super) fn check(all: &[Self], protocol: &Protocol) -> Result<(), Error> {
        let names = protocol.scene_names();
        let scenes = all.iter().filter_map(|dropped| dropped.scene.as_deref());
        match scenes.into_iter().find(|scene| !names.contains(scene)) {
            None => Ok(()),
            Some(scene) => Err(Error::LoadOption {
                option: "--drop-cameras",
                expected: format!("SCENE:CAMERA with one of the scenes {}", names.join(", ")),
                found: format!("the scene `{scene}`"),
            }),
        }
    }
}

impl fmt::Display for DroppedCamera {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.scene {
            Some(scene) => write!(f, "{scene}:{}", self.camera),
            None => f.write_str(&self.camera),
        }
    }
}

impl FromStr for DroppedCamera {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (scene, camera) = match text.split_once(':') {
            Some((scene, camera)) => (Some(scene), camera),
            None => (None, text),
        };
        if camera.is_empty() || scene == Some("") {
            return Err(format!(
                "expected CAMERA or SCENE:CAMERA, such as coffee_martini:cam13, found `{text}`"
            ));
        }
        Ok(Self {
            scene: scene.map(str::to_string),
            camera: camera.to_string(),
        })
    }
}

impl TryFrom<String> for DroppedCamera {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<DroppedCamera> for String {
    fn from(dropped: DroppedCamera) -> Self {
        dropped.to_string()
    }
}
