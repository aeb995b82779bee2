//! Adam whose moments follow the Gaussians.

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, Gradients, Tensor, TensorData};
use dash_kernels::adam::{AdamStep, Conditions, adam_step, adam_step_unless, typical_gradient};
use dash_kernels::counts::note_read;
use dash_model::gather_rows;
use dash_model::parameters::{HostTensor, Path, named_parameters};

const BETA1: f64 = 0.9;
const BETA2: f64 = 0.999;
/// As in 3DGS: gradients of single Gaussians are tiny.
const EPSILON: f64 = 1e-15;

/// The learning rate of a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// Adam's learning rate.
    pub rate: f32,
    /// Part of the parameter's typical gradient that is added to Adam's denominator. Adam takes steps
    /// of one length however small a gradient is; with this, elements that hardly matter hardly move.
    pub damping: f32,
}

impl Rate {
    /// Plain Adam.
    pub fn plain(rate: f32) -> Self {
        Self { rate, damping: 0.0 }
    }
}

/// First and second moments of one parameter, flattened.
pub(crate) struct Moments {
    pub(crate) first: Tensor<1>,
    pub(crate) second: Tensor<1>,
    pub(crate) steps: u64,
}

impl Moments {
    /// Of a parameter that has done no step.
    pub(crate) fn of(value: &Tensor<1>) -> Self {
        Self {
            first: value.zeros_like(),
            second: value.zeros_like(),
            steps: 0,
        }
    }

    /// One step of Adam on the parameter, flattened.
    pub(crate) fn step(
        self,
        value: Tensor<1>,
        gradient: Tensor<1>,
        rate: Rate,
        stop: Option<&Stop>,
    ) -> (Tensor<1>, Self) {
        let device = value.device();
        let damping = (rate.damping > 0.0).then(|| {
            let (squares, steps) = match self.steps {
                0 => (gradient.clone().powi_scalar(2), None),
                steps => (self.second.clone(), Some(steps)),
            };
            let correction = steps.map_or(1.0, |steps| 1.0 - BETA2.powf(steps as f64));
            typical_gradient(squares, correction) * rate.damping
        });
        let step = AdamStep {
            learning_rate: f64::from(rate.rate),
            beta1: BETA1,
            beta2: BETA2,
            epsilon: EPSILON,
            step: self.steps + 1,
            skip_zero_grad: false,
        };
        let stepped = match (stop, damping) {
            (None, None) => adam_step(value, gradient, self.first, self.second, &step),
            (stop, damping) => {
                let stop = match stop {
                    Some(stop) => stop.clone(),
                    None => Stop::never(&device),
                };
                let conditions = Conditions {
                    flags: stop.flags,
                    stop: stop.place,
                    damping: damping.unwrap_or(stop.zero),
                };
                adam_step_unless(value, gradient, self.first, self.second, &step, &conditions)
            }
        };
        let (value, first, second) = stepped.expect(
            "a parameter, its gradient and its moments have one shape, and rates are validated",
        );
        let moments = Self {
            first,
            second,
            steps: step.step,
        };
        (value, moments)
    }
}

/// A flag on the device that stops a step: where it is raised, nothing changes.
#[derive(Debug, Clone)]
pub(crate) struct Stop {
    pub(super) flags: Tensor<1>,
    pub(super) place: usize,
    /// `[1]`, for parameters without damping.
    pub(super) zero: Tensor<1>,
}

impl Stop {
    /// A flag that nothing raises.
    fn never(device: &Device) -> Self {
        let zero = Tensor::zeros([1], device);
        Self {
            flags: zero.clone(),
            place: 0,
            zero,
        }
    }
}

/// Adam over the named parameters of modules.
#[derive(Default)]
pub struct Optimizer {
    moments: BTreeMap<String, Moments>,
    /// What stops the present step, where the host does not know yet whether all is finite.
    pub(crate) stop: Option<Stop>,
}

impl Optimizer {
    /// One step on every parameter that has a gradient. `prefix` is put before the module's paths;
    /// `rate_of` tells how a path learns.
    pub fn step<M: Module>(
        &mut self,
        prefix: &str,
        module: M,
        gradients: &mut Gradients,
        rate_of: impl Fn(&str) -> Rate,
    ) -> M {
        let mut path = Path::default();
        path.enter(prefix, "");
        module.map(&mut Stepper {
            path,
            optimizer: self,
            gradients,
            rate_of,
        })
    }

    /// Rearranges the moments of every parameter under `prefix` whose rows follow `sources`; rows
    /// marked `fresh` start anew.
    pub fn edit_rows(&mut self, prefix: &str, sources: &[usize], fresh: &[bool], rows: usize) {
        for (_, moments) in self
            .moments
            .range_mut(prefix.to_string()..)
            .take_while(|(n, _)| n.starts_with(prefix))
        {
            let device = moments.first.device();
            for tensor in [&mut moments.first, &mut moments.second] {
                let values = to_host(tensor.clone());
                let width = values.len().checked_div(rows).unwrap_or(0);
                let mut edited = gather_rows(&values, width, sources);
                for (row, _) in fresh.iter().enumerate().filter(|(_, fresh)| **fresh) {
                    edited[row * width..(row + 1) * width].fill(0.0);
                }
                *tensor = upload(edited, &device);
            }
        }
    }

    /// Forgets the moments under `prefix` (all of one parameter group).
    pub fn forget(&mut self, prefix: &str) {
        self.moments.retain(|name, _| !name.starts_with(prefix));
    }

