//! Gradients of everything that learns, one after the other.

use std::vec::IntoIter;

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Gradients, Tensor};

/// Of each parameter and leaf its gradient, flattened; `None` where it has none.
pub(super) type InOrder = Vec<Option<Tensor<1>>>;

/// Takes gradients out of those of a view, or puts sums over views in, in the order in which methods and extensions show
/// what learns.
pub struct GradientVisit<'a> {
    gradients: &'a mut Gradients,
    way: Way<'a>,
}

enum Way<'a> {
    Take(&'a mut InOrder),
    Put(IntoIter<Option<Tensor<1>>>),
}

impl<'a> GradientVisit<'a> {
    /// Appends each gradient to a list.
    pub(super) fn take(gradients: &'a mut Gradients, taken: &'a mut InOrder) -> Self {
        let way = Way::Take(taken);
        Self { gradients, way }
    }

    /// Puts the gradients of a list in the place of what is there.
    pub(super) fn put(gradients: &'a mut Gradients, sums: InOrder) -> Self {
        let way = Way::Put(sums.into_iter());
        Self { gradients, way }
    }

    /// Shows all parameters of a module.
    pub fn module<T: Module>(&mut self, module: &T) {
        module.visit(self);
    }

    /// Shows a leaf of the graph.
    pub fn leaf<const D: usize>(&mut self, leaf: &Tensor<D>) {
        let shape = leaf.dims();
        let n: usize = shape.iter().product();
        // Burn keeps the former size where 0 is given, and nothing learns.
        if n == 0 {
            return;
        }
        match &mut self.way {
            Way::Take(taken) => {
                let gradient = leaf.grad_remove(self.gradients);
                taken.push(gradient.map(|gradient| gradient.reshape([n])));
            }
            Way::Put(sums) => {
                if let Some(sum) = sums.next().flatten() {
                    leaf.grad_replace(self.gradients, sum.reshape(shape));
                }
            }
        }
    }
}

impl ModuleVisitor for GradientVisit<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.leaf(&param.val());
    }
}

/// Sums over views, in their order: the same bits whoever has worked out which of them.
pub(super) fn sum(of_views: impl Iterator<Item = InOrder>) -> InOrder {
    let add = |sum: InOrder, next: InOrder| -> InOrder {
        let pairs = sum.into_iter().zip(next);
        let added = pairs.map(|pair| match pair {
            (Some(sum), Some(next)) => Some(sum + next),
            (sum, next) => sum.or(next),
        });
        added.collect()
    };
    of_views.reduce(add).unwrap_or_default()
}
