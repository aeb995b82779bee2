//! `dash train --serve`: a run that trains as a web page.
//!
//! The page is the one of `dash export --web`; its scene is replaced as training goes on. The run makes a new copy of the
//! scene only while somebody looks, and rarely enough to cost it at most a fiftieth of its time. Nothing of the run changes.

mod board;
mod connections;
mod site;
#[cfg(test)]
mod tests;

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use clap::Args;
use dash_kernels::Camera;
use dash_train::cameras::focus_point;
use dash_train::dataset::Dataset;
use dash_train::train::{StepReport, Trainer};
use dash_view::page::{About, PlayerCode, live_page, scene_files};
use dash_view::{FRAME_RATE, ViewError};

use crate::failure::Failure;
use crate::ration::Ration;
use crate::view::named_cameras;
use crate::web::player;
use board::Board;
use site::Site;

/// How long somebody is thought to look after a request.
const LOOKS: Duration = Duration::from_secs(5);

#[derive(Args)]
pub struct ServeArgs {
    /// While it trains, show the scene, its curves and its cameras as a web page there [default address: 127.0.0.1:8000]
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:8000")]
    serve: Option<SocketAddr>,
    /// With --serve: an address that other machines reach; the page's address then carries a token
    #[arg(long, requires = "serve")]
    serve_public: bool,
    /// With --serve: folder of the player that dash-view/web/build.sh made [default: the program's own, if it has one]
    #[arg(long, value_name = "DIR", requires = "serve")]
    player: Option<PathBuf>,
}

/// What shows a run.
pub struct Show {
    board: Arc<Board>,
    ration: Ration,
}

impl ServeArgs {
    /// Whether anyone is to look through it.
    pub fn is_asked(&self) -> bool {
        self.serve.is_some()
    }

    /// Whether what is asked for can be had; before the run's folder is made.
    pub fn check(&self) -> Result<(), Failure> {
        let Some(address) = self.serve else {
            return Ok(());
        };
        let is_loopback = match address.ip() {
            IpAddr::V4(ip) => ip.is_loopback(),
            IpAddr::V6(ip) => ip.is_loopback(),
        };
        if !is_loopback && !self.serve_public {
            return Err(Failure::usage(format!(
                "--serve {address}: other machines reach this address; add --serve-public to allow it, or leave the \
                 address out and look through a tunnel: ssh -L 8000:127.0.0.1:8000 HOST"
            )));
        }
        connections::bind(address)?;
        player(self.player.as_deref()).map(drop)
    }

    /// Starts to show a run; `None` where nobody asked for it.
    pub fn start(&self, run: &std::path::Path, dataset: &Dataset) -> Result<Option<Show>, Failure> {
        let Some(address) = self.serve else {
            return Ok(None);
        };
        let (script, module) = player(self.player.as_deref())?;
        let cameras = named_cameras(dataset);
        let poses: Vec<Camera> = cameras.iter().map(|named| named.camera.clone()).collect();
        let name = run.file_name().unwrap_or(run.as_os_str());
        let about = About::of_run(
            &name.to_string_lossy(),
            (dataset.n_frames, dataset.frame_rate.unwrap_or(FRAME_RATE)),
            focus_point(&poses),
            &cameras,
        );
        let board = Arc::new(Board::new(run.join("curve.jsonl")));
        let code = PlayerCode {
            script: &script,
            module: &module,
        };
        let site = Site::new(board.clone(), live_page(&about, code), self.serve_public);
        let token = site.token().map(|token| format!("?token={token}"));
        let address = connections::listen(address, site)?;
        tracing::info!("look at http://{address}/{}", token.unwrap_or_default());
        Ok(Some(Show {
            board,
            ration: Ration::default(),
        }))
    }
}

impl Show {
    /// Takes in a step.
    pub fn step(&self, report: &StepReport, secs: f64, iterations: usize) {
        self.board.note(report, secs, iterations);
    }

    /// Shows the present scene, if somebody looks and it is time; waits while the run is to pause and `stop` is not
    /// asked for.
    pub fn look(&mut self, trainer: &Trainer, stop: &dyn Fn() -> bool) {
        if self.board.is_watched(LOOKS) && self.ration.is_due() {
            match self.ration.spend(|| scene_files(&trainer.whole_scene())) {
                Ok(files) => self.board.show(files),
                Err(error) => told(&error),
            }
        }
        while self.board.is_paused() && !stop() {
            self.board.wait(true);
            std::thread::sleep(Duration::from_millis(50));
        }
        self.board.wait(false);
    }
}

fn told(error: &ViewError) {
    tracing::warn!("the page keeps its last picture: {error}");
}
