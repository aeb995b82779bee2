//! A scene that trains while a window shows it.

use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use dash_model::DynamicScene;
use dash_model::scene_file::TablePrecision;

use crate::ViewError;

/// What a run that trains hands to its window.
///
/// The run [shows](Live::show) copies of its scene and [tells](Live::tell) how far it is; the window draws the newest copy. Neither
/// waits for the other.
#[derive(Default)]
pub struct Live {
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// The newest scene, description and tensors, until the window takes it.
    newest: Option<[Vec<u8>; 2]>,
    /// How many there were.
    version: usize,
    line: String,
    /// The run wants the window closed.
    over: bool,
    /// The user has closed the window.
    closed: bool,
    wake: Option<Box<dyn Fn() + Send>>,
}

impl Live {
    /// Nothing to show yet.
    pub fn new() -> Arc<Self> {
        Arc::default()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn change(&self, change: impl FnOnce(&mut State)) {
        let mut state = self.state();
        change(&mut state);
        if let Some(wake) = &state.wake {
            wake();
        }
    }

    /// Whether the window has taken the last copy and is still open: no other is needed before.
    pub fn is_wanted(&self) -> bool {
        let state = self.state();
        state.newest.is_none() && !state.closed
    }

    /// Hands a copy of the scene to the window.
    ///
    /// # Errors
    /// When the device fails.
    pub fn show(&self, scene: &DynamicScene) -> Result<(), ViewError> {
        let bytes = scene.to_bytes(TablePrecision::Single)?;
        self.change(|state| {
            state.newest = Some(bytes);
            state.version += 1;
        });
        Ok(())
    }

    /// Says in the window how far the run is.
    pub fn tell(&self, line: String) {
        self.change(|state| state.line = line);
    }

    /// Closes the window.
    pub fn close(&self) {
        self.change(|state| state.over = true);
    }

    /// Has `wake` called at each change from now on.
    pub(crate) fn on_change(&self, wake: impl Fn() + Send + 'static) {
        self.state().wake = Some(Box::new(wake));
    }

    /// The user has closed the window.
    pub(crate) fn closed(&self) {
        let mut state = self.state();
        (state.closed, state.wake, state.newest) = (true, None, None);
    }

    pub(crate) fn is_over(&self) -> bool {
        self.state().over
    }

    /// The number of the newest copy, 0 before the first.
    pub(crate) fn version(&self) -> usize {
        self.state().version
    }

    pub(crate) fn line(&self) -> String {
        self.state().line.clone()
    }

    /// The newest copy, unless it was taken before.
    pub(crate) fn take(&self) -> Option<[Vec<u8>; 2]> {
        self.state().newest.take()
    }
}

impl fmt::Debug for Live {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let version = self.version();
        f.debug_struct("Live").field("version", &version).finish()
    }
}
