//! What a run tells its page.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use dash_train::train::StepReport;
use serde::Serialize;
use serde_json::Value;

/// Points of a curve; beyond them every other one is dropped.
const POINTS: usize = 500;

/// What a run tells its page, and what the page asks of the run.
pub struct Board {
    state: Mutex<State>,
    /// Scores of test views, a line each, where the run takes any.
    curve: PathBuf,
}

struct State {
    told: Told,
    /// Steps between points of the curves.
    stride: usize,
    /// Means over the steps since the last point: steps, loss, PSNR.
    since: (usize, f64, f64),
    /// The newest scene and the one before: a browser may be in the middle of that.
    scenes: [BTreeMap<String, Vec<u8>>; 2],
    seen: Option<Instant>,
}

/// As the page reads it.
#[derive(Debug, Clone, Default, Serialize)]
struct Told {
    step: usize,
    iterations: usize,
    secs: f64,
    stage: &'static str,
    n_static: usize,
    n_dynamic: usize,
    /// Steps, mean losses, mean PSNR of training views.
    curve: Vec<(usize, f64, f64)>,
    /// Steps and PSNR of test views.
    held_out: Vec<(usize, f64)>,
    paused: bool,
    /// Whether the run waits, as it was asked to.
    waits: bool,
    /// Number of the newest scene, 0 before the first.
    version: usize,
    parts: usize,
}

impl Board {
    pub fn new(curve: PathBuf) -> Self {
        Self {
            state: Mutex::new(State {
                told: Told::default(),
                stride: 1,
                since: (0, 0.0, 0.0),
                scenes: Default::default(),
                seen: None,
            }),
            curve,
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes in a step.
    pub fn note(&self, report: &StepReport, secs: f64, iterations: usize) {
        let mut state = self.state();
        let told = &mut state.told;
        (told.step, told.iterations, told.secs) = (report.step, iterations, secs);
        told.stage = report.stage;
        (told.n_static, told.n_dynamic) = (report.n_static, report.n_dynamic);
        let n_sound = report.n_sound();
        if n_sound == 0 {
            return;
        }
        let (n, loss, psnr) = state.since;
        let (n, loss, psnr) = (
            n + n_sound,
            loss + n_sound as f64 * f64::from(report.loss),
            psnr + n_sound as f64 * f64::from(report.psnr),
        );
        state.since = (n, loss, psnr);
        if n < state.stride {
            return;
        }
        let point = (report.step, loss / n as f64, psnr / n as f64);
        state.told.curve.push(point);
        state.since = (0, 0.0, 0.0);
        if state.told.curve.len() > POINTS {
            let kept = state.told.curve.iter().copied().skip(1).step_by(2);
            state.told.curve = kept.collect();
            state.stride *= 2;
        }
    }

    /// Takes in a newer scene.
    pub fn show(&self, files: BTreeMap<String, Vec<u8>>) {
        let mut state = self.state();
        state.told.parts = files
            .keys()
            .filter(|name| name.ends_with(".bin.gz"))
            .count();
        state.told.version += 1;
        state.scenes.rotate_right(1);
        state.scenes[0] = files;
    }

    /// A file of one of the last scenes.
    pub fn file(&self, version: usize, name: &str) -> Option<Vec<u8>> {
        let state = self.state();
        let age = state.told.version.checked_sub(version)?;
        state.scenes.get(age)?.get(name).cloned()
    }

    /// Whether somebody has looked within so much time.
    pub fn is_watched(&self, within: Duration) -> bool {
        self.state()
            .seen
            .is_some_and(|seen| seen.elapsed() < within)
    }

    pub fn is_paused(&self) -> bool {
        self.state().told.paused
    }

    pub fn pause(&self, paused: bool) {
        self.state().told.paused = paused;
    }

    /// Whether the run waits between two steps.
    pub fn wait(&self, waits: bool) {
        self.state().told.waits = waits;
    }

    /// Everything as JSON; who asks for it looks.
    pub fn json(&self) -> Vec<u8> {
        let told = {
            let mut state = self.state();
            state.seen = Some(Instant::now());
            let mut told = state.told.clone();
            told.held_out = self.held_out();
            told
        };
        serde_json::to_vec(&told).expect("every key is a string, every value plain")
    }

    fn held_out(&self) -> Vec<(usize, f64)> {
        let lines = fs::read_to_string(&self.curve).unwrap_or_default();
        let point = |line: &str| {
            let line: Value = serde_json::from_str(line).ok()?;
            Some((line["step"].as_u64()? as usize, line["psnr"].as_f64()?))
        };
        lines.lines().filter_map(point).collect()
    }
}
