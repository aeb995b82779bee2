//! Which images of `transforms*.json` are trained on, and which are held out.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::entries::{Entry, entry_name};
use crate::Error;
use crate::dataset::loader::Loader;
use crate::dataset::partition::every_eighth;
use crate::dataset::poses::transforms::Transforms;
use crate::files::{self};

/// Decides for the frames of a single file: by nerfstudio's lists if these name any, else every eighth by name is
/// held out. If there is a list of training frames, frames in no list are dropped.
pub(super) fn hold_out(
    root: &Path,
    listed_in: &Path,
    transforms: &Transforms,
    entries: &mut Vec<Entry>,
) {
    let key = |name: &str| files::one_form(name).into_owned();
    let file_paths = transforms
        .frames
        .iter()
        .map(|frame| frame.file_path.as_str());
    let of_frames = file_paths
        .filter_map(|path| files::confined(root, path, listed_in).ok())
        .map(|path| key(&entry_name(path.strip_prefix(root).unwrap_or(&path))));
    let of_entries = entries.iter().map(|entry| key(&entry.name));
    let known: HashSet<String> = of_frames.chain(of_entries).collect();
    let listed = |key_of_list: &str, list: &[String]| -> Option<HashSet<String>> {
        let names: HashSet<String> = list
            .iter()
            .filter_map(|name| files::confined(root, name, listed_in).ok())
            .map(|path| key(&entry_name(path.strip_prefix(root).unwrap_or(&path))))
            .collect();
        // A frame may have been left out, since its picture can't be read.
        let unknown = names.iter().filter(|name| !known.contains(*name)).count();
        if unknown > 0 {
            let example = entries.first().map_or("", |entry| entry.name.as_str());
            tracing::warn!(
                "{}: {unknown} of the {} names in {key_of_list} are those of no frame, whose names are as {example}",
                listed_in.display(),
                names.len()
            );
        }
        let is_any = entries
            .iter()
            .any(|entry| names.contains(&key(&entry.name)));
        is_any.then_some(names)
    };
    let train = listed("train_filenames", &transforms.train_filenames);
    let held_out = listed("test_filenames", &transforms.test_filenames)
        .or_else(|| listed("val_filenames", &transforms.val_filenames));
    match (train, held_out) {
        (None, None) => {
            let lists = [
                &transforms.train_filenames,
                &transforms.test_filenames,
                &transforms.val_filenames,
            ];
            if lists.iter().any(|list| !list.is_empty()) {
                tracing::warn!(
                    "{}: no list names a frame: every eighth picture is held out",
                    listed_in.display()
                );
            }
            hold_out_every_eighth(entries);
        }
        (None, Some(held_out)) => {
            for entry in entries {
                entry.held_out = held_out.contains(&key(&entry.name));
            }
        }
        (Some(train), None) => {
            for entry in entries {
                entry.held_out = !train.contains(&key(&entry.name));
            }
        }
        (Some(train), Some(held_out)) => {
            let in_both = train.intersection(&held_out).count();
            if in_both > 0 {
                tracing::warn!(
                    "{}: {in_both} pictures of train_filenames are to be held out, too: they are not trained on",
                    listed_in.display()
                );
            }
            for entry in entries.iter_mut() {
                entry.held_out = held_out.contains(&key(&entry.name));
            }
            entries.retain(|entry| entry.held_out || train.contains(&key(&entry.name)));
        }
    }
}

fn hold_out_every_eighth(entries: &mut [Entry]) {
    let mut order: Vec<usize> = (0..entries.len()).collect();
    order.sort_by(|&a, &b| files::natural_cmp(&entries[a].name, &entries[b].name));
    for (index, held_out) in order.into_iter().zip(every_eighth(entries.len())) {
        entries[index].held_out = held_out;
    }
}

/// Drops training entries whose image is held out too, with a warning: otherwise test scores would measure
/// training images.
///
/// # Errors
/// When no other training image is left, unless `--test-cameras` decides.
pub(super) fn drop_held_out(
    loader: &Loader,
    listed_in: &Path,
    entries: &mut Vec<Entry>,
) -> Result<(), Error> {
    let picture = |entry: &Entry| -> PathBuf {
        let real = entry.file.canonicalize();
        real.unwrap_or_else(|_| entry.file.clone())
    };
    let held_out = entries.iter().filter(|entry| entry.held_out);
    let pictures: HashSet<PathBuf> = held_out.map(picture).collect();
    let n_listed = entries.len();
    let train = entries.iter().filter(|entry| !entry.held_out);
    let example = train
        .clone()
        .find(|entry| pictures.contains(&picture(entry)));
    let Some(example) = example.map(|entry| entry.name.clone()) else {
        return Ok(());
    };
    let n_train = train.count();
    entries.retain(|entry| entry.held_out || !pictures.contains(&picture(entry)));
    let n_dropped = n_listed - entries.len();
    if n_dropped == n_train && loader.options.test_cameras.is_none() {
        let held_out_by = entries
            .first()
            .map_or(listed_in, |entry| entry.listed_in.as_path());
        return Err(Error::invalid(
            held_out_by,
            format!(
                "other pictures than those to train on of {}",
                listed_in.display()
            ),
            format!("all {n_train} of them"),
            "list others there, or none: every eighth is held out then",
        ));
    }
    tracing::warn!(
        "{}: {n_dropped} of {n_train} pictures to train on, such as {example}, are held out, too: they are not \
         trained on",
        listed_in.display()
    );
    Ok(())
}
