//! Motion before the split: a field discovers it from frame to frame, then every Gaussian gets a
//! trajectory of its own, which it keeps only as far as the pictures pay for it.

use burn::tensor::Tensor;
use dash_model::Gaussians;

use super::config::{Selection, TimeWindow, TrainConfig};
use super::optimizer::to_host;
use super::split;
use super::trainer::{STATIC, Trainer};
use crate::Error;
use crate::dataset::{Dataset, View};

/// Share of the field's time after which a growing window has all times.
const GROWN: f32 = 0.8;
/// Frames that count as new when the window reaches them.
const NEW_FRAMES: f32 = 2.0;
/// Cameras at one time that show the scene's shape.
const MIN_CAMERAS: usize = 4;
/// Views of several times that do, if these are not far apart.
const MIN_VIEWS: usize = 8;
/// Spread of their positions, as a share of that of all.
const MIN_SPREAD: f64 = 0.5;
/// Spread of cameras that stand in one place, as a share of where they are.
const NO_SPREAD: f64 = 1e-6;
/// Most of the clip that training may start from.
const MAX_START_PART: f32 = 0.1;

/// The steps at which the stages before the 4D one change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Stages {
    /// End of the warm-up: the coarse field starts.
    pub(crate) warmup: usize,
    /// Each Gaussian gets a trajectory of its own.
    pub(crate) settle: usize,
    /// The split.
    pub(crate) end: usize,
}

impl Stages {
    /// The stages of a trainer's run.
    pub(crate) fn of(trainer: &Trainer) -> Self {
        Self::of_config(&trainer.config)
    }

    /// The stages of a run.
    fn of_config(config: &TrainConfig) -> Self {
        let stages = &config.stages;
        let end = match config.decomposition.select {
            Selection::Moving => stages.decomposition,
            Selection::All => stages.warmup,
        };
        let settle = stages.warmup + stages.settle * (end - stages.warmup);
        Self {
            warmup: config.step_at(stages.warmup),
            settle: config.step_at(settle),
            end: config.step_at(end),
        }
    }

    /// What is left of the coarse field's rate at `step`. It comes to rest once it has seen all
    /// times: Adam's steps do not get smaller by themselves, and what still jitters would pass for
    /// motion.
    pub(crate) fn field_rate(self, step: usize) -> f32 {
        ((1.0 - share(self.warmup, self.settle, step)) / (1.0 - GROWN)).clamp(0.0, 1.0)
    }

    /// What is left of the rate of the Gaussians' own trajectories at `step`, until the split.
    pub(crate) fn trajectory_rate(self, step: usize) -> f32 {
        1.0 - share(self.settle, self.end, step).min(1.0)
    }
}

/// How far `step` is between two others.
fn share(from: usize, to: usize, step: usize) -> f32 {
    step.saturating_sub(from) as f32 / to.saturating_sub(from).max(1) as f32
}

/// Changes stage where the step number says so.
pub(crate) fn enter_stage(trainer: &mut Trainer) -> Result<(), Error> {
    if !trainer.may_move() {
        return Ok(());
    }
    let stages = Stages::of(trainer);
    if trainer.step == stages.warmup && stages.warmup < stages.end {
        split::start_motion(trainer)?;
        trainer.sampler.restart();
    }
    if trainer.step == stages.settle && stages.settle < stages.end {
        settle(trainer)?;
    }
    if trainer.step == stages.end {
        split::split(trainer)?;
        trainer.sampler.restart();
    }
    Ok(())
}

/// Trajectory coefficients `[N, B * 3]` of all Gaussians; `None` while nothing moves and after the
/// split.
pub(crate) fn coefficients(trainer: &Trainer) -> Result<Option<Tensor<2>>, Error> {
    let set = &trainer.scene.static_set;
    Ok(match (&trainer.motion, &set.trajectories) {
        (Some(field), _) => Some(field.coefficients(set.means.val())?),
        (None, Some(own)) => Some(own.val()),
        (None, None) => None,
    })
}

/// A part of the clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Part {
    /// Its first time.
    from: f32,
    /// Its last.
    to: f32,
}

impl Part {
    /// Whether it holds a time.
    pub(crate) fn holds(self, time: f32) -> bool {
        (self.from..=self.to).contains(&time)
    }

    /// Whether it is longer than one time: no time by itself shows the scene's shape.
    pub(crate) fn has_several_times(self) -> bool {
        self.from < self.to
    }

    /// The time in its middle.
    pub(crate) fn middle(self) -> f32 {
        0.5 * (self.from + self.to)
    }
}

/// The shortest part of the clip, around its middle, in which the training cameras see the scene from
/// sides enough to make out its shape: one time of a rig, a few of cameras that take turns, none of a
/// camera that is carried along. From the middle, what moves is followed both ways, half as far as from an
/// end.
pub(crate) fn start_part(dataset: &Dataset, train_views: &[usize]) -> Option<Part> {
    let mut views: Vec<&View> = train_views.iter().map(|&i| &dataset.views[i]).collect();
    views.sort_by(|a, b| a.time.total_cmp(&b.time));
    let (first, last) = (views.first()?.time, views.last()?.time);
    let middle = views[views.len() / 2].time;
    let away = |view: &View| (view.time - middle).abs();
    views.sort_by(|a, b| away(a).total_cmp(&away(b)));
    let positions: Vec<glam::DVec3> = views
        .iter()
        .map(|view| view.camera.position().into())
        .collect();
    let spread = |positions: &[glam::DVec3]| {
        let n = positions.len().max(1) as f64;
        let centre = positions.iter().sum::<glam::DVec3>() / n;
        let squares = positions.iter().map(|p| p.distance_squared(centre));
        (squares.sum::<f64>() / n).sqrt()
    };
    let all = spread(&positions);
    if all <= NO_SPREAD * positions.iter().map(|p| p.length()).fold(1.0, f64::max) {
        return None;
    }
    let at_once = views.iter().filter(|view| view.time == middle).count();
    let needed = if at_once >= MIN_CAMERAS {
        at_once
    } else {
        MIN_VIEWS
    };
    let of_nearest = |n: usize| {
        let times = views[..n].iter().map(|view| view.time);
        Part {
            from: times.clone().fold(middle, f32::min),
            to: times.fold(middle, f32::max),
        }
    };
    (needed..=views.len())
        .map(|n| (n, of_nearest(n)))
        .take_while(|(_, part)| part.to - part.from <= MAX_START_PART * (last - first))
        .find(|&(n, _)| spread(&positions[..n]) >= MIN_SPREAD * all)
        .map(|(_, part)| part)
}

