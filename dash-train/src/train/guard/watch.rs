//! All parameters of a module and their gradients, as rows of numbers.

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Gradients, Tensor};
use dash_model::parameters::Path;

use super::Part;

/// A tensor that is looked at.
pub(super) struct Watched {
    pub(super) tensor: String,
    pub(super) part: Part,
    pub(super) n_rows: usize,
    pub(super) values: Tensor<1>,
}

/// Gathers parameters and their gradients.
pub(super) struct Watch<'a> {
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
        // Higher colour coefficients of degree 0; Burn takes a size of 0 for that of before.
        if n == 0 {
            return;
        }
        let gradient = tensor.grad(self.gradients);
        let parts = [
            (Part::Values, Some(tensor.inner())),
            (Part::Gradient, gradient),
        ];
        for (part, values) in parts {
            self.watched.extend(values.map(|values| Watched {
                tensor: self.path.name(),
                part,
                n_rows,
                values: values.reshape([n]),
            }));
        }
    }
}
