//! Parameters taken out of a module for a step, and put back.

use std::collections::HashMap;

use burn::module::{ModuleMapper, Param, ParamId};
use burn::tensor::{Gradients, Tensor};
use dash_model::parameters::Path;

use super::{Moments, Optimizer, Rate, Taken};

/// Takes parameters that have a gradient out of a module.
pub(super) struct Taker<'a, F> {
    pub(super) path: Path,
    pub(super) optimizer: &'a mut Optimizer,
    pub(super) gradients: &'a mut Gradients,
    pub(super) rate_of: F,
}

impl<F: Fn(&str) -> Rate> ModuleMapper for Taker<'_, F> {
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
        let moments = self.optimizer.moments.remove(&name);
        let moments = moments.unwrap_or_else(|| Moments::of(&value));
        // What stands in its place has its shape no more: it must not hold its memory.
        let hollow = Tensor::empty([1; D], &value.device());
        self.optimizer.taken.push(Taken {
            id,
            shape: shape.to_vec(),
            name,
            parameter: moments.parameter(value, gradient.reshape([n]), rate),
        });
        Param::from_mapped_value(id, Tensor::from_inner(hollow), mapper)
    }
}

/// Puts them back.
pub(super) struct Giver<'a> {
    pub(super) stepped: &'a mut HashMap<ParamId, (Tensor<1>, Vec<usize>)>,
}

impl ModuleMapper for Giver<'_> {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let (id, tensor, mapper) = param.consume();
        let tensor = match self.stepped.remove(&id) {
            Some((value, shape)) => {
                let shape: [usize; D] = std::array::from_fn(|k| shape[k]);
                Tensor::from_inner(value.reshape(shape)).require_grad()
            }
            None => tensor,
        };
        Param::from_mapped_value(id, tensor, mapper)
    }
}
