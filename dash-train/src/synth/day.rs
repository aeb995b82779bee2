//! The scene `day`: what a long clip of people has, and a canonical scene with motion has not. People enter, carry something
//! in, put it down and leave; another takes it away. A cabinet's door opens and closes, a lamp is switched on, a screen
//! flickers; a mirror and a pane of glass show what moves elsewhere.

use super::motion::Motion;
use super::people::{ARM_M, Carried, LEG_M, Limb, Walk};
use super::room::Builder;
use super::scene::{Lamp, Look, ROOM_BACK_M, ROOM_HALF_WIDTH_M, Role};
use super::shape::Shape;
use super::texture::Pattern;
use glam::DVec3;

/// When the lamp is switched on.
const LAMP_ON: f64 = 0.4;

/// Brings the parcel from the right and leaves to the left.
static BRINGS: Walk = Walk {
    keys: &[
        (0.02, [2.9, 1.45]),
        (0.11, [1.25, 1.25]),
        (0.17, [0.45, 0.95]),
        (0.25, [0.45, 0.95]),
        (0.34, [-0.6, 1.05]),
        (0.48, [-2.9, 1.45]),
    ],
    carries: [0.0, 0.21],
};

/// Comes from the left and takes it to the right.
static TAKES: Walk = Walk {
    keys: &[
        (0.52, [-2.9, 1.45]),
        (0.64, [-0.8, 1.1]),
        (0.70, [-0.25, 0.85]),
        (0.78, [-0.25, 0.85]),
        (0.86, [1.2, 1.25]),
        (0.96, [2.9, 1.45]),
    ],
    carries: [0.74, 1.0],
};

static PARCEL: Carried = Carried {
    by: [&BRINGS, &TAKES],
    place: [0.12, 0.15, 0.85],
};

impl Builder {
    /// Adds everything, and gives the lamp.
    pub(super) fn day(&mut self) -> Lamp {
        self.person("first", &BRINGS, [0x3566a8, 0x2b2f3a, 0xd9a07a]);
        self.person("second", &TAKES, [0xb8432f, 0x4a4238, 0x8a5a3c]);
        self.add(
            "carried parcel",
            Shape::Box {
                half: DVec3::new(0.20, 0.15, 0.15),
            },
            Pattern::Stripes {
                axis: 0,
                period: 0.36,
            },
            &[0xc99a5b, 0xe8d9b8],
            DVec3::ZERO,
            0.0,
            Role::Free,
        );
        self.last().motion = Motion::Carried(&PARCEL);
        self.cabinet();
        self.looks();
        let lamp = DVec3::new(-0.25, 1.68, -0.55);
        self.add(
            "lamp cord",
            Shape::Cylinder {
                radius: 0.012,
                half_height: 0.7,
            },
            Pattern::Plain,
            &[0x2f2f2f],
            lamp + DVec3::new(0.0, 0.8, 0.0),
            0.0,
            Role::Free,
        );
        self.add(
            "lamp",
            Shape::Sphere { radius: 0.12 },
            Pattern::Plain,
            &[0xfff0c8],
            lamp,
            0.0,
            Role::Free,
        );
        self.last().look = Look::Lamp;
        Lamp {
            position: lamp,
            on: LAMP_ON,
        }
    }

    /// A person: shirt, trousers and skin.
    fn person(&mut self, name: &str, walk: &'static Walk, [shirt, trousers, skin]: [u32; 3]) {
        let limb = |radius: f64, length: f64| Shape::Cylinder {
            radius,
            half_height: 0.5 * length,
        };
        let torso = Shape::Box {
            half: DVec3::new(0.19, 0.27, 0.11),
        };
        let striped = Pattern::Stripes {
            axis: 1,
            period: 0.32,
        };
        let mut parts = vec![
            ("torso", torso, striped, [shirt, 0xe9e4d8], Limb::Torso),
            (
                "head",
                Shape::Sphere { radius: 0.13 },
                Pattern::Plain,
                [skin; 2],
                Limb::Head,
            ),
        ];
        for side in [-1.0, 1.0] {
            let plain = Pattern::Plain;
            parts.extend([
                (
                    "thigh",
                    limb(0.085, LEG_M),
                    plain,
                    [trousers; 2],
                    Limb::Thigh(side),
                ),
                (
                    "shin",
                    limb(0.065, LEG_M),
                    plain,
                    [trousers; 2],
                    Limb::Shin(side),
                ),
                (
                    "upper arm",
                    limb(0.055, ARM_M),
                    plain,
                    [shirt; 2],
                    Limb::UpperArm(side),
                ),
                (
                    "forearm",
                    limb(0.045, ARM_M),
                    plain,
                    [skin; 2],
                    Limb::Forearm(side),
                ),
            ]);
        }
        for (part, shape, pattern, colors, of) in parts {
            let side = match of {
                Limb::Torso | Limb::Head => "",
                Limb::Thigh(side)
                | Limb::Shin(side)
                | Limb::UpperArm(side)
                | Limb::Forearm(side) => {
                    if side < 0.0 {
                        " left"
                    } else {
                        " right"
                    }
                }
            };
            let name = format!("{name}'s{side} {part}");
            self.add(&name, shape, pattern, &colors, DVec3::ZERO, 0.0, Role::Free);
            self.last().motion = Motion::Walk(walk, of);
        }
    }

    /// A cabinet whose door opens and closes.
    fn cabinet(&mut self) {
        let half = DVec3::new(0.26, 0.36, 0.20);
        let place = DVec3::new(1.15, half.y, 0.45);
        self.add(
            "cabinet",
            Shape::Box { half },
            Pattern::Checker { side: 0.18 },
            &[0x6c8f4e, 0xd7e3c0],
            place,
            0.0,
            Role::Standing,
        );
        let panel = DVec3::new(half.x, half.y, 0.012);
        self.add(
            "cabinet door",
            Shape::Box { half: panel },
            Pattern::Plain,
            &[0x9c6b3f],
            // The hinge.
            place + DVec3::new(half.x, 0.0, half.z + 0.02),
            0.0,
            Role::Free,
        );
        self.last().motion = Motion::Hinge {
            middle: DVec3::new(-half.x, 0.0, 0.0),
            radians: 1.7,
            opens: [0.28, 0.33],
            closes: [0.60, 0.66],
        };
    }

    /// A screen, a mirror and a pane of glass.
    fn looks(&mut self) {
        for (name, half, place, color, look) in [
            (
                "screen",
                DVec3::new(0.26, 0.17, 0.02),
                DVec3::new(0.42, 1.36, ROOM_BACK_M + 0.02),
                0xf0f0f0,
                Look::Screen,
            ),
            (
                "mirror",
                DVec3::new(0.02, 0.42, 0.36),
                DVec3::new(-ROOM_HALF_WIDTH_M + 0.02, 1.15, 0.35),
                0xf4f6f8,
                Look::Mirror,
            ),
            (
                "pane",
                DVec3::new(0.30, 0.42, 0.008),
                DVec3::new(-0.95, 0.42, 0.45),
                0xbfe3d2,
                Look::Glass,
            ),
        ] {
            let shape = Shape::Box { half };
            self.add(
                name,
                shape,
                Pattern::Plain,
                &[color],
                place,
                0.0,
                Role::Free,
            );
            self.last().look = look;
        }
    }
}
