//! `dash train --view`: a window on a run that trains.
//!
//! Systems want windows on a program's first thread, so the run has another. It makes a copy of its scene when the window has
//! drawn the last one, and rarely enough to cost it at most a fiftieth of its time. Nothing of the run changes.

use std::panic::resume_unwind;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use burn::tensor::Device;
use dash_kernels::Camera;
use dash_model::DynamicScene;
use dash_train::cameras::focus_point;
use dash_train::dataset::Dataset;
use dash_train::train::{StepReport, Trainer};
use dash_view::{Content, Live, Source, open_window};

use crate::STACK_BYTES;
use crate::failure::Failure;
use crate::ration::Ration;
use crate::summary::duration;
use crate::view::{Desk, named_cameras};

/// Between two lines in the window.
const LINES: Duration = Duration::from_millis(500);

/// Where a run asks for its window.
pub struct Door(Sender<(Content, Desk)>);

/// Runs `work` on a thread of its own, and on this one the window that it asks for, until both are done.
pub fn beside_window(
    work: impl FnOnce(Door) -> Result<String, Failure> + Send,
) -> Result<String, Failure> {
    let (door, asked) = channel();
    thread::scope(|scope| {
        let work = || match rayon::current_num_threads() {
            // The window's thread draws with it, too.
            1 => work(Door(door)),
            _ => rayon::scope(|_| work(Door(door))),
        };
        let run = thread::Builder::new()
            .name("train".into())
            .stack_size(STACK_BYTES)
            .spawn_scoped(scope, work)
            .map_err(|e| Failure::new(format!("the system cannot start a thread: {e}")))?;
        // Nothing is asked for where the run fails before.
        if let Ok((content, desk)) = asked.recv()
            && let Err(error) = open_window(content, Box::new(desk), None)
        {
            tracing::warn!("{error}; the run goes on without a window");
        }
        run.join().unwrap_or_else(|panic| resume_unwind(panic))
    })
}

/// A run's side of its window. Dropped, it closes the window, unless the run is finished.
pub struct TrainWindow {
    live: Arc<Live>,
    ration: Ration,
    told: Option<Instant>,
    finished: bool,
}

impl Door {
    /// Opens the window of a run.
    pub fn open(self, run: &Path, dataset: &Arc<Dataset>, device: &Device) -> TrainWindow {
        let live = Live::new();
        let cameras = named_cameras(dataset);
        let poses: Vec<Camera> = cameras.iter().map(|named| named.camera.clone()).collect();
        let name = run.file_name().unwrap_or(run.as_os_str()).to_string_lossy();
        let source = Source::Live(live.clone(), device.clone());
        let content = Content {
            cameras,
            focus: Some(focus_point(&poses)),
            ..Content::new(&name, source, dataset.n_frames)
        };
        let desk = Desk::of_run(run, dataset.clone(), device.clone());
        // Nobody listens where there can be no window.
        let _ = self.0.send((content, desk));
        TrainWindow {
            live,
            ration: Ration::default(),
            told: None,
            finished: false,
        }
    }
}

impl TrainWindow {
    /// Takes in a step.
    pub fn step(&mut self, report: &StepReport, secs: f64, iterations: usize) {
        if self.told.is_some_and(|told| told.elapsed() < LINES) {
            return;
        }
        self.told = Some(Instant::now());
        self.live.tell(format!(
            "step {} of {iterations}, {}, {}, {:.1} dB",
            report.step,
            duration(secs),
            report.stage,
            report.psnr
        ));
    }

    /// Shows the present scene, if it is wanted and due.
    pub fn look(&mut self, trainer: &Trainer) {
        if !(self.live.is_wanted() && self.ration.is_due()) {
            return;
        }
        let shown = self.ration.spend(|| self.live.show(&trainer.whole_scene()));
        if let Err(error) = shown {
            tracing::warn!("the window keeps its last scene: {error}");
        }
    }

    /// Shows the finished scene, and leaves the window open.
    pub fn finish(mut self, scene: &DynamicScene) {
        self.live
            .tell("finished; close the window to end".to_string());
        if let Err(error) = self.live.show(scene) {
            tracing::warn!("the window keeps its last scene: {error}");
        }
        self.finished = true;
    }
}

impl Drop for TrainWindow {
    fn drop(&mut self) {
        if !self.finished {
            self.live.close();
        }
    }
}
