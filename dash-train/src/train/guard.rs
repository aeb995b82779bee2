//! What is not finite in a training step: found before it changes anything, named, and mended.
//!
//! The kernels give finite results whatever they are given (a Gaussian with a NaN in it is not drawn,
//! a feature of an infinite table entry is zero), so neither a picture nor a loss shows that a
//! parameter is lost. All parameters and all gradients are therefore looked at in every step.

mod watch;

use std::collections::BTreeSet;
use std::fmt;

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Gradients, Tensor, TensorData};
use dash_kernels::finite::all_finite;
use dash_model::Gaussians;
use dash_model::parameters::Path;
use serde::{Deserialize, Serialize};
use watch::Watch;

use super::average::Average;
use super::optimizer::to_host;
use super::split::keep_dynamic;
use super::trainer::{DYNAMIC, STATIC, Trainer};
use crate::Error;

/// Steps in a row that may be skipped; after that many nothing that the guard does has helped.
pub const MAX_SKIPPED_IN_A_ROW: usize = 20;
/// Rows that a report names.
const NAMED_ROWS: usize = 8;
/// Gaussians whose gradient alone is not finite are removed where they are at most this share of their
/// set: more of them suffer from something else.
const MAX_REMOVED_SHARE: f64 = 0.01;
/// Where more than this share of a set has values that are not finite, the set is lost, and what is left of
/// it would pass for the scene.
const MAX_LOST_SHARE: f64 = 0.1;

/// What of a tensor is not finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// The parameter itself.
    Values,
    /// Its gradient.
    Gradient,
}

/// Part of a tensor that is not finite.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NonFinite {
    /// The parameter's path, such as `scene.static_set.means`.
    pub tensor: String,
    /// What of it.
    pub part: Part,
    /// Rows with a value that is not finite: Gaussians, in a set of these.
    pub n_rows: usize,
    /// All rows of the tensor.
    pub of: usize,
    /// The first of them.
    pub rows: Vec<usize>,
}

impl fmt::Display for NonFinite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.part == Part::Gradient {
            f.write_str("the gradient of ")?;
        }
        let rows: Vec<String> = self.rows.iter().map(ToString::to_string).collect();
        let more = if self.n_rows > rows.len() { ", .." } else { "" };
        let (n, of) = (self.n_rows, self.of);
        write!(
            f,
            "{} in {n} of {of} rows ({}{more})",
            self.tensor,
            rows.join(", ")
        )
    }
}

/// A step that changed no parameter and no moment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SkippedStep {
    /// The step, counted from 1.
    pub step: usize,
    /// The view trained on.
    pub view: String,
    /// Whether the loss was finite all the same.
    pub loss_is_finite: bool,
    /// The parameters at fault; none where the loss alone was not finite.
    pub found: Vec<NonFinite>,
    /// What was done about it.
    pub remedies: Vec<String>,
}

impl fmt::Display for SkippedStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut what: Vec<String> = self.found.iter().map(ToString::to_string).collect();
        if !self.loss_is_finite {
            what.insert(0, "the loss".into());
        }
        let remedies = match self.remedies.is_empty() {
            true => String::new(),
            false => format!("; {}", self.remedies.join(", ")),
        };
        write!(
            f,
            "step {}, view `{}`: not finite: {}; the step was skipped{remedies}",
            self.step,
            self.view,
            what.join(", ")
        )
    }
}

/// Skipped steps of a run.
#[derive(Debug, Default)]
pub(crate) struct Skipped {
    in_a_row: usize,
    untold: Vec<SkippedStep>,
}

impl Skipped {
    /// A step was not skipped.
    pub(crate) fn end_row(&mut self) {
        self.in_a_row = 0;
    }

    /// The steps skipped since the last call.
    pub(crate) fn take(&mut self) -> Vec<SkippedStep> {
        std::mem::take(&mut self.untold)
    }
}