    /// Moves moments from one name to another with chosen rows, for Gaussians that change set.
    pub fn copy_rows(&mut self, from: &str, to: &str, sources: &[usize], rows: usize) {
        let found: Vec<_> = self
            .moments
            .iter()
            .filter_map(|(name, moments)| {
                let rest = name.strip_prefix(from)?;
                let pick = |tensor: &Tensor<1>| {
                    let values = to_host(tensor.clone());
                    let width = values.len().checked_div(rows).unwrap_or(0);
                    upload(gather_rows(&values, width, sources), &tensor.device())
                };
                let copy = Moments {
                    first: pick(&moments.first),
                    second: pick(&moments.second),
                    steps: moments.steps,
                };
                Some((format!("{to}{rest}"), copy))
            })
            .collect();
        self.moments.extend(found);
    }

    /// Appends rows of zero moments to the parameters under `prefix`, now of `rows` rows.
    pub fn extend_rows(&mut self, prefix: &str, rows: usize, added: usize) {
        if rows == 0 {
            // Nothing is left that says how wide a row is: all of them start anew.
            self.forget(prefix);
            return;
        }
        for (_, moments) in self
            .moments
            .range_mut(prefix.to_string()..)
            .take_while(|(n, _)| n.starts_with(prefix))
        {
            let device = moments.first.device();
            for tensor in [&mut moments.first, &mut moments.second] {
                let mut values = to_host(tensor.clone());
                let width = values.len().checked_div(rows).unwrap_or(0);
                values.resize(values.len() + added * width, 0.0);
                *tensor = upload(values, &device);
            }
        }
    }

    /// Zeroes the moments of one parameter.
    pub fn reset(&mut self, name: &str) {
        if let Some(moments) = self.moments.get_mut(name) {
            moments.first = moments.first.zeros_like();
            moments.second = moments.second.zeros_like();
        }
    }

    /// Whether the moments of a module's parameters, named below `prefix`, have the parameters' sizes.
    ///
    /// # Errors
    /// The parameter whose moments do not.
    pub(crate) fn check_sizes<M: Module>(&self, prefix: &str, module: &M) -> Result<(), String> {
        for (name, parameter) in named_parameters(module) {
            let name = format!("{prefix}.{name}");
            let Some(moments) = self.moments.get(&name) else {
                continue;
            };
            let expected = parameter.values.len();
            for found in [moments.first.dims()[0], moments.second.dims()[0]] {
                if found != expected {
                    return Err(format!(
                        "{found} moments of the {expected} values of `{name}`"
                    ));
                }
            }
        }
        Ok(())
    }

    /// All state, for a checkpoint.
    pub(crate) fn to_tensors(&self) -> (BTreeMap<String, HostTensor>, BTreeMap<String, u64>) {
        let mut tensors = BTreeMap::new();
        let mut steps = BTreeMap::new();
        for (name, moments) in &self.moments {
            for (suffix, tensor) in [("first", &moments.first), ("second", &moments.second)] {
                let values = to_host(tensor.clone());
                tensors.insert(
                    format!("{suffix}:{name}"),
                    HostTensor {
                        shape: vec![values.len()],
                        values,
                    },
                );
            }
            steps.insert(name.clone(), moments.steps);
        }
        (tensors, steps)
    }

    /// The state of [`Optimizer::to_tensors`].
    pub(crate) fn from_tensors(
        mut tensors: BTreeMap<String, HostTensor>,
        steps: BTreeMap<String, u64>,
        device: &Device,
    ) -> Result<Self, String> {
        let mut moments = BTreeMap::new();
        for (name, steps) in steps {
            let mut take = |suffix: &str| {
                let key = format!("{suffix}:{name}");
                tensors
                    .remove(&key)
                    .map(|t| upload(t.values, device))
                    .ok_or(format!("no `{key}`"))
            };
            let (first, second) = (take("first")?, take("second")?);
            moments.insert(
                name,
                Moments {
                    first,
                    second,
                    steps,
                },
            );
        }
        Ok(Self {
            moments,
            stop: None,
        })
    }
}

fn upload(values: Vec<f32>, device: &Device) -> Tensor<1> {
    let n = values.len();
    Tensor::from_data(TensorData::new(values, [n]), device)
}

/// Reads a tensor back as host values in row-major order.
pub(crate) fn to_host<const R: usize>(tensor: Tensor<R>) -> Vec<f32> {
    note_read();
    tensor
        .into_data()
        .try_into_vec::<f32>()
        .unwrap_or_else(|error| panic!("training tensors are f32: {error:?}"))
}

struct Stepper<'a, F> {
    path: Path,
    optimizer: &'a mut Optimizer,
    gradients: &'a mut Gradients,
    rate_of: F,
}

impl<F: Fn(&str) -> Rate> ModuleMapper for Stepper<'_, F> {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, container_type: &str) {
        self.path.exit(container_type);
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let (id, tensor, mapper) = param.consume();
        let Some(gradient) = tensor.grad_remove(self.gradients) else {
            return Param::from_mapped_value(id, tensor, mapper);
        };
        let name = self.path.name();
        let rate = (self.rate_of)(&name);
        let shape = tensor.dims();
        let n: usize = shape.iter().product();
        let value = tensor.inner().reshape([n]);
        let gradient = gradient.reshape([n]);
        let moments = self
            .optimizer
            .moments
            .remove(&name)
            .unwrap_or_else(|| Moments::of(&value));
        let stop = self.optimizer.stop.as_ref();
        let (value, moments) = moments.step(value, gradient, rate, stop);
        self.optimizer.moments.insert(name, moments);
        let updated = Tensor::from_inner(value.reshape(shape)).require_grad();
        Param::from_mapped_value(id, updated, mapper)
    }
}
