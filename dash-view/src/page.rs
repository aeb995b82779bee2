//! A scene as a web page: the player of this crate, built for browsers, and the scene in parts.
//!
//! A page is a folder for any static host, or one HTML file with everything in it. Its scene comes in parts, so that the
//! first picture is there early: the static Gaussians that show most, the other static ones, then the dynamic ones with
//! their field. A long clip has such parts for each window of time, and the player asks for those that it needs. Static
//! Gaussians that windows share, the room, have parts of their own. Every part is a scene of its own, as
//! [`DynamicScene::to_bytes`](dash_model::DynamicScene::to_bytes) writes it.

mod arrived;
mod names;
mod parts;
mod room;

use std::collections::BTreeMap;
use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use dash_kernels::Camera;
use dash_model::scene_file::TablePrecision;
use dash_model::{DynamicScene, Gaussians, TimeWindows};
use flate2::Compression;
use flate2::write::GzEncoder;
use serde::{Deserialize, Serialize};

pub use arrived::Arrived;
pub use names::{Owner, PartName};
pub use parts::{joined, parts};
use room::Room;
pub use room::RoomParts;

use crate::content::NamedCamera;
use crate::middle::middle_of;
use crate::tracks::Tracks;
use crate::{Content, Source, ViewError, WindowSource};

const INDEX: &str = include_str!("../web/index.html");
const SCRIPT: &str = include_str!("../web/player.js");
const LIVE_SCRIPT: &str = include_str!("../web/live.js");

/// What a page says of its scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// The scene's name.
    pub name: String,
    /// Frames of the clip.
    pub n_frames: usize,
    /// Frames per second at speed 1.
    pub frame_rate: f64,
    /// The point to orbit.
    pub focus: [f64; 3],
    /// The distance from there within which half of the Gaussians are, world units.
    pub radius: f64,
    /// The speed that is shown as the fastest, world units per clip.
    pub fastest: f32,
    /// Cameras to look through.
    pub cameras: Vec<PageCamera>,
    /// When each window of time begins and ends; one of the whole clip where there are none.
    pub times: TimeWindows,
    /// Number of parts of each window; none where a run that trains says which parts there are.
    pub parts: Vec<usize>,
    /// What windows share.
    pub room: RoomParts,
}

/// A camera in a page, OpenCV axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PageCamera {
    /// Its name.
    pub name: String,
    /// Pixels.
    pub width: usize,
    /// Pixels.
    pub height: usize,
    /// Focal lengths, pixels.
    pub focal: [f64; 2],
    /// The principal point, pixels.
    pub principal: [f64; 2],
    /// Rows of the rotation from world to camera.
    pub rotation: [[f64; 3]; 3],
    /// Translation from world to camera.
    pub translation: [f64; 3],
}

impl About {
    /// Of a run that trains, with so many frames at a rate.
    pub fn of_run(
        name: &str,
        (n_frames, frame_rate): (usize, f64),
        focus: [f64; 3],
        cameras: &[NamedCamera],
    ) -> Self {
        let to_focus = |named: &NamedCamera| {
            let offset = glam::DVec3::from(named.camera.position()) - glam::DVec3::from(focus);
            offset.length()
        };
        let nearest = cameras.iter().map(to_focus).fold(f64::INFINITY, f64::min);
        Self {
            name: name.into(),
            n_frames,
            frame_rate,
            focus,
            radius: match nearest.is_normal() {
                true => 0.5 * nearest,
                false => 1.0,
            },
            fastest: 0.0,
            cameras: cameras.iter().map(PageCamera::of).collect(),
            times: TimeWindows::whole(),
            parts: Vec::new(),
            room: RoomParts::none(1),
        }
    }

    fn packed(&self) -> Vec<u8> {
        let json = serde_json::to_vec(self).expect("every key is a string, every value plain");
        packed(&json, Compression::best())
    }

    /// From JSON.
    ///
    /// # Errors
    /// When it is none that this player's version wrote.
    pub fn read(json: &str) -> Result<Self, ViewError> {
        serde_json::from_str(json)
            .map_err(|e| ViewError::Host(format!("the page's description: {e}")))
    }
}