/// All rows of part of a tensor that are not finite.
pub(crate) struct Fault {
    tensor: String,
    part: Part,
    of: usize,
    rows: Vec<usize>,
}

/// Every parameter and every gradient that is not finite; `None` where they all are, and the loss.
pub(crate) fn look(trainer: &Trainer, gradients: &Gradients, loss: f32) -> Option<Vec<Fault>> {
    let mut watch = Watch::new(gradients);
    watch.visit("scene", &trainer.scene);
    if let Some(motion) = &trainer.motion {
        watch.visit("motion", motion);
    }
    let values: Vec<_> = watch
        .watched
        .iter()
        .map(|watched| watched.values.clone())
        .collect();
    let finite = all_finite(&values);
    if loss.is_finite() && finite.iter().all(|&finite| finite) {
        return None;
    }
    let broken = watch.watched.into_iter().zip(finite);
    let faults = broken.filter(|(_, finite)| !finite).map(|(watched, _)| {
        let values = to_host(watched.values);
        let width = values.len().checked_div(watched.n_rows).unwrap_or(0);
        let rows = values.chunks(width.max(1)).enumerate();
        let rows = rows.filter(|(_, row)| !row.iter().all(|value| value.is_finite()));
        Fault {
            tensor: watched.tensor,
            part: watched.part,
            of: watched.n_rows,
            rows: rows.map(|(row, _)| row).collect(),
        }
    });
    Some(faults.collect())
}

/// Mends what is at fault and takes note of the step that is left out.
///
/// # Errors
/// [`Error::NotFinite`] once [`MAX_SKIPPED_IN_A_ROW`] steps were skipped in a row, and at once where
/// more than [`MAX_LOST_SHARE`] of a set of Gaussians are lost.
pub(crate) fn skip(
    trainer: &mut Trainer,
    faults: Vec<Fault>,
    view: &str,
    loss: f32,
) -> Result<(), Error> {
    let lost = too_much_lost(&faults);
    let remedies = match lost {
        true => Vec::new(),
        false => {
            // What it is of is not what it was.
            trainer.average = Average::default();
            mend(trainer, &faults)
        }
    };
    let found = faults.into_iter().map(|fault| NonFinite {
        tensor: fault.tensor,
        part: fault.part,
        n_rows: fault.rows.len(),
        of: fault.of,
        rows: fault.rows.into_iter().take(NAMED_ROWS).collect(),
    });
    let skipped = SkippedStep {
        step: trainer.step + 1,
        view: view.to_string(),
        loss_is_finite: loss.is_finite(),
        found: found.collect(),
        remedies,
    };
    tracing::warn!("{skipped}");
    trainer.skipped.in_a_row += 1;
    let n = trainer.skipped.in_a_row;
    if lost || n >= MAX_SKIPPED_IN_A_ROW {
        return Err(Error::NotFinite {
            n,
            last: skipped.to_string(),
        });
    }
    trainer.skipped.untold.push(skipped);
    Ok(())
}

/// Whether so many Gaussians have values that are not finite that the cause is none of theirs.
fn too_much_lost(faults: &[Fault]) -> bool {
    faults.iter().any(|fault| {
        let of_gaussians = [STATIC, DYNAMIC]
            .iter()
            .any(|set| fault.tensor.starts_with(set));
        let most = (MAX_LOST_SHARE * fault.of as f64) as usize;
        of_gaussians && fault.part == Part::Values && fault.rows.len() > most.max(1)
    })
}

