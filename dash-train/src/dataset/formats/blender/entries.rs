//! The frames of `transforms*.json`: their images, masks, times and cameras.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;

use crate::Error;
use crate::dataset::loader::Loader;
use crate::dataset::pixels::dimensions;
use crate::dataset::pixels::distortion::Distortion;
use crate::dataset::pixels::sizes::Sizes;
use crate::dataset::poses::pose;
use crate::dataset::poses::transforms::{Frame, Transforms};
use crate::files::{self, find_image};

/// A frame of any of the files.
pub(super) struct Entry {
    pub(super) file: PathBuf,
    pub(super) mask: Option<PathBuf>,
    pub(super) name: String,
    pub(super) camera_name: Option<String>,
    pub(super) time: Option<f64>,
    pub(super) seconds: Option<f64>,
    pub(super) timestep_index: Option<f64>,
    pub(super) camera: Camera,
    pub(super) distortion: Distortion,
    pub(super) listed_in: PathBuf,
    pub(super) held_out: bool,
}

/// Adds the frames of a file to the entries.
pub(super) fn collect(
    loader: &Loader,
    listed_in: &Path,
    transforms: &Transforms,
    held_out: bool,
    sizes: &mut Sizes,
    entries: &mut Vec<Entry>,
) -> Result<(), Error> {
    transforms.warn_of_keys(listed_in);
    let mut lacking_masks = 0;
    for frame in &transforms.frames {
        let mut found = files::confined(loader.root, &frame.file_path, listed_in)
            .and_then(|file| find_image(file, listed_in));
        if loader.options.skip_broken {
            found = found.and_then(|file| dimensions(&file).map(|_| file));
        }
        let name = format!("the frame {}", frame.file_path);
        let Some(file) = loader.broken.readable(&name, found)? else {
            continue;
        };
        let (camera, distortion) = transforms.camera(listed_in, frame, || dimensions(&file))?;
        let finite = distortion.is_finite() && frame.time.is_none_or(f64::is_finite);
        if !finite {
            return Err(Error::invalid(
                listed_in,
                "finite times and distortion coefficients",
                format!("NaN or infinity in frame `{}`", frame.file_path),
                "mend that frame's entry",
            ));
        }
        let camera = sizes.fit(camera, &file);
        let mask = named_mask(loader.root, frame, listed_in);
        lacking_masks += usize::from(mask.is_none() && frame.mask_path().is_some());
        let inside = file.strip_prefix(loader.root).unwrap_or(&file);
        entries.push(Entry {
            name: entry_name(inside),
            mask,
            file,
            camera_name: frame.camera_name().map(str::to_string),
            time: frame.time,
            timestep_index: frame.timestep_index(),
            seconds: frame.seconds(),
            camera,
            distortion,
            listed_in: listed_in.to_path_buf(),
            held_out,
        });
    }
    if lacking_masks > 0 {
        tracing::warn!(
            "{}: {lacking_masks} masks named by mask_path are not there; masks/NAME.png is looked for instead",
            listed_in.display()
        );
    }
    Ok(())
}

/// The mask that a frame names, where it is there.
fn named_mask(root: &Path, frame: &Frame, listed_in: &Path) -> Option<PathBuf> {
    let mask = files::confined(root, frame.mask_path()?, listed_in).ok()?;
    mask.is_file().then_some(mask)
}

/// A path below the dataset without its extension.
pub(super) fn entry_name(inside: &Path) -> String {
    let stem = inside.with_extension("");
    stem.to_string_lossy().replace('\\', "/")
}

/// Uses `timestep_index` as the time if no frame has a time and each has an index.
pub(super) fn number_times(entries: &mut [Entry]) {
    let is_numbered = |entry: &Entry| entry.time.is_none() && entry.timestep_index.is_some();
    if entries.iter().all(is_numbered) {
        for entry in entries {
            entry.time = entry.timestep_index;
        }
    }
}

/// A warning for captures without times in which a camera has several images.
pub(super) fn at_one_instant(camera_of: &[usize], names: &[String]) -> Option<String> {
    let count = |camera: usize| camera_of.iter().filter(|&&of| of == camera).count();
    let (n, name) = (0..names.len())
        .map(|camera| (count(camera), &names[camera]))
        .find(|(n, _)| *n > 1)?;
    Some(format!(
        "no frame has a `time`, and {name} has {n} pictures: all are taken as one instant"
    ))
}

/// What is said of pictures that are listed more than once.
pub(super) fn repeats(entries: &[Entry]) -> Option<String> {
    let mut first_of: HashMap<&Path, &Entry> = HashMap::new();
    let (mut n, mut example, mut n_other) = (0, None, 0);
    for entry in entries {
        let first = *first_of.entry(&entry.file).or_insert(entry);
        if std::ptr::eq(first, entry) {
            continue;
        }
        n += 1;
        example.get_or_insert(&entry.name);
        n_other += usize::from(first.camera != entry.camera || first.time != entry.time);
    }
    let example = example?;
    let differ = match n_other {
        0 => String::new(),
        _ => format!(" ({n_other} with another pose or time)"),
    };
    Some(format!(
        "{n} frames name a picture that an earlier frame names, such as {example}{differ}: all are used"
    ))
}

