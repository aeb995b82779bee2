//! What is done to every parameter of a method's modules: the guard looks at it and its gradient, or clears it; gradients of a
//! step's views are summed.

use std::collections::BTreeSet;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Gradients, Tensor, TensorData};
use dash_model::parameters::Path;

use super::gradient_visit::GradientVisit;
use super::optimizer::to_host;
use super::sets::Set;
use super::skipped::Place;

/// What is done with modules: a method shows each of its own.
pub enum ModuleVisit<'a> {
    /// Gathers parameters and their gradients.
    Watch(Watch<'a>),
    /// Puts zeros in the place of what is not finite in the parameters of these names.
    Clear(&'a BTreeSet<&'a str>),
    /// Takes gradients out, or puts sums in.
    Gradients(GradientVisit<'a>),
}

impl ModuleVisit<'_> {
    /// Shows a module whose parameters are named below `prefix`.
    pub fn module<T: Module>(&mut self, prefix: &str, module: &mut Option<T>) {
        match self {
            Self::Watch(watch) => {
                if let Some(module) = module {
                    watch.visit(prefix, module);
                }
            }
            Self::Clear(names) => *module = module.take().map(|m| clear(names, prefix, m)),
            Self::Gradients(visit) => {
                if let Some(module) = module {
                    visit.module(module);
                }
            }
        }
    }
}

/// A tensor that is looked at.
pub(super) struct Watched {
    pub(super) tensor: String,
    pub(super) place: Place,
    pub(super) n_rows: usize,
    pub(super) values: Tensor<1>,
}

impl Watched {
    /// The place among [`Set::BOTH`] of the set whose Gaussians it belongs to.
    pub(super) fn set(&self) -> Option<usize> {
        let mut sets = Set::BOTH.iter();
        sets.position(|set| self.tensor.starts_with(set.prefix()))
    }
}

/// Gathers parameters and their gradients.
pub struct Watch<'a> {
    path: Path,
    gradients: &'a Gradients,
    pub(super) watched: Vec<Watched>,
}

impl<'a> Watch<'a> {
    pub(super) fn new(gradients: &'a Gradients) -> Self {
        Self {
            path: Path::default(),
            gradients,
            watched: Vec::new(),
        }
    }

    pub(super) fn visit<M: Module>(&mut self, prefix: &str, module: &M) {
        self.path.enter(prefix, "");
        module.visit(self);
        self.path.exit("");
    }
}

impl ModuleVisitor for Watch<'_> {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, container_type: &str) {
        self.path.exit(container_type);
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let tensor = param.val();
        let n_rows = tensor.dims()[0];
        let n: usize = tensor.dims().iter().product();
        // Higher colour coefficients of degree 0; Burn keeps the former size where 0 is given.
        if n == 0 {
            return;
        }
        let gradient = tensor.grad(self.gradients);
        let places = [
            (Place::Values, Some(tensor.inner())),
            (Place::Gradient, gradient),
        ];
        for (place, values) in places {
            self.watched.extend(values.map(|values| Watched {
                tensor: self.path.name(),
                place,
                n_rows,
                values: values.reshape([n]),
            }));
        }
    }
}

/// The module with zeros in place of what is not finite in the named parameters.
pub(super) fn clear<M: Module>(names: &BTreeSet<&str>, prefix: &str, module: M) -> M {
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