/// Removes Gaussians, clears entries and moments; what was done. Where values are not finite, gradients
/// follow from them and are let be.
fn mend(trainer: &mut Trainer, faults: &[Fault]) -> Vec<String> {
    let part = match faults.iter().any(|fault| fault.part == Part::Values) {
        true => Part::Values,
        false => Part::Gradient,
    };
    let faults: Vec<&Fault> = faults.iter().filter(|fault| fault.part == part).collect();
    let mut remedies = Vec::new();
    for (set, name) in [(STATIC, "static"), (DYNAMIC, "dynamic")] {
        let of_set = faults.iter().filter(|fault| fault.tensor.starts_with(set));
        let rows: BTreeSet<usize> = of_set
            .clone()
            .flat_map(|fault| fault.rows.iter().copied())
            .collect();
        let n = of_set.clone().map(|fault| fault.of).max().unwrap_or(0);
        let few = rows.len() <= ((MAX_REMOVED_SHARE * n as f64) as usize).max(1);
        if rows.is_empty() {
            continue;
        }
        if part == Part::Values || few {
            let stay: Vec<usize> = (0..n).filter(|row| !rows.contains(row)).collect();
            match set {
                STATIC => keep_static(trainer, &stay),
                _ => keep_dynamic(trainer, &stay),
            }
            let plural = if rows.len() == 1 { "" } else { "s" };
            remedies.push(format!("{} {name} Gaussian{plural} removed", rows.len()));
            continue;
        }
        for fault in of_set {
            trainer.optimizer.forget(&fault.tensor);
            remedies.push(format!("the moments of {} start anew", fault.tensor));
        }
    }
    let of_fields = |fault: &&&Fault| {
        let sets = [STATIC, DYNAMIC];
        !sets.iter().any(|set| fault.tensor.starts_with(set))
    };
    let mut cleared = BTreeSet::new();
    for fault in faults.iter().filter(of_fields) {
        trainer.optimizer.forget(&fault.tensor);
        remedies.push(match part {
            Part::Gradient => format!("the moments of {} start anew", fault.tensor),
            Part::Values => {
                cleared.insert(fault.tensor.as_str());
                format!(
                    "what was lost of {} is zero, its moments start anew",
                    fault.tensor
                )
            }
        });
    }
    if !cleared.is_empty() {
        trainer.scene = clear(&cleared, "scene", trainer.scene.clone());
        if let Some(motion) = trainer.motion.take() {
            trainer.motion = Some(clear(&cleared, "motion", motion));
        }
    }
    remedies
}

/// Keeps these static Gaussians only.
fn keep_static(trainer: &mut Trainer, stay: &[usize]) {
    let rows = trainer.scene.static_set.to_rows();
    let fresh = vec![false; stay.len()];
    trainer
        .optimizer
        .edit_rows(STATIC, stay, &fresh, rows.len());
    trainer.scene.static_set = Gaussians::from_rows(&rows.gather(stay), &trainer.device);
    trainer.density_static = trainer.density_static.gather(stay);
    if trainer.motion_space.is_some() {
        trainer.motion_statistics = trainer.motion_statistics.gather(stay);
        let held_still = &trainer.held_still;
        trainer.held_still = stay.iter().map(|&row| held_still[row]).collect();
    }
}

/// The module with zeros in place of what is not finite in the named parameters.
fn clear<M: Module>(names: &BTreeSet<&str>, prefix: &str, module: M) -> M {
    let mut path = Path::default();
    path.enter(prefix, "");
    module.map(&mut Clear { path, names })
}

struct Clear<'a> {
    path: Path,
    names: &'a BTreeSet<&'a str>,
}

impl ModuleMapper for Clear<'_> {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, container_type: &str) {
        self.path.exit(container_type);
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        if !self.names.contains(self.path.name().as_str()) {
            return param;
        }
        let (id, tensor, mapper) = param.consume();
        let (shape, device) = (tensor.dims(), tensor.device());
        let mut values = to_host(tensor);
        for value in values.iter_mut().filter(|value| !value.is_finite()) {
            *value = 0.0;
        }
        let cleared = Tensor::from_data(TensorData::new(values, shape), &device).require_grad();
        Param::from_mapped_value(id, cleared, mapper)
    }
}

#[cfg(test)]
mod tests;
