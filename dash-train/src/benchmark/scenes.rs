//! Which of a protocol's scenes are there.

use std::path::{Path, PathBuf};

use crate::Error;
use crate::dataset::Layout;
use crate::files;
use crate::published::{Protocol, Scene};

/// Most names of folders that an error lists.
const MOST_SHOWN: usize = 8;

/// The scenes of a protocol that are there, and those that are not.
#[derive(Debug, Clone)]
pub struct Found {
    /// Scenes and their folders, in the protocol's order.
    pub scenes: Vec<(&'static Scene, PathBuf)>,
    /// The other scenes that are asked for.
    pub missing: Vec<&'static Scene>,
}

/// Looks for a protocol's scenes in `data`, a folder of scenes or one scene; for those called `wanted`, or for all where it
/// is empty.
///
/// # Errors
/// When none of them is there, one that is wanted is not, or its name is none of the protocol's.
pub fn find_scenes(
    protocol: &'static Protocol,
    data: &Path,
    wanted: &[String],
) -> Result<Found, Error> {
    files::require_folder(data)?;
    let asked = asked_for(protocol, wanted)?;
    let inside = files::list(data)?;
    let mut found = Found {
        scenes: Vec::new(),
        missing: Vec::new(),
    };
    let itself = scene_itself(protocol, data);
    for scene in asked {
        let folder = match itself {
            Some(own) => (own == scene).then(|| data.to_path_buf()),
            None => folder_of(scene, data, &inside),
        };
        match folder {
            Some(folder) => found.scenes.push((scene, folder)),
            None => found.missing.push(scene),
        }
    }
    let lacks = !wanted.is_empty() && !found.missing.is_empty();
    if found.scenes.is_empty() || lacks {
        let names: Vec<&str> = found.missing.iter().map(|scene| scene.name).collect();
        let shown = inside.iter().take(MOST_SHOWN).cloned();
        let shown: Vec<String> = shown.collect();
        let more = if inside.len() > MOST_SHOWN {
            ", .."
        } else {
            ""
        };
        return Err(Error::invalid(
            data,
            format!(
                "folders of {} called {}, or one of these itself",
                protocol.title,
                names.join(", ")
            ),
            match shown.as_slice() {
                [] => "an empty folder".into(),
                shown => format!("{}{more}", shown.join(", ")),
            },
            "name the folder that holds the scenes, and call each as it was published",
        ));
    }
    Ok(found)
}

/// The scenes with these names, in the protocol's order.
fn asked_for(protocol: &'static Protocol, wanted: &[String]) -> Result<Vec<&'static Scene>, Error> {
    if wanted.is_empty() {
        return Ok(protocol.scenes.iter().collect());
    }
    for name in wanted {
        if protocol.scene(name).is_none() {
            return Err(Error::LoadOption {
                option: "--scenes",
                expected: format!(
                    "scenes of {}: {}",
                    protocol.title,
                    protocol.scene_names().join(", ")
                ),
                found: format!("`{name}`"),
            });
        }
    }
    let is_wanted = |scene: &&Scene| wanted.iter().any(|name| scene.is_called(name));
    Ok(protocol.scenes.iter().filter(is_wanted).collect())
}

/// The scene that the folder itself is, by its name and its files.
fn scene_itself(protocol: &'static Protocol, data: &Path) -> Option<&'static Scene> {
    let real = data.canonicalize().ok()?;
    let scene = protocol.scene(&real.file_name()?.to_string_lossy())?;
    Layout::detect(data).ok().map(|_| scene)
}

/// The folder of a scene among those in `data`; its published name counts before its aliases.
fn folder_of(scene: &Scene, data: &Path, inside: &[String]) -> Option<PathBuf> {
    let names = inside.iter().filter(|name| scene.is_called(name));
    let mut folders: Vec<&String> = names.filter(|name| data.join(name).is_dir()).collect();
    folders.sort_by_key(|name| !name.eq_ignore_ascii_case(scene.name));
    folders.first().map(|name| data.join(name))
}
