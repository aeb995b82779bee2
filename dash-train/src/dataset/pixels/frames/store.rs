//! Frames made on demand, within a budget of bytes.
//!
//! Worker threads decode the frames that a caller waits for, then those that the announced order needs
//! next. The order is known, so eviction follows Belady's rule: the frame that is needed last goes
//! first. A group of pictures of a video is decoded once for all of its frames that fit.

use std::collections::{HashMap, HashSet};
use std::panic::{self, AssertUnwindSafe};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::groups::{groups, make_group};
use super::memory::bytes_in_words;
use super::recipe::Recipe;
use crate::Error;
use crate::dataset::pixels::image::ImageData;

/// Frames that must fit besides those being decoded; with fewer, the same ones would be decoded again and again.
const LEAST_FRAMES: u64 = 4;
/// A frame that the announced order does not name.
const UNKNOWN: usize = usize::MAX;

/// Statistics of frames on demand.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FrameStatistics {
    /// Frames that were asked for.
    pub asked: u64,
    /// Those that a caller had to wait for.
    pub waits: u64,
    /// Seconds waited for them.
    pub waited_secs: f64,
    /// Frames that were decoded.
    pub decoded: u64,
}

/// Frames of a dataset that does not fit memory as a whole.
#[derive(Debug)]
pub(crate) struct FrameStore {
    shared: Arc<Shared>,
    workers: Vec<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared {
    recipes: Vec<Recipe>,
    groups: Vec<Vec<usize>>,
    group_of: Vec<usize>,
    capacity: u64,
    state: Mutex<State>,
    /// Something was made, asked for or announced.
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    held: HashMap<usize, Arc<ImageData>>,
    held_bytes: u64,
    /// Announced frames in order; those before `clock` are past.
    order: Vec<usize>,
    clock: usize,
    /// For each frame its next place in the order.
    places: Vec<usize>,
    /// Frames that callers wait for, and how many do.
    awaited: HashMap<usize, usize>,
    /// Groups being made.
    at_work: HashSet<usize>,
    /// Groups that failed while a caller waited.
    failures: HashMap<usize, Error>,
    /// Groups that failed ahead of time; they are tried again only when a caller waits.
    broken: HashSet<usize>,
    statistics: FrameStatistics,
    waited: Duration,
    is_closed: bool,
}

impl FrameStore {
    /// A store that keeps to `budget` bytes, with `threads` threads that make frames.
    ///
    /// # Errors
    /// When not even a few frames fit the budget.
    pub(crate) fn new(recipes: Vec<Recipe>, budget: u64, threads: usize) -> Result<Self, Error> {
        let largest = |of: fn(&Recipe) -> u64| recipes.iter().map(of).max().unwrap_or(0);
        let working = largest(Recipe::working_bytes) * threads as u64;
        let least = working + (LEAST_FRAMES + threads as u64) * largest(Recipe::bytes);
        if budget < least {
            return Err(Error::LoadOption {
                option: "--memory",
                expected: format!(
                    "at least {} for frames of this size, or smaller ones (--downscale)",
                    bytes_in_words(least)
                ),
                found: bytes_in_words(budget),
            });
        }
        let groups = groups(&recipes);
        let mut group_of = vec![0; recipes.len()];
        for (group, members) in groups.iter().enumerate() {
            for &index in members {
                group_of[index] = group;
            }
        }
        let state = State {
            places: vec![UNKNOWN; recipes.len()],
            ..State::default()
        };
        let shared = Arc::new(Shared {
            // The working memory of threads and the frames in their hands count too.
            capacity: budget - working - threads as u64 * largest(Recipe::bytes),
            recipes,
            groups,
            group_of,
            state: Mutex::new(state),
            changed: Condvar::new(),
        });
        let workers = (0..threads.max(1))
            .map(|_| {
                let shared = shared.clone();
                thread::spawn(move || shared.work())
            })
            .collect();
        Ok(Self { shared, workers })
    }

    /// The frame, waited for where it is not there.
    pub(crate) fn get(&self, index: usize) -> Result<Arc<ImageData>, Error> {
        self.shared.get(index)
    }

    /// Replaces the announced order.
    pub(crate) fn announce(&self, order: Vec<usize>) {
        let mut state = self.shared.lock();
        state.places.fill(UNKNOWN);
        for (place, &index) in order.iter().enumerate().rev() {
            state.places[index] = place;
        }
        state.order = order;
        state.clock = 0;
        drop(state);
        self.shared.changed.notify_all();
    }

    /// The statistics so far.
    pub(crate) fn statistics(&self) -> FrameStatistics {
        let state = self.shared.lock();
        FrameStatistics {
            waited_secs: state.waited.as_secs_f64(),
            ..state.statistics
        }
    }

    #[cfg(test)]
    pub(crate) fn holds(&self, index: usize) -> bool {
        self.shared.lock().held.contains_key(&index)
    }

