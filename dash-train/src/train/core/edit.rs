//! Edits of the rows of a set: the scene, the optimizer's moments, statistics and the method's state follow together.

use dash_model::Gaussians;

use super::densify::Edit;
use super::method::Method;
use super::run::Run;
use super::sets::{RowEdit, Set};
use super::view_sums::ViewSums;

impl<M: Method> Run<M> {
    /// Gaussians of a set.
    pub fn len(&self, set: Set) -> usize {
        let (n_static, n_dynamic) = self.scene.counts();
        match set {
            Set::Static => n_static,
            Set::Dynamic => n_dynamic,
        }
    }

    /// Whether a set has no Gaussian.
    pub fn is_empty(&self, set: Set) -> bool {
        self.len(set) == 0
    }

    /// The Gaussians of a set; `None` of a dynamic set that there is not.
    pub fn gaussians(&self, set: Set) -> Option<&Gaussians> {
        match set {
            Set::Static => Some(&self.scene.static_set),
            Set::Dynamic => self.scene.dynamic.as_ref().map(|part| &part.gaussians),
        }
    }

    /// Puts other Gaussians in the place of those of a set. State per row is the caller's to keep in step.
    pub fn set_gaussians(&mut self, set: Set, gaussians: Gaussians) {
        match set {
            Set::Static => self.scene.static_set = gaussians,
            Set::Dynamic => {
                if let Some(part) = &mut self.scene.dynamic {
                    part.gaussians = gaussians;
                }
            }
        }
    }

    /// Keeps these rows of a set only, in this order. Without any dynamic Gaussian the dynamic part goes.
    pub fn keep(&mut self, set: Set, stay: &[usize]) {
        let n_before = self.len(set);
        if set == Set::Dynamic && stay.is_empty() {
            self.optimizer.forget("scene.dynamic.");
            self.scene.dynamic = None;
            self.dynamic_state.gathered = ViewSums::default();
        } else if let Some(gaussians) = self.gaussians(set) {
            let rows = gaussians.to_rows().gather(stay);
            let kept = Gaussians::from_rows(&rows, &self.device);
            let fresh = vec![false; stay.len()];
            self.optimizer
                .edit_rows(set.prefix(), stay, &fresh, n_before);
            self.set_gaussians(set, kept);
            let state = self.state(set);
            state.gathered = state.gathered.gather(stay);
        }
        self.follow(set, stay, n_before);
    }

    /// Carries out a round of density control; statistics start anew.
    pub(super) fn apply(&mut self, set: Set, edit: &Edit) {
        let n_before = self.len(set);
        let (sources, fresh) = (&edit.sources, &edit.fresh);
        self.optimizer
            .edit_rows(set.prefix(), sources, fresh, n_before);
        self.set_gaussians(set, Gaussians::from_rows(&edit.rows, &self.device));
        let gathered = ViewSums::new(edit.rows.len(), &self.device);
        self.state(set).gathered = gathered;
        self.follow(set, sources, n_before);
    }

    /// Appends Gaussians to a set, whose moments start at zero: `gaussians` are its rows and then `added` more.
    pub fn append(&mut self, set: Set, gaussians: Gaussians, added: usize) {
        let n_before = self.len(set);
        self.optimizer.extend_rows(set.prefix(), n_before, added);
        self.set_gaussians(set, gaussians);
        let device = self.device.clone();
        self.state(set).gathered.grow(added, &device);
        let old = (0..n_before).map(Some);
        self.edits.push(RowEdit {
            set,
            sources: old.chain(std::iter::repeat_n(None, added)).collect(),
            n_before,
        });
    }

    fn follow(&mut self, set: Set, sources: &[usize], n_before: usize) {
        self.notes.follow(set, sources);
        self.method.rows_changed(set, sources);
        self.edits.push(RowEdit {
            set,
            sources: sources.iter().copied().map(Some).collect(),
            n_before,
        });
    }
}
