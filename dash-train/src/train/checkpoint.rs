//! Checkpoints: everything an exact resume needs, complete or absent.

mod damage;
mod fingerprint;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use burn::tensor::Device;
use dash_model::decomposition::MotionStatistics;
use dash_model::parameters::{HostTensor, named_parameters, with_parameters};
use dash_model::scene_file::{read_tensors, write_tensors};
use dash_model::{DynamicScene, MotionField, SpaceBox};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::average::Average;
use super::config::TrainConfig;
use super::density::DensityStatistics;
use super::leave_out::Decision;
use super::matching::{Memory, NUMBERS};
use super::optimizer::Optimizer;
use super::sampler::ViewSampler;
use super::trainer::Trainer;
use super::validation;
use crate::Error;
use crate::dataset::Dataset;
use damage::with_remedy;
use fingerprint::Fingerprint;

/// Checkpoints that are kept; older ones are removed once a newer one is complete.
const KEPT: usize = 2;

/// What is not a tensor.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    step: usize,
    train_seconds: f64,
    rng: Pcg64,
    sampler: ViewSampler,
    optimizer_steps: BTreeMap<String, u64>,
    /// Steps that the mean of the parameters is of.
    #[serde(default)]
    averaged_steps: usize,
    motion_space: Option<SpaceBox>,
    held_still: Vec<bool>,
    #[serde(default)]
    decisions: Vec<Decision>,
    /// Checkpoints of before have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    dataset: Option<Fingerprint>,
    config: TrainConfig,
}

