//! Scene flow in a checkpoint.

use dash_model::parameters::{named_parameters, with_parameters};
use glam::Vec3;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::{OFFSETS, Present, SceneFlow, grid};
use crate::train::core::{Run, Saved};
use crate::train::paper::Dash;

/// What a checkpoint's JSON holds.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    width: f32,
    known: Vec<usize>,
    present: Option<(usize, [usize; 2])>,
}

impl SceneFlow {
    /// The state for a checkpoint.
    pub(in super::super) fn save(&self) -> Saved {
        let mut saved = Saved::of_values(&State {
            width: self.width,
            known: self.known.keys().copied().collect(),
            present: self
                .present
                .as_ref()
                .map(|present| (present.place, present.steps)),
        });
        let flat = |values: &[Vec3]| values.iter().flat_map(Vec3::to_array).collect::<Vec<f32>>();
        saved.insert(
            "known",
            self.known.values().flat_map(|known| flat(known)).collect(),
        );
        if let Some(present) = &self.present {
            saved.insert("from", flat(&present.from));
            saved.insert("expected", flat(&present.expected));
            saved.insert("moves", present.moves.clone());
            let named = named_parameters(&present.offsets).into_iter();
            let named = named.map(|(name, tensor)| (format!("{OFFSETS}.{name}"), tensor));
            saved.tensors.extend(named);
        }
        saved
    }

    /// The same again.
    pub(in super::super) fn restore(run: &Run<Dash>, mut saved: Saved) -> Result<Self, String> {
        let state: State = saved.read()?;
        let n = run.scene.static_set.len();
        let mut points = |name: &str, count: usize| -> Result<Vec<Vec3>, String> {
            let flat = saved.take(name)?;
            let fits = flat.len() == 3 * count;
            fits.then(|| flat.chunks_exact(3).map(Vec3::from_slice).collect())
                .ok_or(format!(
                    "`{name}` of {} numbers, not {}",
                    flat.len(),
                    3 * count
                ))
        };
        let known = points("known", n * state.known.len())?;
        let known = state
            .known
            .iter()
            .copied()
            .zip(known.chunks(n.max(1)).map(<[Vec3]>::to_vec));
        let mut flow = Self::new(run);
        flow.width = state.width;
        flow.known.extend(known);
        let n_times = run.times.all().len();
        if let Some((place, steps)) = state.present {
            let (from, expected) = (points("from", n)?, points("expected", n)?);
            let moves = saved.take("moves")?;
            if moves.len() != n || place >= n_times {
                return Err(format!(
                    "`moves` of {} numbers at time {place}",
                    moves.len()
                ));
            }
            // Its start is replaced by what was trained; any generator does.
            let skeleton = grid().init(&mut Pcg64::seed_from_u64(0), &run.device);
            let skeleton = skeleton.map_err(|e| e.to_string())?;
            let tensors = std::mem::take(&mut saved.tensors).into_iter();
            let own = tensors.filter_map(|(name, tensor)| {
                let name = name.strip_prefix(OFFSETS)?.strip_prefix('.')?;
                Some((name.to_string(), tensor))
            });
            let offsets = with_parameters(skeleton, own.collect()).map_err(|e| e.to_string())?;
            run.optimizer.check_sizes(OFFSETS, &offsets)?;
            flow.present = Some(Present {
                place,
                steps,
                from,
                expected,
                moves,
                on_device: None,
                offsets,
            });
        }
        if flow.known.keys().any(|&place| place >= n_times) {
            return Err(format!("a time beyond the {n_times} of the dataset"));
        }
        Ok(flow)
    }
}
