//! Checkpoints: everything an exact resume needs, complete or absent.

mod damage;
mod fingerprint;
mod start;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use dash_model::DynamicScene;
use dash_model::parameters::HostTensor;
use dash_model::scene_file::{read_tensors, write_atomically, write_tensors};
use dash_model::unfinished::{Unfinished, discard};
use rand_pcg::Pcg64;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::backdrop::Kept;
use super::hooks::Hooks;
use super::method::Method;
use super::optimizer::Optimizer;
use super::run::Run;
use super::sampler::ViewSampler;
use super::saved::Saved;
use super::sets::Set;
use super::view_sums::ViewSums;
use crate::Error;
use crate::dataset::Dataset;
pub(crate) use damage::with_remedy;
use fingerprint::Fingerprint;
use start::{POINTS, SavedStart};

/// Checkpoints that are kept; older ones are removed once a newer one is complete.
const KEPT: usize = 2;
/// The file of the method's tensors.
const METHOD: &str = "method";

/// What is not a tensor. `C` is the configuration that the run was begun with.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct State<C> {
    step: usize,
    pub(crate) train_seconds: f64,
    rng: Pcg64,
    sampler: ViewSampler,
    optimizer_steps: BTreeMap<String, u64>,
    method: serde_json::Value,
    /// By name, in the order of their hooks.
    extensions: Vec<(String, serde_json::Value)>,
    dataset: Fingerprint,
    start: SavedStart,
    /// What is kept of a backdrop.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) kept: Option<Kept>,
    pub(crate) config: C,
}

/// Writes `folder/NNNNNN` for the run's step.
///
/// # Errors
/// [`Error::Io`] or a model error; what was there before stays.
pub(crate) fn save<M: Method, C: Serialize>(
    run: &Run<M>,
    hooks: &Hooks<M>,
    config: C,
    folder: &Path,
    train_seconds: f64,
) -> Result<(), Error> {
    let name = format!("{:06}", run.step);
    fs::create_dir_all(folder).map_err(|e| Error::io(folder, "create", e))?;
    let target = folder.join(&name);
    let unfinished = Unfinished::folder(&target).map_err(|e| Error::io(&target, "create", e))?;
    let scratch = unfinished.path();
    run.scene.save(&scratch.join("scene"))?;
    let write = |name: &str, tensors: &BTreeMap<String, HostTensor>| {
        write_tensors(&scratch.join(format!("{name}.safetensors")), tensors)
    };
    let (moments, optimizer_steps) = run.optimizer.to_tensors();
    write("optimizer", &moments)?;
    write("statistics", &statistics(run).tensors)?;
    let (start, points) = start::save(&run.first);
    write(POINTS, &points.tensors)?;
    let method = run.method.save();
    write(METHOD, &method.tensors)?;
    let mut extensions = Vec::new();
    for extension in &hooks.extensions {
        let saved = extension.save();
        if !saved.tensors.is_empty() {
            write(extension.name(), &saved.tensors)?;
        }
        extensions.push((extension.name().to_string(), saved.values));
    }
    let state = State {
        step: run.step,
        train_seconds,
        rng: run.rng.clone(),
        sampler: run.sampler.clone(),
        optimizer_steps,
        method: method.values,
        extensions,
        dataset: Fingerprint::of(&run.dataset.views),
        start,
        kept: run
            .backdrop
            .as_ref()
            .map(|backdrop| backdrop.kept().clone()),
        config,
    };
    let json = serde_json::to_vec(&state).map_err(|e| Error::Config(e.to_string()))?;
    write_atomically(&scratch.join("state.json"), |mut file| {
        std::io::Write::write_all(&mut file, &json)
    })?;
    put(unfinished, folder, &target)
}

/// Puts a complete checkpoint in its place, then removes older ones.
fn put(unfinished: Unfinished, folder: &Path, target: &Path) -> Result<(), Error> {
    if target.exists() {
        discard(target).map_err(|e| Error::io(target, "replace", e))?;
    }
    sync_folder(unfinished.path())?;
    unfinished
        .finish(|scratch| fs::rename(scratch, target))
        .map_err(|e| Error::io(target, "write", e))?;
    sync_folder(folder)?;
    let complete = list(folder)?;
    for old in complete.iter().rev().skip(KEPT) {
        discard(old).map_err(|e| Error::io(old, "remove", e))?;
    }
    Ok(())
}

/// The newest complete checkpoint of a folder.
///
/// # Errors
/// [`Error::Io`] when the folder can't be read.
pub fn latest_checkpoint(folder: &Path) -> Result<Option<PathBuf>, Error> {
    if !folder.exists() {
        return Ok(None);
    }
    Ok(list(folder)?.pop())
}

/// What of a checkpoint is not a tensor.
///
/// # Errors
/// When it can't be read.
pub(crate) fn read_state<C: DeserializeOwned>(checkpoint: &Path) -> Result<State<C>, Error> {
    let path = checkpoint.join("state.json");
    let text = fs::read(&path).map_err(|e| Error::io(&path, "read", e))?;
    serde_json::from_slice(&text).map_err(|e| damaged(&path, e.to_string()))
}

