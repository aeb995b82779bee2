//! What windows of time share: the static Gaussians of their room, which a page holds once.

use std::collections::{HashMap, HashSet};
use std::hash::{DefaultHasher, Hash, Hasher};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use dash_model::{DynamicScene, GaussianRows, Gaussians};
use serde::{Deserialize, Serialize};

use super::parts::by_contribution;
use crate::{ViewError, WindowSource};

/// What a page says of the static Gaussians that windows share.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RoomParts {
    /// Number of their parts; none where windows share nothing.
    pub parts: usize,
    /// For each window, which of them it has: a bit for each in the order of the parts, the first one the lowest of its byte, as
    /// base64.
    pub windows: Vec<String>,
}

impl RoomParts {
    /// Of windows that share nothing.
    pub(super) fn none(n_windows: usize) -> Self {
        Self {
            parts: 0,
            windows: vec![String::new(); n_windows],
        }
    }

    /// Which of the first `n` Gaussians a window has, in order.
    pub fn rows_of(&self, window: usize, n: usize) -> Vec<usize> {
        let text = self.windows.get(window).map_or("", String::as_str);
        let bits = STANDARD.decode(text).unwrap_or_default();
        let is_set = |&row: &usize| {
            bits.get(row / 8)
                .is_some_and(|byte| byte >> (row % 8) & 1 == 1)
        };
        (0..n).filter(is_set).collect()
    }
}

/// The static Gaussians that more than one window has.
pub(super) struct Room {
    /// In falling order of what a picture shows of them.
    pub(super) rows: GaussianRows,
    /// Their places among the rows.
    places: HashMap<u64, usize>,
}

impl Room {
    /// Looks through all windows; `None` where they share nothing.
    pub(super) fn of(windows: &dyn WindowSource) -> Result<Option<Self>, ViewError> {
        let mut counts: HashMap<u64, u32> = HashMap::new();
        let (mut hashes, mut degree) = (Vec::new(), 0);
        for window in 0..windows.times().len() {
            let rows = windows.scene(window)?.static_set.to_rows();
            degree = rows.sh_degree().max(degree);
            let own: HashSet<u64> = (0..rows.len()).map(|row| hash(&rows, row)).collect();
            for hash in &own {
                *counts.entry(*hash).or_default() += 1;
            }
            hashes.push(own);
        }
        counts.retain(|_, count| *count > 1);
        let mut rows: Option<GaussianRows> = None;
        for (window, own) in hashes.iter().enumerate() {
            // Each is taken from the first window that has it.
            let mut new: HashSet<u64> = own.iter().copied().collect();
            new.retain(|hash| counts.remove(hash).is_some());
            if new.is_empty() {
                continue;
            }
            let of_window = untracked(windows.scene(window)?.static_set.to_rows());
            let is_new = |&row: &usize| new.remove(&hash(&of_window, row));
            let places: Vec<usize> = (0..of_window.len()).filter(is_new).collect();
            let of_window = of_window.gather(&places).with_sh_degree(degree);
            match &mut rows {
                None => rows = Some(of_window),
                Some(rows) => rows.append(&of_window),
            }
        }
        Ok(rows.map(|rows| {
            let rows = rows.gather(&by_contribution(&rows));
            let places = (0..rows.len()).map(|row| (hash(&rows, row), row));
            Self {
                places: places.collect(),
                rows,
            }
        }))
    }

    /// A window's scene without what is in the room, and which of the room's Gaussians it has, as [`RoomParts::windows`] says
    /// it.
    pub(super) fn taken_from(&self, scene: DynamicScene) -> (DynamicScene, String) {
        let device = scene.static_set.means.val().device();
        let degree = self.rows.sh_degree();
        let rows = untracked(scene.static_set.to_rows()).with_sh_degree(degree);
        let mut bits = vec![0u8; self.rows.len().div_ceil(8)];
        let mut is_own = |&row: &usize| {
            let place = self.places.get(&hash(&rows, row)).copied();
            // Two different Gaussians may have one hash.
            let place = place.filter(|&place| rows.gather(&[row]) == self.rows.gather(&[place]));
            let Some(place) = place.filter(|place| bits[place / 8] >> (place % 8) & 1 == 0) else {
                return true;
            };
            bits[place / 8] |= 1 << (place % 8);
            false
        };
        let own: Vec<usize> = (0..rows.len()).filter(|row| is_own(row)).collect();
        let dynamic = scene.dynamic.map(|mut part| {
            let rows = part.gaussians.to_rows().with_sh_degree(degree);
            part.gaussians = Gaussians::from_rows(&rows, &device);
            part
        });
        let scene = DynamicScene {
            static_set: Gaussians::from_rows(&rows.gather(&own), &device),
            dynamic,
            settings: scene.settings,
        };
        (scene, STANDARD.encode(bits))
    }
}

/// What is drawn of static Gaussians: without trajectories.
fn untracked(mut rows: GaussianRows) -> GaussianRows {
    rows.trajectories.clear();
    rows.trajectory_width = 0;
    rows
}

/// Of a Gaussian's values, whatever the SH degree of its rows.
fn hash(rows: &GaussianRows, row: usize) -> u64 {
    let mut hasher = DefaultHasher::new();
    let [means, log_scales, sh_dc] =
        [&rows.means, &rows.log_scales, &rows.sh_dc].map(|values| values[row].as_slice());
    let sh_rest = &rows.sh_rest[row * rows.sh_rest_width..][..rows.sh_rest_width];
    let end = sh_rest.iter().rposition(|&value| value != 0.0);
    let sh_rest = &sh_rest[..end.map_or(0, |last| last + 1)];
    for values in [means, log_scales, sh_dc, &rows.quats[row], sh_rest] {
        values
            .iter()
            .for_each(|value| value.to_bits().hash(&mut hasher));
    }
    rows.opacity_logits[row].to_bits().hash(&mut hasher);
    hasher.finish()
}
