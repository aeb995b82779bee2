//! What is noted of steps on the device until the host reads it: losses, and what was not finite.
//!
//! To read a number of a GPU, the host waits until all that was asked of it before is done, and the GPU then waits for the
//! host. So a GPU is read once in [`READ_EVERY`] steps. A CPU is read in every step.

use std::collections::BTreeSet;

use burn::tensor::{Device, Tensor};
use dash_kernels::adam::Stop;
use dash_kernels::finite::{RAISED, Searched, raise_flags};
use dash_kernels::limits::largest_buffer_bytes;

use super::module_visit::Watched;
use super::optimizer::to_host;
use super::sets::Set;
use super::skipped::Place;

/// Steps of a GPU between two reads.
pub(crate) const READ_EVERY: usize = 50;
/// Tensors that there are flags for.
const MAX_TENSORS: usize = 96;

/// A step that was noted, as it was read.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Noted {
    /// Counted from 1.
    pub(super) step: usize,
    pub(super) view: String,
    pub(super) loss: f32,
    pub(super) mse: f32,
    /// Whether everything was finite; else the step changed nothing.
    pub(super) is_sound: bool,
}

/// What was read of the steps since the last time.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Findings {
    pub(super) steps: Vec<Noted>,
    /// Tensors that were not finite in one of them.
    pub(super) tensors: BTreeSet<(String, Place)>,
    /// Rows of both sets whose gradients were not.
    pub(super) rows: [BTreeSet<usize>; 2],
}

/// Numbers on the device, of the steps since they were last read.
struct Numbers {
    /// For each of `capacity` steps a flag, for each a loss, for each a squared error; flags of tensors; marks of the rows of
    /// both sets, where the gradients are gone when this is read.
    values: Tensor<1>,
    capacity: usize,
    n_rows: [usize; 2],
    steps: Vec<(usize, String)>,
    tensors: Vec<(String, Place)>,
}

impl Numbers {
    fn new(capacity: usize, n_rows: [usize; 2], device: &Device) -> Self {
        let marks = if capacity > 1 {
            n_rows[0] + n_rows[1]
        } else {
            0
        };
        let n = 3 * capacity + MAX_TENSORS + marks;
        Self {
            values: Tensor::zeros([n], device),
            capacity,
            n_rows,
            steps: Vec::new(),
            tensors: Vec::new(),
        }
    }

    /// The place of a tensor's flag.
    fn flag(&mut self, watched: &Watched) -> usize {
        let known = |(tensor, place): &(String, Place)| {
            *tensor == watched.tensor && *place == watched.place
        };
        let found = self.tensors.iter().position(known).unwrap_or_else(|| {
            self.tensors.push((watched.tensor.clone(), watched.place));
            self.tensors.len() - 1
        });
        3 * self.capacity + found
    }

    /// The place of the first row's mark, and values in a row, where the tensor is a gradient of Gaussians. Parameters that
    /// are not finite stay so, and need no marks.
    fn marks(&self, watched: &Watched) -> Option<(usize, usize)> {
        let set = watched.set()?;
        let is_gradient = watched.place == Place::Gradient && self.capacity > 1;
        let fits = watched.n_rows == self.n_rows[set] && watched.n_rows > 0;
        (is_gradient && fits).then(|| {
            let first = 3 * self.capacity + MAX_TENSORS + [0, self.n_rows[0]][set];
            (first, watched.values.dims()[0] / watched.n_rows)
        })
    }

    /// Everything, on the host.
    fn read(self) -> Findings {
        let values = to_host(self.values);
        let (of_steps, rest) = values.split_at(3 * self.capacity);
        let (flags, marks) = rest.split_at(MAX_TENSORS);
        let steps = self.steps.into_iter().enumerate();
        let tensors = self.tensors.into_iter().zip(flags);
        let marked = |marks: &[f32]| {
            let rows = marks.iter().enumerate();
            rows.filter(|(_, mark)| **mark == RAISED)
                .map(|(row, _)| row)
                .collect()
        };
        let (of_static, of_dynamic) = marks.split_at(self.n_rows[0].min(marks.len()));
        Findings {
            steps: steps
                .map(|(slot, (step, view))| Noted {
                    step,
                    view,
                    loss: of_steps[self.capacity + slot],
                    mse: of_steps[2 * self.capacity + slot],
                    is_sound: of_steps[slot] != RAISED,
                })
                .collect(),
            tensors: tensors
                .filter(|(_, flag)| **flag == RAISED)
                .map(|(tensor, _)| tensor)
                .collect(),
            rows: [marked(of_static), marked(of_dynamic)],
        }
    }
}