impl<C> State<C> {
    /// What a dataset has in place of the views that the checkpoint was trained on.
    pub(crate) fn contradiction(&self, dataset: &Dataset) -> Option<String> {
        let found = Fingerprint::of(&dataset.views);
        self.dataset.contradiction(&found)
    }
}

/// Puts a run that was just made where the checkpoint's was.
///
/// # Errors
/// When the checkpoint can't be read or is damaged.
pub(crate) fn restore<M: Method, C>(
    run: &mut Run<M>,
    hooks: &mut Hooks<M>,
    state: State<C>,
    checkpoint: &Path,
) -> Result<(), Error> {
    run.scene = DynamicScene::load(&checkpoint.join("scene"), &run.device)?;
    let read = |name: &str| {
        let path = checkpoint.join(format!("{name}.safetensors"));
        read_tensors(&path).map(|tensors| (path, tensors))
    };
    let (path, tensors) = read("optimizer")?;
    run.optimizer =
        Optimizer::from_tensors(tensors, state.optimizer_steps, &run.device.clone().inner())
            .and_then(|optimizer| {
                optimizer.check_sizes("scene", &run.scene)?;
                Ok(optimizer)
            })
            .map_err(|found| damaged(&path, found))?;
    let (path, tensors) = read("statistics")?;
    restore_statistics(run, tensors).map_err(|found| damaged(&path, found))?;
    run.rng = state.rng;
    run.sampler = state.sampler;
    run.step = state.step;
    check_views(&run.sampler, run.train_views.len()).map_err(|found| damaged(checkpoint, found))?;
    let (path, tensors) = read(METHOD)?;
    let values = state.method;
    M::restore(run, Saved { tensors, values }).map_err(|found| damaged(&path, found))?;
    let names: Vec<&str> = hooks.extensions.iter().map(|e| e.name()).collect();
    let found: Vec<&str> = state.extensions.iter().map(|(name, _)| &**name).collect();
    if names != found {
        let what = format!("the state of the extensions {found:?}, of a run with {names:?}");
        return Err(damaged(checkpoint, what));
    }
    for (extension, (name, values)) in hooks.extensions.iter_mut().zip(state.extensions) {
        let path = checkpoint.join(format!("{name}.safetensors"));
        let tensors = match path.exists() {
            true => read_tensors(&path)?,
            false => BTreeMap::new(),
        };
        extension
            .restore(run, Saved { tensors, values })
            .map_err(|found| damaged(&path, found))?;
    }
    Ok(())
}

/// The views that are drawn next are among those to train on.
fn check_views(sampler: &ViewSampler, n_views: usize) -> Result<(), String> {
    match sampler.largest().filter(|view| *view >= n_views) {
        Some(view) => Err(format!("view {view} drawn next, of {n_views} views")),
        None => Ok(()),
    }
}

fn statistics<M>(run: &Run<M>) -> Saved {
    let mut saved = Saved::default();
    for (set, state) in Set::BOTH
        .iter()
        .zip([&run.static_state, &run.dynamic_state])
    {
        let (gradient, seen) = state.gathered.totals();
        saved.insert(&format!("{}.gradient", set.name()), gradient);
        saved.insert(&format!("{}.seen", set.name()), seen);
    }
    saved
}

fn restore_statistics<M: Method>(
    run: &mut Run<M>,
    tensors: BTreeMap<String, HostTensor>,
) -> Result<(), String> {
    let mut saved = Saved {
        tensors,
        ..Saved::default()
    };
    for set in Set::BOTH {
        let name = set.name();
        let gradient = saved.take(&format!("{name}.gradient"))?;
        let seen = saved.take(&format!("{name}.seen"))?;
        let expected = run.len(set);
        for (what, found) in [("gradients", gradient.len()), ("views", seen.len())] {
            if found != expected {
                return Err(format!(
                    "{found} {what} of {name} Gaussians, of which there are {expected}"
                ));
            }
        }
        run.state(set).gathered = ViewSums::from_totals(&gradient, &seen, &run.device.clone());
    }
    Ok(())
}

fn damaged(path: &Path, found: String) -> Error {
    Error::Checkpoint {
        path: path.to_path_buf(),
        found,
    }
}

/// Complete checkpoints, oldest first.
fn list(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let entries = fs::read_dir(folder).map_err(|e| Error::io(folder, "list", e))?;
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.map_err(|e| Error::io(folder, "list", e))?.path();
        let number = path
            .file_name()
            .and_then(|name| name.to_str())
            .unwrap_or_default();
        if number.len() >= 6 && number.bytes().all(|b| b.is_ascii_digit()) {
            found.push(path);
        }
    }
    found.sort_by_key(|path| {
        path.file_name()
            .map(|name| (name.len(), name.to_os_string()))
    });
    Ok(found)
}

fn sync_folder(folder: &Path) -> Result<(), Error> {
    File::open(folder)
        .and_then(|file| file.sync_all())
        .map_err(|e| Error::io(folder, "sync", e))
}
