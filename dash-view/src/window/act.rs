//! Doing what a key or a button asks for.

use glam::DVec3;

use super::actions::Action;
use super::app::{App, CapturedView};
use crate::camera_path::{PathCamera, between};
use crate::worker::Task;

/// By what a key changes the field of view.
const WIDER: f64 = 1.1;
/// Cameras from one keyframe to the next: two seconds.
const SEGMENT: usize = 60;
/// Directions that may be up.
const UP_AXES: [(&str, DVec3); 6] = [
    ("-y", DVec3::NEG_Y),
    ("y", DVec3::Y),
    ("z", DVec3::Z),
    ("-z", DVec3::NEG_Z),
    ("x", DVec3::X),
    ("-x", DVec3::NEG_X),
];

impl App {
    /// Does what a key or a button asks for.
    pub fn act(&mut self, action: Action) {
        let playback = &mut self.playback;
        match action {
            Action::Play => playback.toggle(),
            Action::StepBack => playback.step(-1),
            Action::StepForward => playback.step(1),
            Action::Start => playback.seek(0.0),
            Action::End => {
                playback.playing = false;
                playback.seek(1.0);
            }
            Action::Loop => playback.looping = !playback.looping,
            Action::Slower => playback.change_speed(-1),
            Action::Faster => playback.change_speed(1),
            Action::Reset => {
                self.through = None;
                self.eye.reset();
            }
            Action::PreviousCamera => self.next_camera(-1),
            Action::NextCamera => self.next_camera(1),
            Action::UpAxis => self.next_up(),
            Action::Narrower => self.widen(WIDER.recip()),
            Action::Wider => self.widen(WIDER),
            Action::Layer(layer) => self.layer = layer,
            Action::Captured => {
                let all = CapturedView::ALL;
                let now = all.iter().position(|view| *view == self.captured);
                self.captured = all[(now.unwrap_or(0) + 1) % all.len()];
            }
            Action::Cameras => self.show_cameras = !self.show_cameras,
            Action::Background => {
                self.background = match self.background {
                    None => Some([0.0; 3]),
                    Some([0.0, ..]) => Some([1.0; 3]),
                    Some(_) => None,
                };
            }
            Action::DropTracks => self.picked.clear(),
            Action::Screenshot => {
                if let Some(shown) = &self.shown {
                    self.ask(Task::SavePicture(Box::new(shown.drawn.request.clone())));
                }
            }
            Action::AddKeyframe => self.add_keyframe(),
            Action::DropKeyframes => self.keyframes.clear(),
            Action::SavePath => self.with_path(Task::SavePath),
            Action::RenderPath => self.with_path(Task::RenderPath),
            Action::Panel => self.show_panel = !self.show_panel,
            Action::Help => self.show_help = !self.show_help,
        }
    }

    fn next_camera(&mut self, by: isize) {
        let n = self
            .opened
            .as_ref()
            .map_or(0, |opened| opened.cameras.len());
        if n == 0 {
            self.say("there are no cameras here", false);
            return;
        }
        let next = match self.through {
            Some(now) => (now + n).saturating_add_signed(by) % n,
            None => 0,
        };
        self.look_through(next);
    }

    /// Looks through one of the cameras, and at its time where it has only one.
    pub fn look_through(&mut self, index: usize) {
        let Some(opened) = &self.opened else {
            return;
        };
        let Some(entry) = opened.cameras.get(index) else {
            return;
        };
        self.eye
            .look_through(&entry.camera, DVec3::from(opened.focus));
        if let Some(time) = entry.time {
            self.playback.playing = false;
            self.playback.seek(f64::from(time));
        }
        self.through = Some(index);
    }

    fn next_up(&mut self) {
        let up = self.eye.up();
        let now = UP_AXES
            .iter()
            .position(|(_, axis)| axis.distance(up) < 1e-6);
        let (name, axis) = UP_AXES[now.map_or(0, |now| (now + 1) % UP_AXES.len())];
        self.through = None;
        self.eye.set_up(axis);
        self.say(&format!("{name} is up"), false);
    }

    fn widen(&mut self, factor: f64) {
        self.through = None;
        self.eye
            .set_field_of_view(self.eye.field_of_view() * factor);
    }

    fn add_keyframe(&mut self) {
        let keyframe = PathCamera {
            camera: self.camera(self.full),
            time: self.playback.time(),
        };
        self.keyframes.push(keyframe);
        let n = self.keyframes.len();
        self.say(&format!("keyframe {n} of the camera path"), false);
    }

    fn with_path(&mut self, task: impl FnOnce(Vec<PathCamera>) -> Task) {
        match self.keyframes.is_empty() {
            true => self.say("a camera path needs keyframes: K adds one", true),
            false => {
                let n_turns = (self.keyframes.len() - 1).max(1);
                self.ask(task(between(&self.keyframes, SEGMENT * n_turns + 1)));
            }
        }
    }
}
