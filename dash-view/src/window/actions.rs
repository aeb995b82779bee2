//! What can be done, and by which key.

use eframe::egui::{Event, InputState, Key};

use crate::draw::ViewLayer;

/// What can be done by a key or a button.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    Play,
    StepBack,
    StepForward,
    Start,
    End,
    Loop,
    Slower,
    Faster,
    Reset,
    PreviousCamera,
    NextCamera,
    UpAxis,
    Narrower,
    Wider,
    Layer(ViewLayer),
    Captured,
    Cameras,
    Background,
    DropTracks,
    Screenshot,
    AddKeyframe,
    DropKeyframes,
    SavePath,
    RenderPath,
    Panel,
    Help,
}

/// A key and what it does.
pub struct Binding {
    pub action: Action,
    pub key: Key,
    pub shift: bool,
    /// What it does, in one line.
    pub what: &'static str,
}

impl Binding {
    /// The key as the help names it.
    pub fn label(&self) -> String {
        let key = match self.key {
            Key::ArrowLeft => "Left",
            Key::ArrowRight => "Right",
            key => key.symbol_or_name(),
        };
        match self.shift {
            true => format!("Shift {key}"),
            false => key.to_string(),
        }
    }
}

const fn bind(action: Action, key: Key, what: &'static str) -> Binding {
    Binding {
        action,
        key,
        shift: false,
        what,
    }
}

const fn bind_shift(action: Action, key: Key, what: &'static str) -> Binding {
    Binding {
        shift: true,
        ..bind(action, key, what)
    }
}

/// Every key, in the order of the help.
pub const BINDINGS: &[Binding] = &[
    bind(Action::Play, Key::Space, "play or stop"),
    bind(Action::StepBack, Key::ArrowLeft, "one frame back"),
    bind(Action::StepForward, Key::ArrowRight, "one frame on"),
    bind(Action::Start, Key::Home, "to the start"),
    bind(Action::End, Key::End, "to the end"),
    bind(Action::Loop, Key::L, "loop, or stop at the end"),
    bind(Action::Slower, Key::Comma, "slower"),
    bind(Action::Faster, Key::Period, "faster"),
    bind(Action::Reset, Key::R, "the eye returns to where it began"),
    bind(
        Action::PreviousCamera,
        Key::OpenBracket,
        "look through the previous camera",
    ),
    bind(
        Action::NextCamera,
        Key::CloseBracket,
        "look through the next camera",
    ),
    bind(Action::UpAxis, Key::U, "another axis is up"),
    bind(Action::Narrower, Key::Minus, "narrower field of view"),
    bind(Action::Wider, Key::Plus, "wider field of view"),
    bind(Action::Layer(ViewLayer::Full), Key::Num1, "the whole scene"),
    bind(
        Action::Layer(ViewLayer::Static),
        Key::Num2,
        "static Gaussians",
    ),
    bind(
        Action::Layer(ViewLayer::Dynamic),
        Key::Num3,
        "dynamic Gaussians",
    ),
    bind(Action::Layer(ViewLayer::Depth), Key::Num4, "depth"),
    bind(Action::Layer(ViewLayer::Alpha), Key::Num5, "opacity"),
    bind(Action::Layer(ViewLayer::Speed), Key::Num6, "speed"),
    bind(
        Action::Layer(ViewLayer::Ellipsoids),
        Key::Num7,
        "Gaussians as ellipsoids",
    ),
    bind(
        Action::Captured,
        Key::M,
        "the captured picture: none, beside, across a slider, the difference",
    ),
    bind(Action::Cameras, Key::C, "show the cameras, or hide them"),
    bind(
        Action::Background,
        Key::B,
        "background: the scene's, black, white",
    ),
    bind(
        Action::DropTracks,
        Key::Escape,
        "forget the picked Gaussians",
    ),
    bind(Action::Screenshot, Key::P, "save the picture"),
    bind(
        Action::AddKeyframe,
        Key::K,
        "add a keyframe to the camera path",
    ),
    bind_shift(Action::DropKeyframes, Key::K, "forget the camera path"),
    bind_shift(Action::SavePath, Key::P, "save the camera path"),
    bind_shift(
        Action::RenderPath,
        Key::V,
        "render the camera path as a video",
    ),
    bind(Action::Panel, Key::Tab, "show the side panel, or hide it"),
    bind(Action::Help, Key::Questionmark, "this page"),
];

/// What the hand does on the picture.
pub const GESTURES: &[(&str, &str)] = &[
    ("drag", "orbit"),
    ("Shift drag, right drag", "pan"),
    ("Ctrl drag", "look around"),
    ("wheel", "nearer, farther"),
    (
        "W S A D, Q E",
        "fly ahead, back, left, right, down, up; with Shift faster",
    ),
    ("click", "pick a dynamic Gaussian: its way is drawn"),
    ("drop a file", "open it"),
];

/// The binding of an action.
pub fn binding(action: Action) -> Option<&'static Binding> {
    BINDINGS.iter().find(|binding| binding.action == action)
}

/// What the keys that were pressed ask for, in their order.
pub fn pressed(input: &InputState) -> Vec<Action> {
    let asked = |event: &Event| match event {
        Event::Key {
            key,
            pressed: true,
            modifiers,
            ..
        } if !(modifiers.ctrl || modifiers.alt || modifiers.command) => {
            // On most keyboards a question mark and a plus need Shift.
            let any_shift = matches!(key, Key::Questionmark | Key::Plus);
            let mut bindings = BINDINGS.iter();
            let binding =
                bindings.find(|b| b.key == *key && (any_shift || b.shift == modifiers.shift));
            binding.map(|binding| binding.action)
        }
        _ => None,
    };
    input.events.iter().filter_map(asked).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_key_does_two_things_and_each_layer_has_one() {
        let mut keys: Vec<_> = BINDINGS.iter().map(|b| (b.key, b.shift)).collect();
        keys.sort();
        keys.dedup();
        assert_eq!(keys.len(), BINDINGS.len());
        for layer in ViewLayer::ALL {
            assert!(binding(Action::Layer(layer)).is_some(), "{layer}");
        }
        // The keys of flight are held, not pressed.
        for key in [Key::W, Key::A, Key::S, Key::D, Key::Q, Key::E] {
            assert!(BINDINGS.iter().all(|b| b.key != key), "{key:?}");
        }
    }
}
