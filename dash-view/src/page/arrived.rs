//! The parts of a page that are here.

use std::collections::BTreeMap;

use burn::module::Param;
use burn::tensor::{Int, Tensor, TensorData};
use dash_model::{DynamicScene, Gaussians};

use super::About;
use super::names::{Owner, PartName};
use super::parts::joined;

/// Windows of time that stay here at most, unless a picture needs more.
const MOST_WINDOWS: usize = 4;

/// The parts of a page's scene that have come so far.
#[derive(Debug, Default)]
pub struct Arrived {
    /// The scenes, and how many parts of them.
    parts: BTreeMap<Owner, (DynamicScene, usize)>,
    /// Windows of the present picture with what they have of the room.
    whole: BTreeMap<usize, DynamicScene>,
}

impl Arrived {
    /// Adds the next part of a scene.
    pub fn add(&mut self, owner: Owner, part: DynamicScene) {
        let (scene, n) = match self.parts.remove(&owner) {
            None => (part, 0),
            Some((scene, n)) => (joined(scene, part), n),
        };
        self.parts.insert(owner, (scene, n + 1));
        match owner {
            Owner::Room => self.whole.clear(),
            Owner::Window(window) => {
                self.whole.remove(&window);
            }
        }
    }

    /// Puts a scene in the place of window 0.
    pub fn replace(&mut self, scene: DynamicScene) {
        self.parts.remove(&Owner::Window(0));
        self.add(Owner::Window(0), scene);
    }

    /// Whether something of a window is here.
    pub fn has(&self, window: usize) -> bool {
        self.parts.contains_key(&Owner::Window(window))
    }

    fn count(&self, owner: Owner) -> usize {
        self.parts.get(&owner).map_or(0, |(_, n)| *n)
    }

    /// The part that is wanted next by a picture of the windows `present`: at first one of the room and of each window, so that
    /// the picture is there early, then the others, then the window that follows.
    pub fn wanted(&self, about: &About, present: &[usize]) -> Option<PartName> {
        let of_window = |window: usize| about.parts.get(window).copied().unwrap_or(0);
        let last = present.last().copied().unwrap_or(0);
        let next = Owner::Window((last + 1) % about.times.len());
        let present = || present.iter().map(|&window| Owner::Window(window));
        let all = || std::iter::once(Owner::Room).chain(present());
        let parts = |owner| match owner {
            Owner::Room => about.room.parts,
            Owner::Window(window) => of_window(window),
        };
        let first = all().find(|&owner| self.count(owner) < parts(owner).min(1));
        let other = || {
            let mut owners = all().chain([next]);
            owners.find(|&owner| self.count(owner) < parts(owner))
        };
        first.or_else(other).map(|owner| PartName {
            owner,
            index: self.count(owner),
        })
    }

    /// Drops the windows that are farthest from the `present` ones, where there are many.
    pub fn tidy(&mut self, about: &About, present: &[usize]) {
        self.whole.retain(|window, _| present.contains(window));
        let first = present.first().copied().unwrap_or(0);
        let last = present.last().copied().unwrap_or(0);
        let next = (last + 1) % about.times.len();
        let windows = |owner: &Owner| match owner {
            Owner::Window(window) => Some(*window),
            Owner::Room => None,
        };
        loop {
            let here: Vec<usize> = self.parts.keys().filter_map(windows).collect();
            let others = here.iter().filter(|w| !present.contains(w) && **w != next);
            let farthest = others.max_by_key(|window| window.abs_diff(first));
            let (true, Some(&farthest)) = (here.len() > MOST_WINDOWS, farthest) else {
                return;
            };
            self.parts.remove(&Owner::Window(farthest));
            self.whole.remove(&farthest);
        }
    }

    /// What is here of a window with what it has of the room.
    pub fn scene(&mut self, about: &About, window: usize) -> Option<DynamicScene> {
        if let Some(whole) = self.whole.get(&window) {
            return Some(whole.clone());
        }
        let (own, _) = self.parts.get(&Owner::Window(window))?;
        let mut whole = own.clone();
        if let Some((room, _)) = self.parts.get(&Owner::Room) {
            let rows = about.room.rows_of(window, room.static_set.len());
            if !rows.is_empty() {
                let of_room = DynamicScene {
                    static_set: select(&room.static_set, &rows),
                    dynamic: None,
                    settings: whole.settings.clone(),
                };
                whole = joined(whole, of_room);
            }
        }
        self.whole.insert(window, whole.clone());
        Some(whole)
    }
}

/// Some rows of a set without trajectories and embeddings.
fn select(set: &Gaussians, rows: &[usize]) -> Gaussians {
    let device = set.means.val().device();
    let rows: Vec<i32> = rows.iter().map(|&row| row as i32).collect();
    let n = rows.len();
    let rows = Tensor::<1, Int>::from_data(TensorData::new(rows, [n]), &device);
    Gaussians {
        means: taken(&set.means, &rows),
        quats: taken(&set.quats, &rows),
        log_scales: taken(&set.log_scales, &rows),
        opacity_logits: taken(&set.opacity_logits, &rows),
        sh_dc: taken(&set.sh_dc, &rows),
        sh_rest: taken(&set.sh_rest, &rows),
        trajectories: None,
        embeddings: None,
    }
}

fn taken<const D: usize>(values: &Param<Tensor<D>>, rows: &Tensor<1, Int>) -> Param<Tensor<D>> {
    Param::from_tensor(values.val().select(0, rows.clone()))
}