impl PageCamera {
    fn of(named: &NamedCamera) -> Self {
        let camera = &named.camera;
        Self {
            name: named.name.clone(),
            width: camera.width,
            height: camera.height,
            focal: [camera.fx, camera.fy],
            principal: [camera.cx, camera.cy],
            rotation: camera.rotation,
            translation: camera.translation,
        }
    }

    /// The camera.
    pub fn camera(&self) -> Camera {
        let ([fx, fy], [cx, cy]) = (self.focal, self.principal);
        let mut camera = Camera::new(fx, fy, cx, cy, self.width, self.height);
        (camera.rotation, camera.translation) = (self.rotation, self.translation);
        camera
    }
}

/// The player as `web/build.sh` makes it.
#[derive(Debug, Clone, Copy)]
pub struct PlayerCode<'a> {
    /// The module's JavaScript, for pages without modules.
    pub script: &'a str,
    /// The WebAssembly module.
    pub module: &'a [u8],
}

/// A page's files by name, packed.
#[derive(Debug, Clone)]
pub struct Page {
    name: String,
    script: String,
    files: BTreeMap<String, Vec<u8>>,
}

impl Page {
    /// The page of a content; `poster` is the PNG that stands where there is no player.
    ///
    /// # Errors
    /// When the content is a file for each frame, a window can't be read, or the device fails.
    pub fn new(content: &Content, player: PlayerCode, poster: &[u8]) -> Result<Self, ViewError> {
        let mut scenes = Scenes::default();
        let (first, times) = match &content.source {
            Source::Scene(scene) => {
                scenes.add(Owner::Window(0), scene)?;
                scenes.room = RoomParts::none(1);
                ((**scene).clone(), TimeWindows::whole())
            }
            Source::Windows(windows) => {
                scenes.add_windows(&**windows)?;
                (windows.scene(0)?, windows.times().clone())
            }
            _ => {
                return Err(ViewError::Host(
                    "a page shows one scene, or windows of time, not a file for each frame".into(),
                ));
            }
        };
        let (focus, radius) = middle_of(&first)?;
        let duration = times.duration(0);
        let tracks = Tracks::of(&first, (duration * content.n_frames as f32).ceil() as usize)?;
        let about = About {
            name: content.name.clone(),
            n_frames: content.n_frames,
            frame_rate: content.frame_rate,
            focus: content.focus.unwrap_or(focus),
            radius,
            fastest: tracks.map_or(0.0, |tracks| tracks.fastest / duration),
            cameras: content.cameras.iter().map(PageCamera::of).collect(),
            times,
            parts: scenes.parts,
            room: scenes.room,
        };
        let mut files = scenes.files;
        let best = Compression::best();
        files.insert("about.json.gz".into(), about.packed());
        files.insert("player.wasm.gz".into(), packed(player.module, best));
        files.insert("poster.png".into(), poster.to_vec());
        Ok(Self {
            name: content.name.clone(),
            script: player.script.into(),
            files,
        })
    }

    /// The files of a folder for any static host.
    pub fn folder(&self) -> BTreeMap<String, Vec<u8>> {
        let mut files = self.files.clone();
        let scripts = r#"<script src="dash_view.js"></script><script src="player.js"></script>"#;
        let index = index(&self.name, "const FILES = null;", scripts);
        files.insert("index.html".into(), index.into_bytes());
        files.insert("dash_view.js".into(), self.script.clone().into_bytes());
        files.insert("player.js".into(), SCRIPT.into());
        files
    }

    /// One HTML file with everything in it.
    pub fn single_file(&self) -> String {
        let files = self.files.iter();
        let encoded: BTreeMap<&str, String> = files
            .map(|(name, bytes)| (name.as_str(), STANDARD.encode(bytes)))
            .collect();
        let files = serde_json::to_string(&encoded).expect("names and base64");
        let scripts = format!("<script>{}</script><script>{SCRIPT}</script>", self.script);
        index(&self.name, &format!("const FILES = {files};"), &scripts)
    }