/// Writes `folder/NNNNNN` for the trainer's step.
///
/// # Errors
/// [`Error::Io`] or a model error; what was there before is left as it was.
pub fn save_checkpoint(trainer: &Trainer, folder: &Path, train_seconds: f64) -> Result<(), Error> {
    let name = format!("{:06}", trainer.step);
    let scratch = folder.join(format!(".{name}.partial"));
    if scratch.exists() {
        fs::remove_dir_all(&scratch).map_err(|e| Error::io(&scratch, "remove", e))?;
    }
    fs::create_dir_all(&scratch).map_err(|e| Error::io(&scratch, "create", e))?;
    trainer.scene.save(&scratch.join("scene"))?;
    if let Some(motion) = &trainer.motion {
        write_tensors(
            &scratch.join("motion.safetensors"),
            &named_parameters(motion),
        )?;
    }
    let (moments, optimizer_steps) = trainer.optimizer.to_tensors();
    write_tensors(&scratch.join("optimizer.safetensors"), &moments)?;
    let (averaged_steps, means) = trainer.average.to_tensors();
    if averaged_steps > 0 {
        write_tensors(&scratch.join("average.safetensors"), &means)?;
    }
    write_tensors(
        &scratch.join("statistics.safetensors"),
        &statistics(trainer),
    )?;
    let state = State {
        step: trainer.step,
        train_seconds,
        rng: trainer.rng.clone(),
        sampler: trainer.sampler.clone(),
        optimizer_steps,
        averaged_steps,
        motion_space: trainer.motion_space,
        held_still: trainer.held_still.clone(),
        decisions: trainer.decisions.clone(),
        dataset: Some(Fingerprint::of(&trainer.dataset.views)),
        config: trainer.config.clone(),
    };
    let json = serde_json::to_vec(&state).map_err(|e| Error::Config(e.to_string()))?;
    dash_model::scene_file::write_atomically(&scratch.join("state.json"), |mut file| {
        std::io::Write::write_all(&mut file, &json)
    })?;
    let target = folder.join(&name);
    if target.exists() {
        fs::remove_dir_all(&target).map_err(|e| Error::io(&target, "replace", e))?;
    }
    sync_folder(&scratch)?;
    fs::rename(&scratch, &target).map_err(|e| Error::io(&target, "write", e))?;
    sync_folder(folder)?;
    let complete = list(folder)?;
    for old in complete.iter().rev().skip(KEPT) {
        fs::remove_dir_all(old).map_err(|e| Error::io(old, "remove", e))?;
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

/// The configuration that a checkpoint was trained with.
///
/// # Errors
/// When the checkpoint can't be read.
pub fn checkpoint_config(checkpoint: &Path) -> Result<TrainConfig, Error> {
    Ok(read_state(checkpoint)?.config)
}

/// Checks that a dataset in another folder is the one that a checkpoint was trained on; of a checkpoint of before,
/// that it has the views to go on with.
///
/// # Errors
/// When the checkpoint can't be read, or says that it is another one.
pub(super) fn check_moved(checkpoint: &Path, dataset: &Dataset, from: &Path) -> Result<(), Error> {
    let state = read_state(checkpoint).map_err(|error| with_remedy(checkpoint, error))?;
    let n_views = validation::hold_out(dataset).0.len();
    let contradiction = match state.dataset {
        Some(_) => contradiction(&state, dataset),
        None => check_views(&state.sampler, n_views).err().map(|found| {
            format!("expected the dataset that the run was begun with, found another ({found})")
        }),
    };
    match contradiction {
        None => Ok(()),
        Some(what) => Err(Error::run(
            &dataset.root,
            format!(
                "{what}; name the run's own dataset, {} or where that was moved, or start another run",
                from.display()
            ),
        )),
    }
}

/// Rebuilds a trainer as it was, and the seconds it had trained.
///
/// # Errors
/// When the checkpoint can't be read, is damaged, or belongs to another dataset.
pub fn load_checkpoint(
    checkpoint: &Path,
    dataset: Arc<Dataset>,
    device: &Device,
) -> Result<(Trainer, f64), Error> {
    read(checkpoint, dataset, device).map_err(|error| with_remedy(checkpoint, error))
}

fn read(
    checkpoint: &Path,
    dataset: Arc<Dataset>,
    device: &Device,
) -> Result<(Trainer, f64), Error> {
    let state = read_state(checkpoint)?;
    if let Some(what) = contradiction(&state, &dataset) {
        return Err(Error::run(
            &dataset.root,
            format!("{what}; the dataset was changed: restore it, or start another run"),
        ));
    }
    let mut trainer = Trainer::new(state.config, dataset, device)?;
    trainer.scene = DynamicScene::load(&checkpoint.join("scene"), &trainer.device)?;
    trainer.motion_space = state.motion_space;
    trainer.motion = match state.motion_space {
        None => None,
        Some(_) if trainer.scene.static_set.trajectories.is_some() => None,
        Some(space) => {
            let config = &trainer.config.decomposition;
            // Its start is replaced by what was trained; any generator does.
            let mut unused = Pcg64::seed_from_u64(0);
            let skeleton = MotionField::new(
                &config.encoder,
                config.hidden,
                config.basis,
                space,
                &mut unused,
                &trainer.device,
            )?;
            let path = checkpoint.join("motion.safetensors");
            let parameters = read_tensors(&path)?;
            Some(with_parameters(skeleton, parameters).map_err(|found| damaged(&path, found))?)
        }
    };
    let path = checkpoint.join("optimizer.safetensors");
    trainer.optimizer = Optimizer::from_tensors(
        read_tensors(&path)?,
        state.optimizer_steps,
        &trainer.device.clone().inner(),
    )
    .and_then(|optimizer| {
        optimizer.check_sizes("scene", &trainer.scene)?;
        if let Some(motion) = &trainer.motion {
            optimizer.check_sizes("motion", motion)?;
        }
        Ok(optimizer)
    })
    .map_err(|found| damaged(&path, found))?;
    if state.averaged_steps > 0 {
        let path = checkpoint.join("average.safetensors");
        trainer.average = Average::from_tensors(
            state.averaged_steps,
            read_tensors(&path)?,
            &trainer.scene,
            &trainer.device.clone().inner(),
        )
        .map_err(|found| damaged(&path, found))?;
    }
    let path = checkpoint.join("statistics.safetensors");
    restore_statistics(&mut trainer, read_tensors(&path)?)
        .map_err(|found| damaged(&path, found))?;
    trainer.rng = state.rng;
    trainer.sampler = state.sampler;
    trainer.step = state.step;
    trainer.held_still = state.held_still;
    trainer.decisions = state.decisions;
    check_counts(&trainer).map_err(|found| damaged(checkpoint, found))?;
    Ok((trainer, state.train_seconds))
}

/// What a dataset has in place of the views that a checkpoint was trained on, as far as that says.
fn contradiction(state: &State, dataset: &Dataset) -> Option<String> {
    let begun = state.dataset?;
    begun.contradiction(&Fingerprint::of(&dataset.views))
}

/// The views that are drawn next are among those to train on.
fn check_views(sampler: &ViewSampler, n_views: usize) -> Result<(), String> {
    match sampler.largest().filter(|view| *view >= n_views) {
        Some(view) => Err(format!("view {view} drawn next, of {n_views} views")),
        None => Ok(()),
    }
}

/// What is kept per view and per Gaussian fits this dataset and this scene.
fn check_counts(trainer: &Trainer) -> Result<(), String> {
    check_views(&trainer.sampler, trainer.train_views.len())?;
    let (n_static, n_dynamic) = trainer.scene.counts();
    let (static_gradient, static_seen) = trainer.density_static.parts();
    let (dynamic_gradient, dynamic_seen) = trainer.density_dynamic.parts();
    let (weighted, weights) = trainer.motion_statistics.parts();
    for (what, found, expected, may_lack) in [
        (
            "gradients of static",
            static_gradient.len(),
            n_static,
            false,
        ),
        ("views of static", static_seen.len(), n_static, false),
        (
            "gradients of dynamic",
            dynamic_gradient.len(),
            n_dynamic,
            false,
        ),
        ("views of dynamic", dynamic_seen.len(), n_dynamic, false),
        ("motions of static", weighted.len(), n_static, true),
        ("weights of static", weights.len(), weighted.len(), false),
        ("marks of static", trainer.held_still.len(), n_static, true),
    ] {
        if found != expected && !(may_lack && found == 0) {
            return Err(format!(
                "{found} {what} Gaussians, of which there are {expected}"
            ));
        }
    }
    Ok(())
}

fn statistics(trainer: &Trainer) -> BTreeMap<String, HostTensor> {
    let mut tensors = BTreeMap::new();
    let mut insert = |name: &str, values: Vec<f32>| {
        tensors.insert(
            name.to_string(),
            HostTensor {
                shape: vec![values.len()],
                values,
            },
        );
    };
    for (name, density) in [
        ("static", &trainer.density_static),
        ("dynamic", &trainer.density_dynamic),
    ] {
        let (gradient, seen) = density.parts();
        insert(&format!("{name}.gradient"), gradient.to_vec());
        // Counts stay below 2^24 between two rounds, so f32 holds them exactly.
        insert(
            &format!("{name}.seen"),
            seen.iter().map(|&count| count as f32).collect(),
        );
    }
    let (weighted, weights) = trainer.motion_statistics.parts();
    insert("motion.weighted", weighted.to_vec());
    insert("motion.weights", weights.to_vec());
    insert("motion.found", trainer.found_places.to_numbers());
    tensors
}

fn restore_statistics(
    trainer: &mut Trainer,
    mut tensors: BTreeMap<String, HostTensor>,
) -> Result<(), String> {
    let mut take = |name: &str| {
        tensors
            .remove(name)
            .map(|tensor| tensor.values)
            .ok_or(format!("no `{name}`"))
    };
    let counts = |values: Vec<f32>| values.into_iter().map(|count| count as u32).collect();
    trainer.density_static =
        DensityStatistics::from_parts(take("static.gradient")?, counts(take("static.seen")?));
    trainer.density_dynamic =
        DensityStatistics::from_parts(take("dynamic.gradient")?, counts(take("dynamic.seen")?));
    trainer.motion_statistics =
        MotionStatistics::from_parts(take("motion.weighted")?, take("motion.weights")?);
    // Checkpoints of before have none.
    let found = tensors.remove("motion.found");
    let found = found.map_or(Vec::new(), |tensor| tensor.values);
    if !found.len().is_multiple_of(NUMBERS) {
        return Err(format!("`motion.found` of {} numbers", found.len()));
    }
    trainer.found_places = Memory::from_numbers(&found);
    Ok(())
}

fn read_state(checkpoint: &Path) -> Result<State, Error> {
    let path = checkpoint.join("state.json");
    let text = fs::read(&path).map_err(|e| Error::io(&path, "read", e))?;
    serde_json::from_slice(&text).map_err(|e| damaged(&path, e.to_string()))
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