/// What is said where held-out pictures lie far outside the time that is trained on: theirs may be in another unit.
pub(super) fn other_times(entries: &[Entry]) -> Option<String> {
    let span = |held_out: bool| {
        let of = entries.iter().filter(|entry| entry.held_out == held_out);
        let times = of.filter_map(|entry| entry.time);
        times.fold(None, |ends: Option<[f64; 2]>, time| {
            let [first, last] = ends.unwrap_or([time; 2]);
            Some([first.min(time), last.max(time)])
        })
    };
    let ([start, end], [first, last]) = (span(false)?, span(true)?);
    let length = end - start;
    let is_far = length > 0.0 && (last > end + length || first < start - length);
    is_far.then(|| {
        format!(
            "times to hold out go from {first} to {last}, those to train on from {start} to {end}: if these are two units, state \
             both in one"
        )
    })
}

/// Either every frame has a time or none has.
pub(super) fn check_times(entries: &[Entry]) -> Result<(), Error> {
    let with_time = entries.iter().any(|entry| entry.time.is_some());
    match entries.iter().find(|entry| entry.time.is_none()) {
        Some(entry) if with_time => Err(Error::invalid(
            &entry.listed_in,
            "`time` in every frame or in none",
            format!("none in frame `{}`", entry.name),
            "add the missing times",
        )),
        _ => Ok(()),
    }
}

/// For each entry the index of its camera, and the cameras' names. The file's names are used if every entry has
/// one and each belongs to one pose; else distinct poses are numbered.
pub(super) fn cameras(entries: &[Entry]) -> (Vec<usize>, Vec<String>) {
    let stated: Option<Vec<&String>> = entries.iter().map(|e| e.camera_name.as_ref()).collect();
    let Some(stated) = stated.filter(|names| stand_still(names, entries)) else {
        let (indices, n) = pose::distinct_poses(entries.iter().map(|e| &e.camera));
        return (indices, (0..n).map(|n| format!("cam{n:02}")).collect());
    };
    let mut names: Vec<String> = stated.iter().copied().cloned().collect();
    names.sort_by(|a, b| files::natural_cmp(a, b));
    names.dedup();
    let index = |name| names.binary_search_by(|other| files::natural_cmp(other, name));
    let indices = stated.iter().map(|name| index(name).unwrap_or_default());
    (indices.collect(), names)
}

/// Whether entries of one name have one pose; otherwise the camera is handheld.
fn stand_still(names: &[&String], entries: &[Entry]) -> bool {
    let extent = pose::extent(entries.iter().map(|entry| &entry.camera));
    let mut poses: HashMap<&str, &Camera> = HashMap::new();
    names.iter().zip(entries).all(|(name, entry)| {
        let first = poses.entry(name.as_str()).or_insert(&entry.camera);
        pose::same_pose(first, &entry.camera, extent)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(file: &str, time: f64, held_out: bool) -> Entry {
        Entry {
            file: file.into(),
            mask: None,
            name: file.into(),
            camera_name: None,
            time: Some(time),
            seconds: None,
            timestep_index: None,
            camera: Camera::new(1.0, 1.0, 1.0, 1.0, 2, 2),
            distortion: Distortion::default(),
            listed_in: "transforms.json".into(),
            held_out,
        }
    }

    #[test]
    fn pictures_that_are_listed_twice_are_told() {
        let of = |times: &[(&str, f64)]| {
            let entries: Vec<Entry> = times
                .iter()
                .map(|&(file, time)| entry(file, time, false))
                .collect();
            repeats(&entries)
        };
        assert_eq!(of(&[("a", 0.0), ("b", 0.0)]), None);
        let same = of(&[("a", 0.0), ("b", 1.0), ("a", 0.0), ("a", 0.0)]).expect("twice more");
        assert!(
            same.contains("2 frames name") && same.contains("such as a: all"),
            "{same}"
        );
        let other = of(&[("a", 0.0), ("b", 1.0), ("b", 0.0)]).expect("once more");
        assert!(other.contains("such as b (1 with another"), "{other}");
    }

    #[test]
    fn held_out_times_in_another_unit_are_told() {
        let of = |held_out: [f64; 2]| {
            let [first, last] = held_out.map(|time| entry("b", time, true));
            other_times(&[entry("a", 0.0, false), entry("a", 1.0, false), first, last])
        };
        for held_out in [[0.0, 1.0], [0.3, 0.4], [1.1, 1.9], [-0.5, 0.0]] {
            assert_eq!(of(held_out), None, "{held_out:?}");
        }
        for held_out in [[0.0, 49.0], [-3.0, 0.0]] {
            let said = of(held_out).expect("another unit");
            assert!(said.contains("from 0 to 1: if"), "{said}");
        }
        assert_eq!(
            other_times(&[entry("a", 0.0, false), entry("b", 9.0, true)]),
            None
        );
    }

    #[test]
    fn several_pictures_of_a_camera_without_times_are_told() {
        let names = ["left".to_string(), "right".to_string()];
        assert_eq!(at_one_instant(&[0, 1], &names), None);
        let said = at_one_instant(&[0, 1, 1], &names).expect("two of one camera");
        assert!(said.contains("right has 2 pictures"), "{said}");
    }
}
