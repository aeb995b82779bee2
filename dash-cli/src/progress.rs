//! Reports on long work: a bar on a terminal, a line now and then elsewhere.

use std::io::IsTerminal;

use dash_train::train::StepReport;
use indicatif::{ProgressBar, ProgressStyle};

use crate::Shared;
use crate::summary::duration;

/// Lines that are logged over the whole work.
const LINES: usize = 10;
/// Weight of the newest step in the shown loss and PSNR, which jump from view to view.
const SMOOTHING: f32 = 0.05;

/// A report on work of known length.
pub struct Progress {
    bar: Option<ProgressBar>,
    total: usize,
    lines: usize,
}

impl Progress {
    /// A report on `total` steps; a bar on a terminal unless `-q`.
    pub fn new(total: usize, shared: &Shared) -> Self {
        let bar = (std::io::stderr().is_terminal() && !shared.quiet).then(|| {
            // Without the style the bar would still show, only plainer.
            let style = ProgressStyle::with_template("{bar:16} {pos}/{len} {msg}, {eta} left")
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            ProgressBar::new(total as u64).with_style(style)
        });
        Self {
            bar,
            total,
            lines: 0,
        }
    }

    /// `done` steps are done; `text` says how they went.
    pub fn at(&mut self, done: usize, text: impl FnOnce() -> String) {
        if let Some(bar) = &self.bar {
            bar.set_message(text());
            bar.set_position(done as u64);
        } else if done * LINES / self.total.max(1) > self.lines {
            self.lines = done * LINES / self.total.max(1);
            tracing::info!("{done}/{} {}", self.total, text());
        }
    }

    /// What is said next is of what follows `done` steps.
    fn skip_to(&mut self, done: usize) {
        self.lines = done * LINES / self.total.max(1);
    }

    /// Removes the bar.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Reports on one run after another.
pub struct RunsProgress<'a> {
    shared: &'a Shared,
    present: Option<TrainProgress>,
}

impl<'a> RunsProgress<'a> {
    /// Before the first run.
    pub fn new(shared: &'a Shared) -> Self {
        Self {
            shared,
            present: None,
        }
    }

    /// A run of `iterations` steps begins.
    pub fn begin(&mut self, iterations: usize) {
        self.end();
        self.present = Some(TrainProgress::new(iterations, self.shared));
    }

    /// One step of it is done; `secs` of training so far.
    pub fn step(&mut self, report: &StepReport, secs: f64) {
        if let Some(progress) = &mut self.present {
            progress.step(report, secs);
        }
    }

    /// Removes its bar.
    pub fn end(&mut self) {
        if let Some(progress) = self.present.take() {
            progress.finish();
        }
    }
}

/// A report on training.
pub struct TrainProgress {
    progress: Progress,
    smoothed: Option<(f32, f32)>,
    /// Step and seconds at which this process began.
    start: Option<(usize, f64)>,
    iterations: usize,
}

impl TrainProgress {
    /// A report on a run of `iterations` steps.
    pub fn new(iterations: usize, shared: &Shared) -> Self {
        let progress = Progress::new(iterations, shared);
        Self {
            progress,
            smoothed: None,
            start: None,
            iterations,
        }
    }

    /// One step is done; `secs` of training so far.
    pub fn step(&mut self, report: &StepReport, secs: f64) {
        let (loss, psnr) = match self.smoothed {
            Some(before) if report.n_sound() == 0 => before,
            None => (report.loss, report.psnr),
            Some((loss, psnr)) => {
                let share = 1.0 - (1.0 - SMOOTHING).powi(report.n_sound() as i32);
                (
                    loss + share * (report.loss - loss),
                    psnr + share * (report.psnr - psnr),
                )
            }
        };
        self.smoothed = Some((loss, psnr));
        let (first, since) = match self.start {
            Some(start) => start,
            None => {
                // The first step of a resumed run says little of the time that is left.
                self.progress.skip_to(report.step);
                *self.start.insert((report.step, secs))
            }
        };
        let per_step = (secs - since) / (report.step - first).max(1) as f64;
        let left = per_step * (self.iterations - report.step) as f64;
        let on_terminal = self.progress.bar.is_some();
        self.progress.at(report.step, || {
            let text = format!(
                "{}: loss {loss:.4}, PSNR {psnr:.2} dB, {} static, {} dynamic",
                report.stage, report.n_static, report.n_dynamic
            );
            // The bar shows the time left itself.
            if on_terminal {
                text
            } else {
                format!("{text}, {} left", duration(left))
            }
        });
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.progress.finish();
    }
}