/// Whether every time by itself shows the scene's shape, as a rig's do.
pub(crate) fn shown_at_once(start_part: Option<Part>) -> bool {
    start_part.is_some_and(|part| !part.has_several_times())
}

/// Whether the first two stages start from a part of the clip and see more and more.
pub(crate) fn window_grows(trainer: &Trainer) -> bool {
    trainer.config.stages.window == TimeWindow::Growing
        && trainer.may_move()
        && trainer.start_part.is_some()
}

/// Whether a view at `time` teaches the Gaussians too, and not the coarse field alone: until the field
/// has followed what moves into a new frame, that frame would teach them to fade where they should be
/// moved.
pub(crate) fn teaches_gaussians(trainer: &Trainer, time: f32) -> bool {
    trainer.motion.is_none()
        || time_window(trainer, trainer.step).is_none_or(|(_, known)| known.holds(time))
}

/// The part of the clip that is trained on at `step`, and the part of that outside of which frames are new;
/// `None`: all of it.
pub(crate) fn time_window(trainer: &Trainer, step: usize) -> Option<(Part, Part)> {
    let first = trainer.start_part.filter(|_| window_grows(trainer))?;
    let stages = Stages::of(trainer);
    if step < stages.warmup {
        return Some((first, first));
    }
    let grown = share(stages.warmup, stages.settle, step) / GROWN;
    if grown >= 1.0 {
        return None;
    }
    let window = Part {
        from: first.from * (1.0 - grown),
        to: first.to + (1.0 - first.to) * grown,
    };
    let new = NEW_FRAMES / (trainer.dataset.n_frames - 1).max(1) as f32;
    let known = Part {
        from: (window.from + new).min(first.from),
        to: (window.to - new).max(first.to),
    };
    Some((window, known))
}

/// Gives every Gaussian the trajectory that the field has for it.
fn settle(trainer: &mut Trainer) -> Result<(), Error> {
    let Some(own) = coefficients(trainer)? else {
        return Ok(());
    };
    trainer.motion = None;
    trainer.found_places.clear();
    trainer.optimizer.forget("motion.");
    let mut rows = trainer.scene.static_set.to_rows();
    rows.trajectory_width = own.dims()[1];
    rows.trajectories = to_host(own);
    trainer.scene.static_set = Gaussians::from_rows(&rows, &trainer.device);
    trainer.optimizer.forget(&format!("{STATIC}trajectories"));
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use dash_kernels::Camera;

    use super::*;
    use crate::dataset::Layout;

    /// One training view at each place and time.
    fn part_of(views: impl Iterator<Item = ([f64; 3], f32)>) -> Option<Part> {
        let views: Vec<View> = views
            .map(|(eye, time)| {
                let camera = Camera::new(2.0, 2.0, 1.0, 1.0, 2, 2);
                let camera = camera.look_at(eye, [0.0; 3], [0.0, 1.0, 0.0]);
                View::from_rgb8("made", camera, time, vec![0; 12])
            })
            .collect();
        let all: Vec<usize> = (0..views.len()).collect();
        let dataset = Dataset {
            name: "made".into(),
            root: PathBuf::new(),
            layout: Layout::Blender,
            n_frames: 100,
            n_cameras: 1,
            stated_span: None,
            views,
            points: None,
            background: None,
        };
        start_part(&dataset, &all)
    }

    fn around(turn: f64) -> [f64; 3] {
        let angle = turn * std::f64::consts::TAU;
        [3.0 * angle.cos(), 1.0, 3.0 * angle.sin()]
    }

    #[test]
    fn the_start_part_is_in_the_middle_and_as_long_as_it_takes_to_see_the_shape() {
        let times = || (0..100).map(|k| k as f32 / 99.0);
        let part = |from: u32, to: u32| {
            let [from, to] = [from, to].map(|k| k as f32 / 99.0);
            Some(Part { from, to })
        };
        let rig = |n: u32| {
            times().flat_map(move |t| (0..n).map(move |c| (around(f64::from(c) / f64::from(n)), t)))
        };
        assert_eq!(part_of(rig(4)), part(50, 50));
        assert!(!part_of(rig(4)).is_some_and(Part::has_several_times));
        assert!(part_of(rig(2)).is_some_and(Part::has_several_times));
        // Too few to show a shape at once, but enough within a few times.
        assert_eq!(part_of(rig(2)), part(48, 51));
        let in_turns = times().zip((0..).map(|k| around(f64::from(k * 5 % 12) / 12.0)));
        assert_eq!(part_of(in_turns.map(|(t, eye)| (eye, t))), part(46, 53));
        let carried = times().map(|t| (around(0.5 * f64::from(t)), t));
        assert_eq!(part_of(carried), None);
        assert_eq!(part_of(times().map(|t| (around(0.3), t))), None);
        assert_eq!(part_of(std::iter::empty()), None);
    }
}
