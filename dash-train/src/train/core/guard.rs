//! What is not finite in a training step: found before it changes anything, named, and mended.
//!
//! The kernels give finite results whatever they are given (a Gaussian with a NaN in it is not drawn, a feature of an
//! infinite table entry is zero), so neither a picture nor a loss shows that a parameter is lost. The guard therefore
//! looks at all parameters and all gradients in every step.

use std::collections::BTreeSet;

use burn::tensor::Gradients;
use dash_kernels::finite::all_finite;

use super::method::Method;
use super::module_visit::{ModuleVisit, Watch, clear};
use super::optimizer::to_host;
use super::run::Run;
use super::sets::Set;
use super::skipped::{NonFinite, Place, SkippedStep};
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

/// All rows of part of a tensor that are not finite.
pub struct Fault {
    tensor: String,
    place: Place,
    of: usize,
    rows: Vec<usize>,
}

/// Every parameter and every gradient that is not finite; `None` where they all are, and the loss.
pub(crate) fn look<M: Method>(
    run: &mut Run<M>,
    gradients: &Gradients,
    loss: f32,
) -> Option<Vec<Fault>> {
    let mut watch = Watch::new(gradients);
    watch.visit("scene", &run.scene);
    let mut visit = ModuleVisit::Watch(watch);
    run.method.visit(&mut visit);
    let ModuleVisit::Watch(watch) = visit else {
        return None;
    };
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
            place: watched.place,
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
pub(crate) fn skip<M: Method>(
    run: &mut Run<M>,
    faults: Vec<Fault>,
    view: &str,
    loss: f32,
) -> Result<(), Error> {
    let lost = too_much_lost(&faults);
    let remedies = match lost {
        true => Vec::new(),
        false => mend(run, &faults),
    };
    let found = faults.into_iter().map(|fault| NonFinite {
        tensor: fault.tensor,
        place: fault.place,
        n_rows: fault.rows.len(),
        of: fault.of,
        rows: fault.rows.into_iter().take(NAMED_ROWS).collect(),
    });
    let skipped = SkippedStep {
        step: run.step + 1,
        view: view.to_string(),
        loss_is_finite: loss.is_finite(),
        found: found.collect(),
        remedies,
    };
    tracing::warn!("{skipped}");
    run.skipped.in_a_row += 1;
    let n = run.skipped.in_a_row;
    if lost || n >= MAX_SKIPPED_IN_A_ROW {
        return Err(Error::NotFinite {
            n,
            last: skipped.to_string(),
        });
    }
    run.skipped.untold.push(skipped);
    Ok(())
}

/// Whether so many Gaussians have values that are not finite that the cause is none of theirs.
fn too_much_lost(faults: &[Fault]) -> bool {
    faults.iter().any(|fault| {
        let of_gaussians = Set::BOTH
            .iter()
            .any(|set| fault.tensor.starts_with(set.prefix()));
        let most = (MAX_LOST_SHARE * fault.of as f64) as usize;
        of_gaussians && fault.place == Place::Values && fault.rows.len() > most.max(1)
    })
}

/// Removes Gaussians, clears entries and moments; what was done. Where values are not finite, gradients
/// follow from them and are let be.
fn mend<M: Method>(run: &mut Run<M>, faults: &[Fault]) -> Vec<String> {
    let place = match faults.iter().any(|fault| fault.place == Place::Values) {
        true => Place::Values,
        false => Place::Gradient,
    };
    let faults: Vec<&Fault> = faults.iter().filter(|fault| fault.place == place).collect();
    let mut remedies = Vec::new();
    for set in Set::BOTH {
        let of_set = faults
            .iter()
            .filter(|fault| fault.tensor.starts_with(set.prefix()));
        let rows: BTreeSet<usize> = of_set
            .clone()
            .flat_map(|fault| fault.rows.iter().copied())
            .collect();
        let n = of_set.clone().map(|fault| fault.of).max().unwrap_or(0);
        let few = rows.len() <= ((MAX_REMOVED_SHARE * n as f64) as usize).max(1);
        if rows.is_empty() {
            continue;
        }
        if place == Place::Values || few {
            let stay: Vec<usize> = (0..n).filter(|row| !rows.contains(row)).collect();
            run.keep(set, &stay);
            let plural = if rows.len() == 1 { "" } else { "s" };
            remedies.push(format!(
                "{} {} Gaussian{plural} removed",
                rows.len(),
                set.name()
            ));
            continue;
        }
        for fault in of_set {
            run.optimizer.forget(&fault.tensor);
            remedies.push(format!("the moments of {} start anew", fault.tensor));
        }
    }
    let of_fields = |fault: &&&Fault| {
        let mut sets = Set::BOTH.iter();
        !sets.any(|set| fault.tensor.starts_with(set.prefix()))
    };
    let mut cleared = BTreeSet::new();
    for fault in faults.iter().filter(of_fields) {
        run.optimizer.forget(&fault.tensor);
        remedies.push(match place {
            Place::Gradient => format!("the moments of {} start anew", fault.tensor),
            Place::Values => {
                cleared.insert(fault.tensor.as_str());
                format!(
                    "what was lost of {} is zero, its moments start anew",
                    fault.tensor
                )
            }
        });
    }
    if !cleared.is_empty() {
        run.scene = clear(&cleared, "scene", run.scene.clone());
        run.method.visit(&mut ModuleVisit::Clear(&cleared));
    }
    remedies
}

impl<M> Run<M> {
    /// The steps skipped since the last call, because something in them was not finite.
    pub fn take_skipped_steps(&mut self) -> Vec<SkippedStep> {
        self.skipped.take()
    }
}