/// See the module.
pub(crate) struct Notes {
    /// Steps between two reads.
    pub(crate) every: usize,
    numbers: Option<Numbers>,
    /// What had to be read before it was due.
    findings: Findings,
    /// Whether anything was read: the first step is, so that there is a loss to tell.
    was_read: bool,
}

impl Notes {
    /// For a device.
    pub(super) fn new(device: &Device) -> Self {
        let is_cpu = largest_buffer_bytes(device).is_none();
        Self {
            every: if is_cpu { 1 } else { READ_EVERY },
            numbers: None,
            findings: Findings::default(),
            was_read: false,
        }
    }

    /// Whether it is time to read what was noted.
    pub(super) fn is_due(&self) -> bool {
        let noted = self.numbers.as_ref().map_or(0, |n| n.steps.len());
        !self.was_read || noted + self.findings.steps.len() >= self.every
    }

    /// Notes a step, counted from 1: its loss and squared error, and which of the watched tensors are finite, in sets of
    /// `n_rows`. Nothing is read, unless rows have changed. Gives the flag that stops the step's updates.
    pub(super) fn add(
        &mut self,
        (step, view): (usize, &str),
        [loss, mse]: [Tensor<1>; 2],
        watched: &[Watched],
        n_rows: [usize; 2],
    ) -> Stop {
        let fits = |numbers: &Numbers| {
            numbers.n_rows == n_rows
                && numbers.steps.len() < numbers.capacity
                && numbers.tensors.len() + watched.len() <= MAX_TENSORS
        };
        if !self.numbers.as_ref().is_some_and(fits) {
            self.collect();
        }
        let device = loss.device();
        let mut numbers = self
            .numbers
            .take()
            .unwrap_or_else(|| Numbers::new(self.every.max(1), n_rows, &device));
        let slot = numbers.steps.len();
        numbers.steps.push((step, view.to_string()));
        // The loss and the squared error are noted beside the flags.
        let of_losses = [loss, mse]
            .into_iter()
            .zip(1..)
            .map(|(values, k)| Searched {
                values,
                flag: slot,
                marks: None,
                copy: Some(k * numbers.capacity + slot),
            });
        let mut searched: Vec<Searched> = of_losses.collect();
        let of_tensors = watched.iter().map(|watched| Searched {
            values: watched.values.clone(),
            flag: numbers.flag(watched),
            marks: numbers.marks(watched),
            copy: None,
        });
        searched.extend(of_tensors);
        // Nobody else holds the numbers: they change in place.
        numbers.values =
            raise_flags(numbers.values, &searched, slot).expect("there is a flag for each tensor");
        let stop = Stop {
            flags: numbers.values.clone(),
            at: slot,
        };
        self.numbers = Some(numbers);
        stop
    }

    /// Reads what is on the device, because rows are about to change.
    fn collect(&mut self) {
        let Some(numbers) = self.numbers.take() else {
            return;
        };
        let found = numbers.read();
        self.findings.steps.extend(found.steps);
        self.findings.tensors.extend(found.tensors);
        for (rows, found) in self.findings.rows.iter_mut().zip(found.rows) {
            rows.extend(found);
        }
    }

    /// Lets marks follow an edit: the rows of a set are those that `sources` names from now on.
    pub(super) fn follow(&mut self, set: Set, sources: &[usize]) {
        self.collect();
        let rows = &mut self.findings.rows[Set::BOTH.iter().position(|s| *s == set).unwrap_or(0)];
        if rows.is_empty() {
            return;
        }
        let moved = sources.iter().enumerate();
        *rows = moved
            .filter(|(_, source)| rows.contains(source))
            .map(|(row, _)| row)
            .collect();
    }

    /// Forgets which rows were marked: Gaussians have changed sets.
    pub(crate) fn forget_rows(&mut self) {
        self.collect();
        self.findings.rows = Default::default();
    }

    /// What was noted since the last time.
    pub(super) fn take(&mut self) -> Findings {
        self.collect();
        self.was_read = true;
        std::mem::take(&mut self.findings)
    }
}
