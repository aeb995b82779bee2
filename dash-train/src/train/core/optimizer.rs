//! Adam whose moments follow the Gaussians.

mod exchange;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, HashMap};

use burn::module::{Module, ParamId};
use burn::tensor::{Device, Gradients, Tensor, TensorData};
use dash_kernels::adam::{AdamStep, Parameter, Stop, adam_steps, typical_gradient};
use dash_kernels::counts::note_read;
use dash_model::gather_rows;
use dash_model::parameters::{HostTensor, Path, named_parameters};
use exchange::{Giver, Taker};

const BETA1: f64 = 0.9;
const BETA2: f64 = 0.999;
/// As in 3DGS: gradients of single Gaussians are tiny.
const EPSILON: f64 = 1e-15;

/// The learning rate of a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// Adam's learning rate.
    pub rate: f32,
    /// Share of the parameter's typical gradient that is added to Adam's denominator. Adam takes steps
    /// of one length however small a gradient is; with this, elements that hardly matter hardly move.
    pub damping: f32,
    /// Views whose mean gradient it is. Steps are longer by their square root, and Adam forgets as much as in a step for each
    /// of them. Source: gsplat; Malladi et al. 2022.
    pub views: usize,
}

impl Rate {
    /// Plain Adam.
    pub fn plain(rate: f32) -> Self {
        Self {
            rate,
            damping: 0.0,
            views: 1,
        }
    }

    /// The same for a mean over views.
    pub fn of_views(self, views: usize) -> Self {
        Self { views, ..self }
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

    /// The next step of Adam on the parameter, flattened.
    fn parameter(self, value: Tensor<1>, gradient: Tensor<1>, rate: Rate) -> Parameter {
        let views = rate.views as f64;
        let (beta1, beta2) = (BETA1.powf(views), BETA2.powf(views));
        let damping = (rate.damping > 0.0).then(|| {
            let (squares, steps) = match self.steps {
                0 => (gradient.clone().powi_scalar(2), None),
                steps => (self.second.clone(), Some(steps)),
            };
            let correction = steps.map_or(1.0, |steps| 1.0 - beta2.powf(steps as f64));
            typical_gradient(squares, correction) * rate.damping
        });
        let settings = AdamStep {
            learning_rate: f64::from(rate.rate) * views.sqrt(),
            beta1,
            beta2,
            epsilon: EPSILON,
            step: self.steps + 1,
            skip_zero_grad: false,
        };
        Parameter {
            param: value,
            grad: gradient,
            first_moment: self.first,
            second_moment: self.second,
            settings,
            damping,
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
        let stepped = stepped(vec![self.parameter(value, gradient, rate)], stop).pop();
        stepped.expect("one parameter was given")
    }
}

/// Parameters and moments after a step.
fn stepped(parameters: Vec<Parameter>, stop: Option<&Stop>) -> Vec<(Tensor<1>, Moments)> {
    let steps: Vec<u64> = parameters.iter().map(|p| p.settings.step).collect();
    let stepped = adam_steps(parameters, stop).expect(
        "a parameter, its gradient and its moments have one shape, and rates are validated",
    );
    let with_steps = stepped.into_iter().zip(steps);
    with_steps
        .map(|((value, first, second), steps)| {
            let moments = Moments {
                first,
                second,
                steps,
            };
            (value, moments)
        })
        .collect()
}

/// Adam over the named parameters of modules.
#[derive(Default)]
pub struct Optimizer {
    moments: BTreeMap<String, Moments>,
    /// What stops the present step, where the host does not know yet whether all is finite.
    pub(crate) stop: Option<Stop>,
    /// Parameters taken out of modules for the present step.
    taken: Vec<Taken>,
    /// Their new values, and their shapes.
    stepped: HashMap<ParamId, (Tensor<1>, Vec<usize>)>,
}

/// A parameter taken out of a module.
struct Taken {
    id: ParamId,
    shape: Vec<usize>,
    name: String,
    parameter: Parameter,
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
        let module = self.take(prefix, module, gradients, rate_of);
        self.step_taken();
        self.give_back(module)
    }

    /// Takes every parameter that has a gradient out of a module, for [`Optimizer::step_taken`]: all that is taken until then
    /// takes its step at once. The module is of no use before [`Optimizer::give_back`], and nobody else should hold its
    /// parameters: what is held elsewhere is copied.
    pub fn take<M: Module>(
        &mut self,
        prefix: &str,
        module: M,
        gradients: &mut Gradients,
        rate_of: impl Fn(&str) -> Rate,
    ) -> M {
        let mut path = Path::default();
        path.enter(prefix, "");
        module.map(&mut Taker {
            path,
            optimizer: self,
            gradients,
            rate_of,
        })
    }

    /// One step on all parameters that were taken.
    pub fn step_taken(&mut self) {
        let taken = std::mem::take(&mut self.taken).into_iter();
        let (places, parameters): (Vec<_>, Vec<_>) = taken
            .map(|taken| ((taken.id, taken.shape, taken.name), taken.parameter))
            .unzip();
        let stepped = stepped(parameters, self.stop.as_ref());
        for ((id, shape, name), (value, moments)) in places.into_iter().zip(stepped) {
            self.moments.insert(name, moments);
            self.stepped.insert(id, (value, shape));
        }
    }

    /// Puts the parameters that were taken out of a module back into it.
    pub fn give_back<M: Module>(&mut self, module: M) -> M {
        module.map(&mut Giver {
            stepped: &mut self.stepped,
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
            ..Self::default()
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
