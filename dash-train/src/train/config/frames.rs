//! What follows from the frames of a clip.

use dash_model::TrajectoryBasis;

use super::TrainConfig;

/// Most spans that a polyline gets by itself.
const MAX_SPANS: usize = 48;

impl TrainConfig {
    /// This configuration with what follows from the frames in place of zeros: one span of a polyline for every
    /// two frames, and the 4D field's finest time resolution. Where each frame is `seen_at_once` by cameras that show
    /// its shape, that has a vertex at every frame, so that what bounces off within one is not cut short; else each
    /// frame is one picture, and two share a cell. A base time resolution of zero is the finest: all levels get the
    /// same.
    pub fn for_frames(&self, n_frames: usize, seen_at_once: bool) -> Self {
        let mut config = self.clone();
        let spans = n_frames.div_ceil(2).max(2);
        let cells = if seen_at_once {
            n_frames.saturating_sub(1).max(2)
        } else {
            spans
        } as u32;
        if let TrajectoryBasis::Polyline {
            spans: unset @ 0, ..
        } = &mut config.decomposition.basis
        {
            *unset = spans.min(MAX_SPANS);
        }
        let encoder = &mut config.field.deformation.encoder;
        if let ([.., base], [.., finest]) = (
            encoder.base_resolution.as_mut_slice(),
            encoder.finest_resolution.as_mut_slice(),
        ) {
            if *finest == 0 {
                *finest = cells;
                *base = cells.min(*base);
            }
            if *base == 0 {
                *base = *finest;
            }
        }
        config
    }

    /// Makes the field's encoder coarser in space by `field.cells_with_gaps`, once: the factor is 1 then.
    pub(crate) fn coarsen_for_gaps(&mut self) {
        let factor = std::mem::replace(&mut self.field.cells_with_gaps, 1.0);
        let encoder = &mut self.field.deformation.encoder;
        for cells in [&mut encoder.base_resolution, &mut encoder.finest_resolution] {
            for axis in cells.iter_mut().take(3) {
                *axis = ((*axis as f32 * factor).ceil() as u32).max(1);
            }
        }
    }
}
