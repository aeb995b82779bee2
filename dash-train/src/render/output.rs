//! Folders of pictures and videos, complete or absent.

use std::fs;
use std::path::{Path, PathBuf};

use dash_model::unfinished::Unfinished;
use dash_model::{Layer, Picture};

use super::picture::{PictureLayer, render_mixed};
use super::shots::Shot;
use crate::cameras::{CameraEntry, cameras_text, write_cameras};
use crate::files::is_occupied;
use crate::video::{VideoWriter, rgb8, write_exr_plane, write_exr_rgb, write_png};
use crate::{Error, SceneOverTime};

/// Frames per second of videos of what has no rate of its own.
pub const FRAME_RATE: f64 = 30.0;
/// The list of the pictures' cameras beside them.
const CAMERAS_FILE: &str = "cameras.json";

/// File format of pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum PictureFormat {
    /// 8 bits, values clamped to [0, 1]. Depth is scaled per picture: the nearest surface white, the
    /// farthest black, and black where there is no surface.
    #[default]
    Png,
    /// 32-bit floats as rendered; depth in world units, 0 where there is no surface.
    Exr,
}

impl PictureFormat {
    fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Exr => "exr",
        }
    }
}

/// Pictures to take of a scene.
pub struct RenderJob<'a> {
    /// The scene, a run's or a clip's.
    pub scene: &'a dyn SceneOverTime,
    /// Which cameras at which times, in the order of the files.
    pub shots: &'a [Shot],
    /// Called with the number of shots done after each.
    pub on_shot: &'a mut dyn FnMut(usize),
}

/// Renders every shot to `out/LAYER/NNNN_NAME.png` (or `.exr`), `NNNN` counting shots from 0, and lists
/// the pictures' poses, intrinsics and times in `out/cameras.json` ([`write_cameras`]), by their names
/// without extension.
///
/// The layers' folders appear when everything is rendered: a failure leaves nothing behind.
///
/// # Errors
/// When `out` can't be written, one of the layers' folders holds files already, `out/cameras.json` is
/// another file than would be written, or a kernel refuses its input.
pub fn write_pictures(
    job: RenderJob<'_>,
    layers: &[PictureLayer],
    format: PictureFormat,
    out: &Path,
) -> Result<(), Error> {
    let scratch = scratch_for(out)?;
    for layer in layers {
        refuse_occupied(&out.join(layer.to_string()))?;
        let folder = scratch.path().join(layer.to_string());
        fs::create_dir(&folder).map_err(|e| Error::io(&folder, "create", e))?;
    }
    let list = out.join(CAMERAS_FILE);
    let listed = entries(job.shots);
    refuse_other_list(&list, &listed)?;
    for ((index, shot), entry) in job.shots.iter().enumerate().zip(&listed) {
        let drawn = job.scene.drawn_at(shot.time)?;
        let name = format!("{}.{}", entry.img_name, format.extension());
        for drawn_from in [Layer::Full, Layer::Static, Layer::Dynamic] {
            let shown: Vec<PictureLayer> = layers
                .iter()
                .copied()
                .filter(|layer| layer.drawn_from() == drawn_from)
                .collect();
            if shown.is_empty() {
                continue;
            }
            let picture = render_mixed(&drawn, &shot.camera, drawn_from)?;
            for layer in shown {
                let path = scratch.path().join(layer.to_string()).join(&name);
                write_picture(&path, &picture, layer, format)?;
            }
        }
        (job.on_shot)(index + 1);
    }
    write_cameras(&scratch.path().join(CAMERAS_FILE), &listed)?;
    scratch.finish(|scratch| put(scratch, layers, out))
}

/// Puts the layers' folders and the list of cameras in their places: in one step where there is no such folder yet.
fn put(scratch: &Path, layers: &[PictureLayer], out: &Path) -> Result<(), Error> {
    if fs::symlink_metadata(out).is_err() {
        let parent = out.parent().unwrap_or(out);
        fs::create_dir_all(parent).map_err(|e| Error::io(parent, "create", e))?;
        return fs::rename(scratch, out).map_err(|e| Error::io(out, "write", e));
    }
    for layer in layers {
        let name = layer.to_string();
        let to = out.join(&name);
        if to.exists() {
            // Not every system renames over an empty folder.
            fs::remove_dir(&to).map_err(|e| Error::io(&to, "replace", e))?;
        }
        fs::rename(scratch.join(&name), &to).map_err(|e| Error::io(&to, "write", e))?;
    }
    let list = out.join(CAMERAS_FILE);
    fs::rename(scratch.join(CAMERAS_FILE), &list).map_err(|e| Error::io(&list, "write", e))
}

/// The shots as a list of cameras, under the names of their pictures.
fn entries(shots: &[Shot]) -> Vec<CameraEntry> {
    let entry = |(index, shot): (usize, &Shot)| CameraEntry {
        id: index as u64,
        img_name: format!("{index:04}_{}", file_name(&shot.name)),
        camera: shot.camera.clone(),
        time: Some(f64::from(shot.time)),
    };
    shots.iter().enumerate().map(entry).collect()
}

/// Refuses to replace another list of cameras: it may be the user's own, or belong to other pictures.
fn refuse_other_list(path: &Path, cameras: &[CameraEntry]) -> Result<(), Error> {
    let text = cameras_text(path, cameras)?;
    match fs::read(path) {
        Ok(found) if found == text => Ok(()),
        Ok(_) => Err(Error::run(
            path,
            "expected no such file or that of the same pictures, found another; \
             remove it or choose another --out",
        )),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(()),
        Err(e) => Err(Error::io(path, "read", e)),
    }
}

