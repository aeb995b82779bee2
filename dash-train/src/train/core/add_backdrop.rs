//! A run that begins with the room of another behind it.

mod misfit;

use burn::module::Module as _;
use dash_model::{DynamicScene, GaussianRows, Gaussians};

use self::misfit::Misfit;
use super::backdrop::{Backdrop, Kept, still};
use super::run::Run;
use super::view_sums::ViewSums;
use crate::Error;

/// Fewest points that a run with a backdrop begins with, if there are as many.
const MIN_POINTS: usize = 100;

impl<M> Run<M> {
    /// Draws the room of another run behind a run that has not begun: its Gaussians are kept where they show what this run's
    /// training views have. This run begins with the others, and with those of its own first ones that lie where the room
    /// differs.
    ///
    /// # Errors
    /// When an image can't be read or a shape does not fit.
    pub fn add_backdrop(&mut self, room: &DynamicScene) -> Result<(), Error> {
        let room = room.valid();
        let rows = room.static_set.to_rows();
        let device = self.device.clone().inner();
        let whole = still(&rows, &room.settings, &device);
        let misfit = Misfit::of(&whole, self)?;
        let left_out = misfit.of_gaussians();
        let own = self.scene.static_set.to_rows();
        let new = misfit.of_points(&own.means, MIN_POINTS);
        let mut first = own.gather(&new);
        let released = rows.gather(&left_out);
        first.append(&of_degree(released, first.sh_degree()));
        tracing::info!(
            "backdrop: {} of {} Gaussians are kept; {} of {} points are where it differs by {:.3} or more",
            rows.len() - left_out.len(),
            rows.len(),
            new.len(),
            own.len(),
            misfit.threshold()
        );
        self.scene.static_set = Gaussians::from_rows(&first, &self.device);
        self.scene.settings.near_plane = room.settings.near_plane;
        self.static_state.gathered = ViewSums::new(first.len(), &self.device);
        let backdrop = Backdrop::new(&room, Kept::new(&rows, left_out), &device);
        self.backdrop = Some(backdrop.expect("rows of this scene"));
        Ok(())
    }

    /// A scene of the run together with the backdrop, if it has one.
    pub fn whole(&self, scene: &DynamicScene) -> DynamicScene {
        match &self.backdrop {
            Some(backdrop) => backdrop.with(scene),
            None => scene.clone(),
        }
    }
}

/// Rows with colour coefficients up to a degree: more are zeros, fewer are left out.
fn of_degree(mut rows: GaussianRows, degree: usize) -> GaussianRows {
    let width = ((degree + 1).pow(2) - 1) * 3;
    if rows.sh_rest_width <= width {
        return rows.with_sh_degree(degree);
    }
    let all = rows.sh_rest.chunks_exact(rows.sh_rest_width);
    rows.sh_rest = all.flat_map(|row| &row[..width]).copied().collect();
    rows.sh_rest_width = width;
    rows
}
