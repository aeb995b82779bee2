//! What a run is extended by.

use std::any::Any;

use super::densify::Densify;
use super::extension::Extension;
use super::finished::Finished;
use super::replicas::Exchange;
use super::run::Run;
use crate::Error;

/// The extensions of a run, in order, and its density control.
pub struct Hooks<M> {
    /// Extensions; each hook is called in this order.
    pub extensions: Vec<Box<dyn Extension<M>>>,
    /// The policy of density control.
    pub densify: Box<dyn Densify>,
    /// What joins the run with its replicas; `None`: it draws all views itself.
    pub exchange: Option<Box<dyn Exchange>>,
    pub(super) has_begun: bool,
}

impl<M: 'static> Hooks<M> {
    /// Extensions for a run that has just been made, which they are told of.
    pub fn new(
        mut extensions: Vec<Box<dyn Extension<M>>>,
        densify: Box<dyn Densify>,
        run: &mut Run<M>,
    ) -> Self {
        for extension in &mut extensions {
            extension.init(run);
        }
        Self {
            extensions,
            densify,
            exchange: None,
            has_begun: false,
        }
    }

    /// The extension of a type, if it is among them.
    pub fn get<E: Extension<M>>(&self) -> Option<&E> {
        let mut all = self.extensions.iter();
        all.find_map(|extension| (&**extension as &dyn Any).downcast_ref())
    }

    /// The same, to change it.
    pub fn get_mut<E: Extension<M>>(&mut self) -> Option<&mut E> {
        let mut all = self.extensions.iter_mut();
        all.find_map(|extension| (&mut **extension as &mut dyn Any).downcast_mut())
    }

    /// Calls a hook of every extension.
    ///
    /// # Errors
    /// The first that one of them has.
    pub(super) fn each(
        &mut self,
        run: &mut Run<M>,
        mut hook: impl FnMut(&mut dyn Extension<M>, &mut Run<M>) -> Result<(), Error>,
    ) -> Result<(), Error> {
        for extension in &mut self.extensions {
            hook(&mut **extension, run)?;
        }
        self.tell_edits(run);
        Ok(())
    }

    /// Tells extensions which rows changed since they were last told.
    pub(super) fn tell_edits(&mut self, run: &mut Run<M>) {
        for edit in std::mem::take(&mut run.edits) {
            for extension in &mut self.extensions {
                extension.rows_changed(&edit);
            }
        }
    }

    /// What extensions leave of a trained scene.
    ///
    /// # Errors
    /// When rendering fails.
    pub fn finish(&self, run: &Run<M>) -> Result<Finished, Error> {
        let mut finished = Finished {
            scene: run.scene.clone(),
            precision: dash_model::scene_file::TablePrecision::Single,
            decisions: Vec::new(),
        };
        for extension in &self.extensions {
            finished = extension.finish(run, finished)?;
        }
        Ok(finished)
    }
}