/// Renders every shot as a frame of the MP4 video `out`, `frame_rate` of them a second. An existing file is replaced once the video is complete.
///
/// # Errors
/// When ffmpeg is missing, `out` can't be written, the shots differ in size, or a kernel refuses
/// its input.
pub fn write_video(
    job: RenderJob<'_>,
    layer: PictureLayer,
    frame_rate: f64,
    out: &Path,
) -> Result<(), Error> {
    let Some(first) = job.shots.first() else {
        return Err(Error::run(
            out,
            "expected at least one frame to write, found none",
        ));
    };
    let size = (first.camera.width, first.camera.height);
    let same = |shot: &Shot| (shot.camera.width, shot.camera.height) == size;
    if let Some(other) = job.shots.iter().find(|shot| !same(shot)) {
        return Err(Error::run(
            out,
            format!(
                "expected cameras of one size for a video, found {}x{} and {}x{}; render pictures \
                 into a folder, or one camera at a time",
                size.0, size.1, other.camera.width, other.camera.height
            ),
        ));
    }
    let mut writer = VideoWriter::create(out, size.0, size.1, frame_rate)?;
    for (index, shot) in job.shots.iter().enumerate() {
        let drawn = job.scene.drawn_at(shot.time)?;
        let picture = render_mixed(&drawn, &shot.camera, layer.drawn_from())?;
        writer.push(&shown(&picture, layer))?;
        (job.on_shot)(index + 1);
    }
    writer.finish()
}

fn write_picture(
    path: &Path,
    picture: &Picture,
    layer: PictureLayer,
    format: PictureFormat,
) -> Result<(), Error> {
    let (width, height) = (picture.width, picture.height);
    match (format, layer) {
        (PictureFormat::Png, _) => write_png(path, width, height, &shown(picture, layer)),
        (PictureFormat::Exr, PictureLayer::Alpha) => {
            write_exr_plane(path, width, height, &picture.alpha)
        }
        (PictureFormat::Exr, PictureLayer::Depth) => {
            write_exr_plane(path, width, height, &picture.depth)
        }
        (PictureFormat::Exr, _) => write_exr_rgb(path, width, height, &picture.rgb),
    }
}

/// What a layer looks like, `[H, W, 3]` in 8 bits.
fn shown(picture: &Picture, layer: PictureLayer) -> Vec<u8> {
    let gray = |plane: &[f32]| rgb8(plane).into_iter().flat_map(|v| [v; 3]).collect();
    match layer {
        PictureLayer::Full | PictureLayer::Static | PictureLayer::Dynamic => rgb8(&picture.rgb),
        PictureLayer::Alpha => gray(&picture.alpha),
        PictureLayer::Depth => gray(&picture.nearness()),
    }
}

/// A scratch folder on the file system of `out`.
fn scratch_for(out: &Path) -> Result<Unfinished, Error> {
    let name = out.file_name().unwrap_or_default();
    let path = existing_ancestor(out)?.join(name);
    Unfinished::folder(&path).map_err(|e| Error::io(out, "write", e))
}

/// The nearest folder on the way to `out` that exists.
fn existing_ancestor(out: &Path) -> Result<PathBuf, Error> {
    let mut place = out;
    loop {
        match fs::metadata(place) {
            Ok(found) if found.is_dir() => return Ok(place.to_path_buf()),
            Ok(_) => {
                return Err(Error::run(
                    out,
                    format!(
                        "expected a folder to write to, found the file {}; choose another --out",
                        place.display()
                    ),
                ));
            }
            Err(_) => match place.parent() {
                Some(parent) if parent != Path::new("") => place = parent,
                _ => return Ok(PathBuf::from(".")),
            },
        }
    }
}

fn refuse_occupied(folder: &Path) -> Result<(), Error> {
    if is_occupied(folder).map_err(|e| Error::io(folder, "list", e))? {
        return Err(Error::run(
            folder,
            "expected no such folder or an empty one, found files in it; \
             remove it or choose another --out",
        ));
    }
    Ok(())
}

/// A camera's name with what file systems refuse replaced.
fn file_name(camera: &str) -> String {
    let safe = |c: char| {
        if c.is_alphanumeric() || "-_.".contains(c) {
            c
        } else {
            '_'
        }
    };
    camera.chars().map(safe).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_of_other_cameras_is_not_replaced() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join(CAMERAS_FILE);
        let shot = |time| Shot {
            camera_name: "cam00".into(),
            name: "test/r_0".into(),
            camera: dash_kernels::Camera::new(9.0, 9.0, 4.0, 3.0, 8, 6),
            time,
        };
        let listed = entries(&[shot(0.0), shot(0.5)]);
        assert_eq!(listed[1].img_name, "0001_test_r_0");
        refuse_other_list(&path, &listed).expect("there is none");
        write_cameras(&path, &listed).expect("writable");
        refuse_other_list(&path, &listed).expect("the same");
        let error = refuse_other_list(&path, &entries(&[shot(0.0)])).expect_err("another");
        assert!(error.to_string().contains("cameras.json"), "{error}");
    }

    #[test]
    fn file_names_hold_no_separators() {
        assert_eq!(file_name("train/r_0001 (2)"), "train_r_0001__2_");
        assert_eq!(file_name("../x"), ".._x");
    }
}