    /// Bytes that a browser takes in before the first picture.
    pub fn first_bytes(&self) -> usize {
        let first = ["about.json", "player.wasm", "part0.json", "part0.bin"];
        let of_room = ["room_part0.json", "room_part0.bin"];
        let size = |name: &&str| self.files.get(&format!("{name}.gz")).map(Vec::len);
        let sizes = first
            .iter()
            .map(|name| size(name).expect("every page has it"));
        let files = sizes.sum::<usize>() + of_room.iter().filter_map(size).sum::<usize>();
        files + INDEX.len() + SCRIPT.len() + self.script.len()
    }
}

/// The files of a page that watches a run: its scene's parts come later, see [`scene_files`].
pub fn live_page(about: &About, player: PlayerCode) -> BTreeMap<String, Vec<u8>> {
    let scripts = r#"<script src="dash_view.js"></script><script src="player.js"></script><script src="live.js"></script>"#;
    let index = index(&about.name, "const FILES = null;", scripts);
    BTreeMap::from([
        ("index.html".to_string(), index.into_bytes()),
        ("dash_view.js".into(), player.script.into()),
        ("player.js".into(), SCRIPT.into()),
        ("live.js".into(), LIVE_SCRIPT.into()),
        ("about.json.gz".into(), about.packed()),
        (
            "player.wasm.gz".into(),
            packed(player.module, Compression::best()),
        ),
    ])
}

/// The files of a scene's parts, packed quickly.
///
/// # Errors
/// When the device fails.
pub fn scene_files(scene: &DynamicScene) -> Result<BTreeMap<String, Vec<u8>>, ViewError> {
    files_of(Owner::Window(0), &parts(scene), Compression::fast())
}

/// The files of a page's scenes.
#[derive(Default)]
struct Scenes {
    files: BTreeMap<String, Vec<u8>>,
    /// Number of parts of each window.
    parts: Vec<usize>,
    room: RoomParts,
}

impl Scenes {
    fn add_windows(&mut self, windows: &dyn WindowSource) -> Result<(), ViewError> {
        let n = windows.times().len();
        let room = Room::of(windows)?;
        if let Some(room) = &room {
            let first = windows.scene(0)?;
            let device = first.static_set.means.val().device();
            let scene = DynamicScene {
                static_set: Gaussians::from_rows(&room.rows, &device),
                dynamic: None,
                settings: first.settings,
            };
            self.add(Owner::Room, &scene)?;
        }
        for window in 0..n {
            let (scene, bits) = match &room {
                Some(room) => room.taken_from(windows.scene(window)?),
                None => (windows.scene(window)?, String::new()),
            };
            self.add(Owner::Window(window), &scene)?;
            self.room.windows.push(bits);
        }
        Ok(())
    }

    fn add(&mut self, owner: Owner, scene: &DynamicScene) -> Result<(), ViewError> {
        let parts = parts(scene);
        match owner {
            Owner::Room => self.room.parts = parts.len(),
            Owner::Window(_) => self.parts.push(parts.len()),
        }
        let best = Compression::best();
        self.files.extend(files_of(owner, &parts, best)?);
        Ok(())
    }
}

fn files_of(
    owner: Owner,
    parts: &[DynamicScene],
    compression: Compression,
) -> Result<BTreeMap<String, Vec<u8>>, ViewError> {
    let mut files = BTreeMap::new();
    for (index, part) in parts.iter().enumerate() {
        let name = PartName { owner, index };
        let [json, tensors] = part.to_bytes(TablePrecision::Half)?;
        files.insert(format!("{name}.json.gz"), packed(&json, compression));
        files.insert(format!("{name}.bin.gz"), packed(&tensors, compression));
    }
    Ok(files)
}

fn index(name: &str, files: &str, scripts: &str) -> String {
    let name = name.replace('&', "&amp;").replace('<', "&lt;");
    let name = name.replace('"', "&quot;");
    // The name last: it may hold anything.
    INDEX
        .replace("{{SCRIPTS}}", scripts)
        .replace("{{FILES}}", files)
        .replace("{{NAME}}", &name)
}

fn packed(bytes: &[u8], compression: Compression) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), compression);
    let written = encoder.write_all(bytes).and_then(|()| encoder.finish());
    written.expect("memory takes every byte")
}

#[cfg(test)]
mod tests;
