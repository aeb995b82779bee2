//! Who looks at a run while it trains: a window, a web page, TensorBoard.

use std::cell::RefCell;
use std::path::PathBuf;
use std::sync::Arc;

use burn::tensor::Device;
use clap::Args;
use dash_train::dataset::Dataset;
use dash_train::train::{RunFolder, StepReport, Trainer};

use crate::event_log::EventLog;
use crate::failure::Failure;

#[derive(Args)]
pub struct WatchArgs {
    /// Write curves of the run as TensorBoard reads them to a file in this folder
    #[arg(long, value_name = "DIR")]
    tensorboard: Option<PathBuf>,
    /// Look at the scene in a window while it trains; closing it does not end the run
    #[cfg(feature = "view")]
    #[arg(long)]
    pub view: bool,
    #[cfg(feature = "view")]
    #[command(flatten)]
    serve: crate::serve::ServeArgs,
}

/// What opens a window on the run.
#[cfg(feature = "view")]
pub type Door = crate::train_window::Door;
/// There are no windows without the feature `view`.
#[cfg(not(feature = "view"))]
pub type Door = std::convert::Infallible;

impl WatchArgs {
    /// Whether what is asked for can be had; before the run's folder is made.
    pub fn check(&self) -> Result<(), Failure> {
        #[cfg(feature = "view")]
        {
            self.serve.check()?;
            if self.view {
                let shown = dash_view::check_display();
                shown.map_err(|error| Failure::new(format!("--view: {error}")))?;
            }
        }
        Ok(())
    }

    /// Whether anyone is to look at the run while it trains.
    pub fn is_asked(&self) -> bool {
        #[cfg(feature = "view")]
        if self.view || self.serve.is_asked() {
            return true;
        }
        self.tensorboard.is_some()
    }

    /// Begins to show a run.
    #[cfg_attr(not(feature = "view"), expect(unused_variables))]
    pub fn start(
        &self,
        run: &RunFolder,
        dataset: &Arc<Dataset>,
        device: &Device,
        door: Option<Door>,
    ) -> Result<Watchers, Failure> {
        let events = self.tensorboard.as_deref().map(EventLog::create);
        Ok(Watchers {
            events: RefCell::new(events.transpose()?),
            #[cfg(feature = "view")]
            page: RefCell::new(self.serve.start(run.root(), dataset)?),
            #[cfg(feature = "view")]
            window: RefCell::new(door.map(|door| door.open(run.root(), dataset, device))),
        })
    }
}

/// What shows a run.
pub struct Watchers {
    events: RefCell<Option<EventLog>>,
    #[cfg(feature = "view")]
    page: RefCell<Option<crate::serve::Show>>,
    #[cfg(feature = "view")]
    window: RefCell<Option<crate::train_window::TrainWindow>>,
}

impl Watchers {
    /// Takes in a step.
    #[cfg_attr(not(feature = "view"), expect(unused_variables))]
    pub fn step(&self, report: &StepReport, secs: f64, iterations: usize) {
        #[cfg(feature = "view")]
        {
            if let Some(page) = &*self.page.borrow() {
                page.step(report, secs, iterations);
            }
            if let Some(window) = &mut *self.window.borrow_mut() {
                window.step(report, secs, iterations);
            }
        }
    }

    /// Shows what is new of a run, if somebody looks; waits while it is to pause and `stop` is not asked for.
    #[cfg_attr(not(feature = "view"), expect(unused_variables))]
    pub fn look(&self, run: &RunFolder, trainer: &Trainer, stop: &dyn Fn() -> bool) {
        self.follow(run, trainer.steps_done());
        #[cfg(feature = "view")]
        {
            if let Some(window) = &mut *self.window.borrow_mut() {
                window.look(trainer);
            }
            if let Some(page) = &mut *self.page.borrow_mut() {
                page.look(trainer, stop);
            }
        }
    }

    /// Shows the finished run.
    #[cfg_attr(not(feature = "view"), expect(unused_variables))]
    pub fn finish(self, run: &RunFolder, steps: usize, device: &Device) -> Result<(), Failure> {
        self.follow(run, steps);
        #[cfg(feature = "view")]
        if let Some(window) = self.window.into_inner() {
            window.finish(&run.scene(device)?);
        }
        Ok(())
    }

    /// Writes what is new in a run's logs as events; a folder that is full ends these, not the run.
    fn follow(&self, run: &RunFolder, step: usize) {
        let mut events = self.events.borrow_mut();
        let written = events.as_mut().map_or(Ok(()), |log| log.look(run, step));
        if let Err(error) = written {
            tracing::warn!("no more curves for TensorBoard: {error}");
            *events = None;
        }
    }
}
