//! The cameras of the input: a video, a folder of images, or a single image each.

use std::path::{Path, PathBuf};

use crate::Error;
use crate::files::{self, VIDEO_EXTENSIONS};

/// Folders that are searched for cameras if the input has none itself.
const INNER_FOLDERS: [&str; 2] = ["videos", "images"];

/// A camera of the rig.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Source {
    /// The video's or folder's name without extension.
    pub(super) name: String,
    /// What it recorded.
    pub(super) recording: Recording,
}

/// What a camera recorded.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Recording {
    /// A video file.
    Video(PathBuf),
    /// Image files in their order, at least one.
    Images(Vec<PathBuf>),
}

/// The cameras in `input`, by name in natural order: videos, else folders of images, else single
/// images; where there are none, those in `input/videos` or `input/images`.
pub(super) fn find(input: &Path) -> Result<Vec<Source>, Error> {
    let mut folders = vec![input.to_path_buf()];
    folders.extend(INNER_FOLDERS.map(|name| input.join(name)));
    for folder in folders {
        if folder != input && !folder.is_dir() {
            continue;
        }
        let mut sources = videos(&folder)?;
        if sources.is_empty() {
            sources = image_folders(&folder)?;
        } else {
            warn_of_unread(&folder)?;
        }
        if sources.is_empty() {
            sources = single_images(&folder)?;
        }
        if !sources.is_empty() {
            sources.sort_by(|a, b| files::natural_cmp(&a.name, &b.name));
            check_order(&folder, &sources)?;
            return check(input, sources);
        }
    }
    Err(Error::invalid(
        input,
        format!(
            "one video per camera (.{}), or one folder of images per camera (cam00/0000.png, ..)",
            VIDEO_EXTENSIONS.join(", .")
        ),
        "none of these",
        "put them there, named after their cameras",
    ))
}

/// Refuses images whose order in time their names don't tell.
fn check_order(folder: &Path, sources: &[Source]) -> Result<(), Error> {
    let mut told = None;
    for source in sources {
        let Recording::Images(images) = &source.recording else {
            continue;
        };
        let stems: Vec<String> = images.iter().map(|path| files::stem(path)).collect();
        let found = files::check_order(&folder.join(&source.name), &stems)?;
        told = told.or(found);
    }
    if let Some(told) = told {
        tracing::warn!("{}: {told}", folder.display());
    }
    Ok(())
}

fn check(input: &Path, sources: Vec<Source>) -> Result<Vec<Source>, Error> {
    if let Some(pair) = sources.windows(2).find(|pair| pair[0].name == pair[1].name) {
        return Err(Error::invalid(
            input,
            "one file per camera",
            format!("several of the name `{}`", pair[0].name),
            "rename or remove one of them",
        ));
    }
    if let [only] = &sources[..] {
        return Err(Error::invalid(
            input,
            "at least two cameras",
            format!("one, `{}`", only.name),
            "add the other cameras' videos or folders; a rig is prepared, not one moving camera",
        ));
    }
    Ok(sources)
}

fn videos(folder: &Path) -> Result<Vec<Source>, Error> {
    let names = files::list(folder)?;
    let paths = names
        .iter()
        .filter(|name| files::has_extension(name, &VIDEO_EXTENSIONS))
        .map(|name| folder.join(name));
    Ok(paths
        .filter(|path| path.is_file())
        .map(|path| Source {
            name: files::stem(&path),
            recording: Recording::Video(path),
        })
        .collect())
}

fn image_folders(folder: &Path) -> Result<Vec<Source>, Error> {
    let mut sources = Vec::new();
    for name in files::list(folder)? {
        let path = folder.join(&name);
        if !path.is_dir() {
            continue;
        }
        let inner = path.join("images");
        let images = files::list_images(if inner.is_dir() { &inner } else { &path })?;
        if !images.is_empty() {
            sources.push(Source {
                name,
                recording: Recording::Images(images),
            });
        }
    }
    // A lone folder `images` holds the images of all cameras.
    if let [only] = &sources[..]
        && INNER_FOLDERS.contains(&only.name.as_str())
    {
        sources.clear();
    }
    Ok(sources)
}

/// Tells of folders of images beside videos.
fn warn_of_unread(folder: &Path) -> Result<(), Error> {
    let beside = image_folders(folder)?;
    let names: Vec<&str> = beside.iter().map(|source| source.name.as_str()).collect();
    if !names.is_empty() {
        tracing::warn!(
            "{}: cameras are its videos; folders of images beside them are not read: {}",
            folder.display(),
            names.join(", ")
        );
    }
    Ok(())
}

fn single_images(folder: &Path) -> Result<Vec<Source>, Error> {
    let images = files::list_images(folder)?;
    Ok(images
        .into_iter()
        .map(|path| Source {
            name: files::stem(&path),
            recording: Recording::Images(vec![path]),
        })
        .collect())
}

/// The time in seconds of every image of every camera at `rate` images a second: by the numbers in
/// their names where every image has one, so that a missing image shows, else by their order.
pub(super) fn image_times(cameras: &[&[PathBuf]], rate: f64) -> Vec<Vec<f64>> {
    let by_order = || {
        cameras
            .iter()
            .map(|images| (0..images.len()).map(|k| k as f64 / rate).collect())
            .collect()
    };
    if cameras.iter().all(|images| images.len() == 1) {
        return by_order();
    }
    let numbers = |images: &&[PathBuf]| {
        let stems: Vec<String> = images.iter().map(|path| files::stem(path)).collect();
        let numbers = files::frame_numbers(&stems).into_iter();
        let numbers: Option<Vec<u64>> = numbers.map(|digits| digits?.parse().ok()).collect();
        let numbers = numbers?;
        numbers.is_sorted_by(|a, b| a < b).then_some(numbers)
    };
    let Some(numbered) = cameras.iter().map(numbers).collect::<Option<Vec<_>>>() else {
        return by_order();
    };
    let first = numbered.iter().flatten().min().copied().unwrap_or(0);
    numbered
        .iter()
        .map(|numbers| numbers.iter().map(|n| (n - first) as f64 / rate).collect())
        .collect()
}