    /// Memory that frames take at the moment.
    #[cfg(test)]
    pub(crate) fn held_bytes(&self) -> u64 {
        self.shared.lock().held_bytes
    }
}

impl Drop for FrameStore {
    fn drop(&mut self) {
        self.shared.lock().is_closed = true;
        self.shared.changed.notify_all();
        for worker in self.workers.drain(..) {
            // A thread that panicked has said so already.
            let _ = worker.join();
        }
    }
}

impl Shared {
    /// The state is consistent even after a panic elsewhere: every change is made under one lock.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State>) -> MutexGuard<'a, State> {
        self.changed
            .wait(state)
            .unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn get(&self, index: usize) -> Result<Arc<ImageData>, Error> {
        let mut state = self.lock();
        state.statistics.asked += 1;
        state.consume(index);
        if let Some(image) = state.held.get(&index) {
            let image = image.clone();
            drop(state);
            // The order has moved on: there may be room for what comes next.
            self.changed.notify_all();
            return Ok(image);
        }
        let start = Instant::now();
        *state.awaited.entry(index).or_default() += 1;
        self.changed.notify_all();
        let outcome = loop {
            if let Some(image) = state.held.get(&index) {
                break Ok(image.clone());
            }
            if let Some(failure) = state.failures.remove(&self.group_of[index]) {
                break Err(failure);
            }
            state = self.wait(state);
        };
        if let Some(count) = state.awaited.get_mut(&index) {
            *count -= 1;
            if *count == 0 {
                state.awaited.remove(&index);
            }
        }
        state.statistics.waits += 1;
        state.waited += start.elapsed();
        outcome
    }

    /// The loop of a worker thread, until the store is dropped.
    fn work(&self) {
        let mut state = self.lock();
        while !state.is_closed {
            let Some(group) = self.next_group(&state) else {
                state = self.wait(state);
                continue;
            };
            state.at_work.insert(group);
            drop(state);
            let members = &self.groups[group];
            // A decoder that panics must not leave others waiting for ever.
            let made = panic::catch_unwind(AssertUnwindSafe(|| {
                make_group(&self.recipes, members, |index, image| {
                    self.keep(index, image);
                    Ok(())
                })
            }));
            let outcome =
                made.unwrap_or_else(|_| Err(self.recipes[members[0]].source.is_missing()));
            state = self.lock();
            state.at_work.remove(&group);
            match outcome {
                Ok(()) => {}
                Err(failure) if state.is_awaited(&self.groups[group]) => {
                    state.failures.insert(group, failure);
                }
                Err(_) => {
                    state.broken.insert(group);
                }
            }
            self.changed.notify_all();
        }
    }

    /// The group to decode next: one that a caller waits for, else the next in the order that fits.
    fn next_group(&self, state: &State) -> Option<usize> {
        let free =
            |group: &usize| !state.at_work.contains(group) && !state.failures.contains_key(group);
        let awaited = state.awaited.keys().filter(|i| !state.held.contains_key(i));
        if let Some(group) = awaited.map(|&i| self.group_of[i]).find(free) {
            return Some(group);
        }
        let upcoming = state.order.get(state.clock..)?;
        let index = *upcoming.iter().find(|index| {
            let group = self.group_of[**index];
            !state.held.contains_key(index) && free(&group) && !state.broken.contains(&group)
        })?;
        self.has_room(state, index).then(|| self.group_of[index])
    }

    /// Whether the frame fits beside those that are needed sooner, held or being decoded.
    fn has_room(&self, state: &State, index: usize) -> bool {
        let place = state.places[index];
        let sooner: u64 = state
            .held
            .keys()
            .filter(|&&held| !state.can_go(held, place))
            .map(|&held| self.recipes[held].bytes())
            .sum();
        let being_made: u64 = state
            .at_work
            .iter()
            .flat_map(|&group| &self.groups[group])
            .filter(|made| state.place(**made) <= place && !state.held.contains_key(made))
            .map(|&made| self.recipes[made].bytes())
            .sum();
        sooner + being_made + self.recipes[index].bytes() <= self.capacity
    }

    /// Holds a frame, if evicting frames that are needed later makes room for it.
    fn keep(&self, index: usize, image: ImageData) {
        let mut state = self.lock();
        state.statistics.decoded += 1;
        let place = state.place(index);
        let bytes = self.recipes[index].bytes();
        while !state.held.contains_key(&index) && state.held_bytes + bytes > self.capacity {
            let last = state
                .held
                .keys()
                .copied()
                .filter(|&held| state.can_go(held, place))
                .max_by_key(|&held| (state.places[held], held));
            let Some(last) = last else { return };
            state.held.remove(&last);
            state.held_bytes -= self.recipes[last].bytes();
        }
        if state.held.insert(index, Arc::new(image)).is_none() {
            state.held_bytes += bytes;
        }
        drop(state);
        self.changed.notify_all();
    }
}

impl State {
    /// Advances the clock past this frame, if it is in the order.
    fn consume(&mut self, index: usize) {
        let place = self.places[index];
        if place == UNKNOWN {
            return;
        }
        self.clock = self.clock.max(place + 1);
        let later = self.order[place + 1..].iter().position(|&i| i == index);
        self.places[index] = later.map_or(UNKNOWN, |at| place + 1 + at);
    }

    /// The frame's place in the order; 0 where a caller waits for it.
    fn place(&self, index: usize) -> usize {
        if self.awaited.contains_key(&index) {
            0
        } else {
            self.places[index]
        }
    }

    /// Whether a held frame may be evicted for one that is needed at `place`.
    fn can_go(&self, held: usize, place: usize) -> bool {
        !self.awaited.contains_key(&held) && (place == 0 || self.places[held] > place)
    }

    fn is_awaited(&self, group: &[usize]) -> bool {
        group.iter().any(|index| self.awaited.contains_key(index))
    }
}
