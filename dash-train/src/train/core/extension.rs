//! What an extension is: one idea beyond the method.

use std::any::Any;

use burn::tensor::{Gradients, Tensor};

use super::densify::Rules;
use super::finished::Finished;
use super::forward::Forward;
use super::gradient_visit::GradientVisit;
use super::run::Run;
use super::saved::Saved;
use super::sets::{RowEdit, Set};
use crate::Error;
use crate::dataset::View;

/// One idea beyond the method: its configuration, its state, what it saves, its terms of the loss and its hooks. The
/// trainer calls each hook of all its extensions in the order of the list.
pub trait Extension<M>: Any + Send {
    /// Its name: the section of the configuration, the file in a checkpoint.
    fn name(&self) -> &'static str;

    /// Once when a run is made, before its state is restored if it is resumed.
    fn init(&mut self, _run: &mut Run<M>) {}

    /// Once before the first step that this process does.
    ///
    /// # Errors
    /// When an image can't be read.
    fn begin(&mut self, _run: &mut Run<M>) -> Result<(), Error> {
        Ok(())
    }

    /// Before a step's view is chosen, after the method's change of stage.
    ///
    /// # Errors
    /// When a module refuses its input.
    fn before_step(&mut self, _run: &mut Run<M>) -> Result<(), Error> {
        Ok(())
    }

    /// Chooses the step's view, by its place among [`Run::train_views`]; `None` leaves that to others.
    fn next_view(&mut self, _run: &mut Run<M>) -> Option<usize> {
        None
    }

    /// Before the forward pass of a view; a replica calls it for the views of others, too.
    ///
    /// # Errors
    /// When a module refuses its input.
    fn before_forward(&mut self, _run: &mut Run<M>, _view: &View) -> Result<(), Error> {
        Ok(())
    }

    /// Packed splats of both sets `[N, C]` before they are rasterized, static ones first.
    fn splats(&mut self, _run: &Run<M>, splats: Tensor<2>) -> Tensor<2> {
        splats
    }

    /// Terms of the loss.
    ///
    /// # Errors
    /// When an image can't be read or a shape does not fit.
    fn loss_terms(
        &mut self,
        _run: &mut Run<M>,
        _view: &View,
        _forward: &Forward,
    ) -> Result<Vec<Tensor<1>>, Error> {
        Ok(Vec::new())
    }

    /// Shows what it has learn by itself: modules, and leaves of the graph. Gradients of a step's views are summed for these.
    fn gradients(&self, _visit: &mut GradientVisit<'_>) {}

    /// After a step's backward passes, before the optimizer's step. On a CPU all gradients are finite then. On a GPU the optimizer
    /// stops itself where one is not.
    fn after_backward(&mut self, _run: &mut Run<M>, _gradients: &mut Gradients) {}

    /// Once the parameters have moved, before density control.
    fn after_update(&mut self, _run: &mut Run<M>) {}

    /// Before a round of density control of a set of `n` Gaussians.
    fn density_rules(&self, _set: Set, _n: usize, _rules: &mut Rules) {}

    /// After density control; [`Run::step`] counts the step.
    ///
    /// # Errors
    /// When an image can't be read or a shape does not fit.
    fn after_step(&mut self, _run: &mut Run<M>) -> Result<(), Error> {
        Ok(())
    }

    /// Once it is known that a step was skipped because something was not finite: on a GPU up to fifty steps later.
    fn skipped(&mut self, _run: &mut Run<M>) {}

    /// Lets state per Gaussian follow an edit of a set's rows.
    fn rows_changed(&mut self, _edit: &RowEdit) {}

    /// Changes the trained scene before it is stored.
    ///
    /// # Errors
    /// When rendering fails.
    fn finish(&self, _run: &Run<M>, finished: Finished) -> Result<Finished, Error> {
        Ok(finished)
    }

    /// The state for a checkpoint.
    fn save(&self) -> Saved {
        Saved::default()
    }

    /// Takes up the state of [`Extension::save`]; scene and method are restored already.
    ///
    /// # Errors
    /// What does not fit.
    fn restore(&mut self, _run: &Run<M>, _saved: Saved) -> Result<(), String> {
        Ok(())
    }
}
