//! The decomposition: the Gaussians that move become the dynamic part.

use std::sync::Arc;

use dash_model::{DeformationField, DynamicPart, DynamicScene, Gaussians, SpaceBox};

use super::config::{Decomposition, Form, Trajectories};
use super::motion::RELEASED_BOUND;
use super::state::Dash;
use crate::Error;
use crate::dataset::Dataset;
use crate::train::core::initial::{BOX_MARGIN, BOX_TAIL};
use crate::train::core::{Run, Set, ViewSums, to_host};

impl Run<Dash> {
    /// Ends the decomposition stage: the Gaussians that move, or change otherwise, or all, become the dynamic part.
    pub(super) fn decompose(&mut self) -> Result<(), Error> {
        let coefficients = self.coefficients()?;
        let mut mask = match (self.method.config.decomposition, &coefficients) {
            (Decomposition::All | Decomposition::AllWithMotion, _) => {
                vec![true; self.scene.static_set.len()]
            }
            (_, None) => return Ok(()),
            (_, Some(_)) => self.moving()?,
        };
        if let Some(find) = &self.method.find_changing
            && self.method.config.decomposition == Decomposition::Moving
        {
            let changing = find(self, &mask)?;
            let n_moving = mask.iter().filter(|moves| **moves).count();
            if changing.contains(&true) {
                for (moves, changes) in mask.iter_mut().zip(changing) {
                    *moves |= changes;
                }
                let n_resting = mask.iter().filter(|moves| **moves).count() - n_moving;
                if n_resting > 0 {
                    tracing::info!(
                        "{n_resting} Gaussians that rest change colour: they become dynamic"
                    );
                }
                self.method.field.heads.appearance = true;
            }
        }
        self.method.motion = None;
        self.method.motion_space = None;
        self.method.scales = ViewSums::default();
        self.method.held_still = Vec::new();
        self.optimizer.forget("motion.");
        self.notes.forget_rows();
        let mut rows = self.scene.static_set.to_rows();
        rows.trajectory_width = 0;
        rows.trajectories.clear();
        let (moving, still): (Vec<usize>, Vec<usize>) = (0..rows.len()).partition(|&row| mask[row]);
        self.scene.static_set = Gaussians::from_rows(&rows.gather(&still), &self.device);
        let own = format!("{}trajectories", Set::Static.prefix());
        if moving.is_empty() {
            self.optimizer.forget(&own);
            return Ok(());
        }
        let mut dynamic_rows = rows.gather(&moving);
        if let Some(coefficients) = coefficients
            && self.method.config.trajectories == Trajectories::Polyline
        {
            let width = coefficients.dims()[1];
            let coefficients = to_host(coefficients);
            dynamic_rows.trajectory_width = width;
            dynamic_rows.trajectories = dash_model::gather_rows(&coefficients, width, &moving);
        }
        if self.method.config.deforms_colour() {
            self.method.field.heads.sh_rest = dynamic_rows.sh_rest_width / 3;
        }
        let field = &self.method.field;
        dynamic_rows.embedding_width = field.embedding_width();
        dynamic_rows.embeddings = vec![0.0; moving.len() * dynamic_rows.embedding_width];
        let [fixed, dynamic] = Set::BOTH.map(Set::prefix);
        self.optimizer
            .copy_rows(fixed, dynamic, &moving, rows.len());
        self.optimizer
            .edit_rows(fixed, &still, &vec![false; still.len()], rows.len());
        self.optimizer.forget(&own);
        let space = match self.method.config.form {
            Form::Released => SpaceBox::fixed(RELEASED_BOUND),
            Form::Paper => SpaceBox::around(&dynamic_rows.means, BOX_TAIL, BOX_MARGIN),
        };
        let field = DeformationField::new(field, space, &mut self.rng, &self.device)?;
        self.scene.dynamic = Some(DynamicPart {
            gaussians: Gaussians::from_rows(&dynamic_rows, &self.device),
            field,
        });
        self.static_state.gathered = ViewSums::new(still.len(), &self.device);
        self.dynamic_state.gathered = ViewSums::new(moving.len(), &self.device);
        Ok(())
    }

    /// Puts a run that has not begun right behind the decomposition, with this scene and with pictures of the same
    /// views, which may be of another size.
    pub(crate) fn continue_with(&mut self, scene: DynamicScene, dataset: Arc<Dataset>) {
        let (n_static, n_dynamic) = scene.counts();
        self.static_state.gathered = ViewSums::new(n_static, &self.device);
        self.dynamic_state.gathered = ViewSums::new(n_dynamic, &self.device);
        self.step = self.stages().end + 1;
        self.scene = scene;
        self.dataset = dataset;
    }
}
