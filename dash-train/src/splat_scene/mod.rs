//! Files of Gaussians as scenes.
//!
//! [`splat_scene`]: a file in which nothing moves. [`SplatClip`]: whatever can be played. [`SceneOverTime`]: what can be drawn at any
//! time, a run's scene, a clip and windows alike. `four_dgs`: the clips of other players (`.4dgs`).

mod clip;
#[cfg(feature = "fourdgs")]
pub mod four_dgs;
mod instant;

use std::path::{Path, PathBuf};

use burn::tensor::Device;
use dash_model::{
    DynamicScene, Gaps, GaussianRows, Gaussians, OffsetPlacement, SceneSettings, SplatFile,
    SplatFormat, TrajectoryBasis, read_splats,
};

pub use clip::{Drawn, SceneOverTime, SplatClip};
pub use instant::rows_at;

use crate::Error;
use crate::files::{check_order, list};

/// The Gaussians of a file as a scene in which nothing moves, over black.
///
/// # Errors
/// When the file can't be read, or is damaged.
pub fn splat_scene(path: &Path, device: &Device) -> Result<DynamicScene, Error> {
    let SplatFile {
        rows,
        near_plane,
        left_out,
    } = read_splats(path)?;
    if left_out.count() > 0 {
        tracing::warn!("{}: left out Gaussians: {left_out}", path.display());
    }
    Ok(at_rest(&rows, near_plane, device))
}

/// A scene of Gaussians that do not move, over black.
fn at_rest(rows: &GaussianRows, near_plane: f64, device: &Device) -> DynamicScene {
    let static_set = Gaussians::from_rows(rows, device);
    let settings = SceneSettings {
        background: [0.0; 3],
        sh_degree: static_set.sh_degree(),
        near_plane,
        // Nothing moves, so that these change nothing.
        trajectory_basis: TrajectoryBasis::polyline(4),
        offsets: OffsetPlacement::BeforeActivation,
        gaps: Gaps::default(),
    };
    DynamicScene {
        static_set,
        dynamic: None,
        settings,
    }
}

/// The files of Gaussians in a folder, one for each frame, in the order of time.
///
/// # Errors
/// When there is none, or their names do not say the order.
pub fn splat_files(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let names: Vec<String> = list(folder)?
        .into_iter()
        .filter(|name| SplatFormat::of(Path::new(name)).is_some())
        .collect();
    if names.is_empty() {
        return Err(Error::invalid(
            folder,
            "a run (with config.toml) or files of Gaussians (.ply, .spz, .splat, .glb), one for each frame",
            "neither",
            "name another folder",
        ));
    }
    if let Some(told) = check_order(folder, &names)? {
        tracing::warn!("{}: {told}", folder.display());
    }
    Ok(names.into_iter().map(|name| folder.join(name)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_files_is_read_in_the_order_of_time() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let refused = |folder: &Path| splat_files(folder).expect_err("refused").to_string();
        assert!(refused(folder.path()).contains("one for each frame"));
        for name in ["f10.ply", "f9.ply", "f100.PLY", "notes.txt"] {
            std::fs::write(folder.path().join(name), "").expect("writable");
        }
        let names: Vec<PathBuf> = splat_files(folder.path()).expect("in order");
        let expected = ["f9.ply", "f10.ply", "f100.PLY"].map(|name| folder.path().join(name));
        assert_eq!(names, expected);
        let scene = splat_scene(&names[0], &Device::flex()).expect_err("an empty file");
        assert!(scene.to_string().contains("f9.ply"));
    }
}
