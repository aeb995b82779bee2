//! The scenes: the room and its moving objects; `furniture` and `day` hold the rest.

use super::SceneKind;
use super::color::rgb;
use super::motion::{Drift, Motion};
use super::pose::Pose;
use super::rig::focal_px;
use super::scene::{Look, Object, ROOM_BACK_M, ROOM_HALF_WIDTH_M, Role, Scene};
use super::shape::Shape;
use super::texture::{Pattern, Texture};
use glam::{DVec2, DVec3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// Share of a picture that the small object of [`SceneKind::Tiny`] covers at its nearest.
const TINY_SHARE: f64 = 0.0033;
/// Least distance between the small object's path and a camera, in metres.
const TINY_NEAREST_M: f64 = 3.3;
/// Angle of the box's turn over the clip.
pub const BOX_TURN_RADIANS: f64 = 2.6;
const BALL_RADIUS_M: f64 = 0.26;
const BOX_HALF_M: f64 = 0.25;
const TABLE_TOP_M: f64 = 0.62;

impl Scene {
    /// Builds a scene for pictures of `width` by `height` pixels by the cameras of [`super::rig()`].
    ///
    /// The size matters for [`SceneKind::Tiny`] alone: its small object is scaled to the share of
    /// the picture that it may cover.
    pub fn new(kind: SceneKind, seed: u64, width: usize, height: usize) -> Self {
        let mut builder = Builder {
            rng: Pcg64::seed_from_u64(seed),
            flow: kind == SceneKind::Flow,
            objects: Vec::new(),
            group: Motion::Still,
            next_seed: (seed as u32).wrapping_mul(1000),
        };
        builder.walls();
        builder.decoration();
        builder.clutter();
        builder.table_and_movers(kind);
        if kind == SceneKind::Tiny {
            let area_px = TINY_SHARE * (width * height) as f64;
            let radius_px = (area_px / std::f64::consts::PI).sqrt();
            let radius = TINY_NEAREST_M * radius_px / focal_px(width, height);
            builder.add(
                "tiny",
                Shape::Sphere { radius },
                Pattern::Plain,
                &[0xc2188f],
                DVec3::new(0.0, 1.45, 0.35),
                0.0,
                Role::Free,
            );
            builder.last().motion = Motion::Dart {
                // It leaves its own outline within two frames of the default clip.
                reach: DVec3::new(0.5, 0.2, 0.15),
            };
        }
        let lamp = (kind == SceneKind::Day).then(|| builder.day());
        let sway = if builder.flow {
            Motion::Drift(Drift {
                pivot: DVec3::new(0.0, 0.8, -0.4),
                reach: DVec3::new(0.10, 0.05, 0.08),
                turn_radians: 0.05,
                phase: 0.1,
            })
        } else {
            Motion::Still
        };
        Self {
            objects: builder.objects,
            sway,
            lamp,
        }
    }
}

/// Collects a scene's objects; every colour and place varies a little with the seed.
pub(super) struct Builder {
    rng: Pcg64,
    flow: bool,
    objects: Vec<Object>,
    /// The motion of what is added next.
    group: Motion,
    next_seed: u32,
}

impl Builder {
    /// Adds an object that moves as the current group does.
    #[expect(
        clippy::too_many_arguments,
        reason = "one call is one line of the furniture list below"
    )]
    pub(super) fn add(
        &mut self,
        name: &str,
        shape: Shape,
        pattern: Pattern,
        colors: &[u32],
        position: DVec3,
        yaw_radians: f64,
        role: Role,
    ) {
        let colors = colors
            .iter()
            .map(|&hex| {
                let tint = DVec3::from_array([(); 3].map(|()| self.rng.random_range(0.9..1.1)));
                (rgb(hex) * tint).clamp(DVec3::ZERO, DVec3::splat(0.82))
            })
            .collect();
        self.next_seed = self.next_seed.wrapping_add(1);
        self.objects.push(Object {
            name: name.to_owned(),
            shape,
            texture: Texture {
                pattern,
                colors,
                mottle: if matches!(pattern, Pattern::Marble { .. }) {
                    0.04
                } else {
                    0.10
                },
                seed: self.next_seed,
            },
            base: Pose::new(position, yaw_radians),
            motion: self.group,
            role,
            look: Look::Matte,
        });
    }

    pub(super) fn last(&mut self) -> &mut Object {
        self.objects.last_mut().expect("called right after `add`")
    }

    /// Starts a group with its own swing (in `flow`) about `place`, within `reach` metres.
    pub(super) fn group(&mut self, place: DVec2, reach: DVec3) {
        let phase = self.rng.random_range(0.0..1.0);
        let turn_radians = self.rng.random_range(0.15..0.4);
        if self.flow {
            self.group = Motion::Drift(Drift {
                pivot: DVec3::new(place.x, 0.0, place.y),
                reach,
                // Things on the wall slide along it.
                turn_radians: if reach.z > 0.0 { turn_radians } else { 0.0 },
                phase,
            });
        }
    }

    /// A place on the floor near (x, z), a little different for each seed.
    pub(super) fn spot(&mut self, x: f64, z: f64) -> DVec2 {
        let mut jitter = || self.rng.random_range(-0.05..0.05);
        DVec2::new(x + jitter(), z + jitter())
    }

    fn walls(&mut self) {
        let thick = 0.05;
        let wide = ROOM_HALF_WIDTH_M;
        // Side walls that came further would stand in the outer cameras' way when the room sways.
        let (front, top) = (1.2, 3.2);
        let depth = 0.5 * (front - ROOM_BACK_M);
        let middle = 0.5 * (front + ROOM_BACK_M);
        // Further out than the walls, where it fills the lower corners of the pictures.
        let (floor_half, floor_front) = (wide + 0.5, 2.2);
        let slab = |x, y, z| Shape::Box {
            half: DVec3::new(x, y, z),
        };
        self.add(
            "floor",
            slab(floor_half, thick, 0.5 * (floor_front - ROOM_BACK_M)),
            Pattern::Planks {
                width: 0.30,
                length: 1.3,
            },
            &[0xb98552, 0xa06f42, 0xc9976a, 0x93633a],
            DVec3::new(0.0, -thick, 0.5 * (floor_front + ROOM_BACK_M)),
            0.0,
            Role::Room,
        );
        self.add(
            "back wall",
            slab(wide, 0.5 * top, thick),
            Pattern::Diamonds {
                width: 0.44,
                height: 0.62,
            },
            &[0x86b4b1, 0xc6dcd5],
            DVec3::new(0.0, 0.5 * top, ROOM_BACK_M - thick),
            0.0,
            Role::Room,
        );
        self.add(
            "left wall",
            slab(thick, 0.5 * top, depth),
            Pattern::Bricks {
                width: 0.72,
                height: 0.34,
            },
            &[0xb5573c, 0xcf7a55, 0xe3d5c3],
            DVec3::new(-wide - thick, 0.5 * top, middle),
            0.0,
            Role::Room,
        );
        self.add(
            "right wall",
            slab(thick, 0.5 * top, depth),
            Pattern::Stripes {
                axis: 2,
                period: 0.8,
            },
            &[0xe9c46a, 0xf3e3b5],
            DVec3::new(wide + thick, 0.5 * top, middle),
            0.0,
            Role::Room,
        );
        let board = 0.07;
        for (name, shape, x, z) in [
            (
                "back skirting",
                slab(wide, board, 0.02),
                0.0,
                ROOM_BACK_M + 0.02,
            ),
            (
                "left skirting",
                slab(0.02, board, depth),
                -wide + 0.02,
                middle,
            ),
            (
                "right skirting",
                slab(0.02, board, depth),
                wide - 0.02,
                middle,
            ),
        ] {
            self.add(
                name,
                shape,
                Pattern::Plain,
                &[0xf2eee4],
                DVec3::new(x, board, z),
                0.0,
                Role::Room,
            );
        }
    }

    fn table_and_movers(&mut self, kind: SceneKind) {
        let place = DVec2::new(0.88, -0.62);
        self.group(place, DVec3::new(0.08, 0.0, 0.08));
        let at = |y: f64| DVec3::new(place.x, y, place.y);
        for (name, radius, low, high, color, role) in [
            ("table foot", 0.30, 0.0, 0.05, 0x54382a, Role::Standing),
            (
                "table leg",
                0.08,
                0.05,
                TABLE_TOP_M - 0.06,
                0x6b4a35,
                Role::Free,
            ),
            (
                "table top",
                0.56,
                TABLE_TOP_M - 0.06,
                TABLE_TOP_M,
                0xe6d3b3,
                Role::Free,
            ),
        ] {
            self.add(
                name,
                Shape::Cylinder {
                    radius,
                    half_height: 0.5 * (high - low),
                },
                Pattern::Plain,
                &[color],
                at(0.5 * (low + high)),
                0.0,
                role,
            );
        }
        self.add(
            "turning box",
            Shape::Box {
                half: DVec3::splat(BOX_HALF_M),
            },
            Pattern::Faces { half: BOX_HALF_M },
            &[
                0x277da1, 0xf3722c, 0xf9c74f, 0x43aa8b, 0xd1495b, 0x8e6bbf, 0xfdf6ec,
            ],
            at(TABLE_TOP_M + BOX_HALF_M),
            0.35,
            Role::Free,
        );
        let moves = matches!(kind, SceneKind::Bounce | SceneKind::Flow);
        if moves {
            self.last().motion = Motion::Turn {
                radians: BOX_TURN_RADIANS,
            };
        }
        self.add(
            "ball",
            Shape::Sphere {
                radius: BALL_RADIUS_M,
            },
            Pattern::BeachBall {
                radius: BALL_RADIUS_M,
            },
            &[
                0xe63946, 0xf3ece0, 0x1d6fb8, 0xf3ece0, 0x2a9d6f, 0xf3ece0, 0xf6bd2b,
            ],
            DVec3::ZERO,
            0.0,
            Role::Free,
        );
        let bounce = Motion::Bounce {
            radius: BALL_RADIUS_M,
        };
        let ball = self.last();
        if moves {
            ball.motion = bounce;
        } else {
            // At rest it lies on the floor.
            ball.base = bounce.pose(&ball.base, 1.0);
            ball.motion = Motion::Still;
            if kind == SceneKind::Day {
                // Out of the people's way.
                ball.base.position = DVec3::new(-1.3, BALL_RADIUS_M, 0.75);
            }
        }
    }
}
