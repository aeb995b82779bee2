//! How a capture shows the scene's shape: at every time, within a few times, or only along the whole clip.

use super::hold_out::hold_out;
use crate::dataset::{Dataset, View};

/// Cameras at one time that show the scene's shape.
const MIN_CAMERAS: usize = 4;
/// Views of several times that do, if these are not far apart.
const MIN_VIEWS: usize = 8;
/// Spread of their positions, as a share of that of all.
const MIN_SPREAD: f64 = 0.5;
/// Spread of cameras that stand in one place, as a share of where they are.
const NO_SPREAD: f64 = 1e-6;
/// Most of the clip that training may start from.
const MAX_START_SPAN: f32 = 0.1;

/// A span of the clip's time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeSpan {
    /// Its first time.
    pub(crate) from: f32,
    /// Its last.
    pub(crate) to: f32,
}

impl TimeSpan {
    /// Whether it holds a time.
    pub fn holds(self, time: f32) -> bool {
        (self.from..=self.to).contains(&time)
    }

    /// Whether it is one time only.
    pub fn is_one_time(self) -> bool {
        self.from == self.to
    }

    /// The time in its middle.
    pub fn middle(self) -> f32 {
        0.5 * (self.from + self.to)
    }
}

/// Whether every time by itself shows the scene's shape, as the synchronised cameras of a rig do.
pub(crate) fn is_synchronized(dataset: &Dataset) -> bool {
    let (train_views, _) = hold_out(dataset);
    start_span(dataset, &train_views).is_some_and(TimeSpan::is_one_time)
}

/// The shortest span around the clip's middle in which the training cameras see the scene from sides enough to make out
/// its shape: one time of a synchronised rig, a few of a monocular capture whose cameras alternate, none of one camera
/// that is carried along. What moves is followed both ways from there, half as far as from an end.
pub(crate) fn start_span(dataset: &Dataset, train_views: &[usize]) -> Option<TimeSpan> {
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
        TimeSpan {
            from: times.clone().fold(middle, f32::min),
            to: times.fold(middle, f32::max),
        }
    };
    (needed..=views.len())
        .map(|n| (n, of_nearest(n)))
        .take_while(|(_, part)| part.to - part.from <= MAX_START_SPAN * (last - first))
        .find(|&(n, _)| spread(&positions[..n]) >= MIN_SPREAD * all)
        .map(|(_, part)| part)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use dash_kernels::Camera;

    use super::*;
    use crate::dataset::Layout;

    /// One training view at each place and time.
    fn part_of(views: impl Iterator<Item = ([f64; 3], f32)>) -> Option<TimeSpan> {
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
            frame_rate: None,
            views,
            points: None,
            background: None,
        };
        start_span(&dataset, &all)
    }

    fn around(turn: f64) -> [f64; 3] {
        let angle = turn * std::f64::consts::TAU;
        [3.0 * angle.cos(), 1.0, 3.0 * angle.sin()]
    }

    #[test]
    fn the_start_span_is_in_the_middle_and_as_long_as_it_takes_to_see_the_shape() {
        let times = || (0..100).map(|k| k as f32 / 99.0);
        let part = |from: u32, to: u32| {
            let [from, to] = [from, to].map(|k| k as f32 / 99.0);
            Some(TimeSpan { from, to })
        };
        let rig = |n: u32| {
            times().flat_map(move |t| (0..n).map(move |c| (around(f64::from(c) / f64::from(n)), t)))
        };
        assert_eq!(part_of(rig(4)), part(50, 50));
        assert!(part_of(rig(4)).is_some_and(TimeSpan::is_one_time));
        assert!(part_of(rig(2)).is_some_and(|span| !span.is_one_time()));
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
