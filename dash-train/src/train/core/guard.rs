//! What is not finite in a training step: found before it changes anything, named, and mended.
//!
//! The kernels give finite results whatever they are given (a Gaussian with a NaN in it is not drawn, a feature of an
//! infinite table entry is zero), so neither a picture nor a loss shows that a parameter is lost. The guard therefore
//! looks at all parameters and all gradients in every step.

use std::collections::BTreeSet;

use burn::tensor::{Gradients, Tensor};

use super::method::Method;
use super::module_visit::{ModuleVisit, Watch, Watched, clear};
use super::notes::{Findings, Noted};
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
struct Fault {
    tensor: String,
    place: Place,
    of: usize,
    rows: Vec<usize>,
}

/// What was read of the steps since the last time.
pub(crate) struct Reading {
    steps: Vec<Noted>,
    faults: Vec<Fault>,
}

impl Reading {
    /// Whether everything was finite in all of the steps.
    pub(super) fn is_sound(&self) -> bool {
        self.steps.iter().all(|step| step.is_sound)
    }

    /// Mean loss and PSNR of the steps in which all was finite; the last step's where there is none.
    pub(super) fn means(&self) -> [f32; 2] {
        let psnr = |step: &Noted| -10.0 * step.mse.max(1e-10).log10();
        let sound = || self.steps.iter().filter(|step| step.is_sound);
        let n = sound().count() as f32;
        match self.steps.last() {
            Some(last) if n == 0.0 => [last.loss, psnr(last)],
            _ => [
                sound().map(|step| step.loss).sum::<f32>() / n,
                sound().map(psnr).sum::<f32>() / n,
            ],
        }
    }

    /// Steps read, and those of them that changed nothing.
    pub(super) fn counts(&self) -> [usize; 2] {
        let skipped = self.steps.iter().filter(|step| !step.is_sound).count();
        [self.steps.len(), skipped]
    }
}

/// Has the device note the step's loss and mean squared error, and which parameters and gradients are not finite. The
/// optimizer then changes nothing if one of them is not. What was noted is read where it is due: `None` where it is not.
pub(crate) fn look<M: Method>(
    run: &mut Run<M>,
    gradients: &Gradients,
    losses: [Tensor<1>; 2],
    view: &str,
) -> Option<Reading> {
    let mut watch = Watch::new(gradients);
    watch.visit("scene", &run.scene);
    let mut visit = ModuleVisit::Watch(watch);
    run.method.visit(&mut visit);
    let ModuleVisit::Watch(Watch { watched, .. }) = visit else {
        return None;
    };
    let (n_static, n_dynamic) = run.scene.counts();
    let step = run.step + 1;
    let stop = run
        .notes
        .add((step, view), losses, &watched, [n_static, n_dynamic]);
    let is_last = step >= run.config.iterations;
    if !(run.notes.is_due() || is_last) {
        run.optimizer.stop = Some(stop);
        return None;
    }
    // The host knows now what the flag would tell.
    run.optimizer.stop = None;
    let Findings {
        steps,
        tensors,
        rows,
    } = run.notes.take();
    let faults = tensors.into_iter().map(|(tensor, place)| {
        let of_it = |w: &&Watched| w.tensor == tensor && w.place == place;
        let watched = watched.iter().find(of_it);
        let marked = watched.and_then(|w| w.set()).map(|set| &rows[set]);
        let exact = watched.map(broken_rows).unwrap_or_default();
        Fault {
            of: watched.map_or(0, |w| w.n_rows),
            rows: match marked {
                Some(marked) if exact.is_empty() => marked.iter().copied().collect(),
                _ => exact,
            },
            tensor,
            place,
        }
    });
    Some(Reading {
        faults: faults.collect(),
        steps,
    })
}

/// Rows that are not finite now.
fn broken_rows(watched: &Watched) -> Vec<usize> {
    let values = to_host(watched.values.clone());
    let width = values.len().checked_div(watched.n_rows).unwrap_or(0);
    let rows = values.chunks(width.max(1)).enumerate();
    rows.filter(|(_, row)| !row.iter().all(|value| value.is_finite()))
        .map(|(row, _)| row)
        .collect()
}

/// Mends what is at fault and takes note of the steps that changed nothing.
///
/// # Errors
/// [`Error::NotFinite`] once [`MAX_SKIPPED_IN_A_ROW`] steps were skipped in a row, and at once where
/// more than [`MAX_LOST_SHARE`] of a set of Gaussians are lost.
pub(crate) fn skip<M: Method>(run: &mut Run<M>, reading: Reading) -> Result<(), Error> {
    let Reading { steps, faults } = reading;
    let lost = too_much_lost(&faults);
    let remedies = match lost {
        true => Vec::new(),
        false => mend(run, &faults),
    };
    let found: Vec<NonFinite> = faults
        .into_iter()
        .map(|fault| NonFinite {
            tensor: fault.tensor,
            place: fault.place,
            n_rows: fault.rows.len(),
            of: fault.of,
            rows: fault.rows.into_iter().take(NAMED_ROWS).collect(),
        })
        .collect();
    let mut longest = (0, String::new());
    for step in steps {
        if step.is_sound {
            run.skipped.end_row();
            continue;
        }
        let skipped = SkippedStep {
            step: step.step,
            view: step.view,
            loss_is_finite: step.loss.is_finite(),
            found: found.clone(),
            remedies: remedies.clone(),
        };
        run.skipped.in_a_row += 1;
        if run.skipped.in_a_row > longest.0 {
            longest = (run.skipped.in_a_row, skipped.to_string());
        }
        run.skipped.untold.push(skipped);
    }
    let (n, last) = longest;
    tracing::warn!("{last}");
    if lost || n >= MAX_SKIPPED_IN_A_ROW {
        return Err(Error::NotFinite { n, last });
    }
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
