//! The room, its clutter and what moves in it.

use super::SceneKind;
use super::rig::focal_px;
use super::motion::{Drift, Motion, Pose};
use super::scene::{Object, ROOM_BACK_M, ROOM_HALF_WIDTH_M, Role, Scene};
use super::shape::Shape;
use super::texture::{Pattern, Texture, rgb};
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
    /// Builds a scene for pictures of `width` by `height` pixels by the cameras of [`super::rig`].
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
                &[0xff3b30],
                DVec3::new(0.0, 1.45, 0.35),
                0.0,
                Role::Free,
            );
            builder.last().motion = Motion::Dart {
                // It leaves its own outline within two frames of the default clip.
                reach: DVec3::new(0.5, 0.2, 0.15),
            };
        }
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
        }
    }
}

struct Builder {
    rng: Pcg64,
    flow: bool,
    objects: Vec<Object>,
    /// The motion of what is added next.
    group: Motion,
    next_seed: u32,
}

impl Builder {
    #[expect(
        clippy::too_many_arguments,
        reason = "one call is one line of the furniture list below"
    )]
    fn add(
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
                mottle: if matches!(pattern, Pattern::Marble { .. }) { 0.04 } else { 0.10 },
                seed: self.next_seed,
            },
            base: Pose::new(position, yaw_radians),
            motion: self.group,
            role,
        });
    }

    fn last(&mut self) -> &mut Object {
        self.objects.last_mut().expect("called right after `add`")
    }

    /// Starts a group with its own swing (in `flow`) about `place`, within `reach` metres.
    fn group(&mut self, place: DVec2, reach: DVec3) {
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
    fn spot(&mut self, x: f64, z: f64) -> DVec2 {
        let mut jitter = || self.rng.random_range(-0.05..0.05);
        DVec2::new(x + jitter(), z + jitter())
    }

    fn walls(&mut self) {
        let thick = 0.05;
        let (front, top) = (1.7, 3.2);
        let depth = 0.5 * (front - ROOM_BACK_M);
        let middle = 0.5 * (front + ROOM_BACK_M);
        let wide = ROOM_HALF_WIDTH_M;
        let slab = |x, y, z| Shape::Box {
            half: DVec3::new(x, y, z),
        };
        self.add(
            "floor",
            slab(wide, thick, depth),
            Pattern::Planks { width: 0.30, length: 1.3 },
            &[0xb98552, 0xa06f42, 0xc9976a, 0x93633a],
            DVec3::new(0.0, -thick, middle),
            0.0,
            Role::Room,
        );
        self.add(
            "back wall",
            slab(wide, 0.5 * top, thick),
            Pattern::Diamonds { width: 0.44, height: 0.62 },
            &[0x86b4b1, 0xc6dcd5],
            DVec3::new(0.0, 0.5 * top, ROOM_BACK_M - thick),
            0.0,
            Role::Room,
        );
        self.add(
            "left wall",
            slab(thick, 0.5 * top, depth),
            Pattern::Bricks { width: 0.72, height: 0.34 },
            &[0xb5573c, 0xcf7a55, 0xe3d5c3],
            DVec3::new(-wide - thick, 0.5 * top, middle),
            0.0,
            Role::Room,
        );
        self.add(
            "right wall",
            slab(thick, 0.5 * top, depth),
            Pattern::Stripes { axis: 2, period: 0.8 },
            &[0xe9c46a, 0xf3e3b5],
            DVec3::new(wide + thick, 0.5 * top, middle),
            0.0,
            Role::Room,
        );
        let board = 0.07;
        for (name, shape, x, z) in [
            ("back skirting", slab(wide, board, 0.02), 0.0, ROOM_BACK_M + 0.02),
            ("left skirting", slab(0.02, board, depth), -wide + 0.02, middle),
            ("right skirting", slab(0.02, board, depth), wide - 0.02, middle),
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

    fn decoration(&mut self) {
        let on_wall = DVec3::new(0.12, 0.06, 0.0);
        let z = ROOM_BACK_M;
        self.group(DVec2::new(0.0, z), DVec3::new(0.1, 0.0, 0.1));
        self.add(
            "rug",
            Shape::Cylinder { radius: 0.99, half_height: 0.008 },
            Pattern::Rings { width: 0.18 },
            &[0xe9d8bd, 0x2f8f86, 0xe9d8bd, 0xd9694d],
            DVec3::new(0.0, 0.008, 0.35),
            0.0,
            Role::Room,
        );
        self.group(DVec2::new(-0.55, z), on_wall);
        self.add(
            "picture frame",
            Shape::Box { half: DVec3::new(0.70, 0.50, 0.025) },
            Pattern::Plain,
            &[0x5b3a24],
            DVec3::new(-0.55, 1.72, z + 0.025),
            0.0,
            Role::Free,
        );
        self.add(
            "picture",
            Shape::Box { half: DVec3::new(0.62, 0.42, 0.03) },
            Pattern::Sunset { half_width: 0.62, half_height: 0.42 },
            &[0xffffff],
            DVec3::new(-0.55, 1.72, z + 0.03),
            0.0,
            Role::Free,
        );
        self.group(DVec2::new(1.3, z), on_wall);
        self.add(
            "shelf",
            Shape::Box { half: DVec3::new(0.6, 0.035, 0.17) },
            Pattern::Plain,
            &[0x7a5230],
            DVec3::new(1.3, 1.5, z + 0.17),
            0.0,
            Role::Free,
        );
        self.add(
            "vase",
            Shape::Cylinder { radius: 0.13, half_height: 0.21 },
            Pattern::Stripes { axis: 1, period: 0.32 },
            &[0x3d5a98, 0xe8ecf5],
            DVec3::new(0.95, 1.745, z + 0.17),
            0.0,
            Role::Free,
        );
        self.add(
            "shelf ball",
            Shape::Sphere { radius: 0.15 },
            Pattern::Marble { period: 0.36 },
            &[0xd1495b, 0xf7c59f],
            DVec3::new(1.34, 1.685, z + 0.17),
            0.0,
            Role::Free,
        );
        self.add(
            "shelf cone",
            Shape::Cone { radius: 0.13, half_height: 0.19 },
            Pattern::Plain,
            &[0x66a182],
            DVec3::new(1.70, 1.725, z + 0.17),
            0.0,
            Role::Free,
        );
    }

    fn clutter(&mut self) {
        let reach = DVec3::new(0.10, 0.0, 0.10);
        let at = |spot: DVec2, y: f64| DVec3::new(spot.x, y, spot.y);

        let spot = self.spot(-1.72, -1.0);
        self.group(spot, reach);
        self.add(
            "column",
            Shape::Cylinder { radius: 0.2, half_height: 0.55 },
            Pattern::Spiral { period: 0.42 },
            &[0xd62839, 0xf6f1e7],
            at(spot, 0.55),
            0.0,
            Role::Standing,
        );
        self.add(
            "globe",
            Shape::Sphere { radius: 0.24 },
            Pattern::Marble { period: 0.40 },
            &[0x2b6cb0, 0x9ad0c2],
            at(spot, 1.34),
            0.0,
            Role::Free,
        );

        let spot = self.spot(-0.98, -0.85);
        self.group(spot, reach);
        self.add(
            "marble",
            Shape::Sphere { radius: 0.40 },
            Pattern::Marble { period: 0.46 },
            &[0xede6da, 0x6d8f71],
            at(spot, 0.40),
            0.5,
            Role::Standing,
        );

        let spot = self.spot(-0.12, -0.95);
        self.group(spot, reach);
        self.add(
            "cone",
            Shape::Cone { radius: 0.34, half_height: 0.48 },
            Pattern::Stripes { axis: 1, period: 0.44 },
            &[0xf08a24, 0xfff4e0],
            at(spot, 0.48),
            0.0,
            Role::Standing,
        );

        let spot = self.spot(-1.52, -0.05);
        self.group(spot, reach);
        self.add(
            "crate",
            Shape::Box { half: DVec3::new(0.28, 0.24, 0.28) },
            Pattern::Checker { side: 0.28 },
            &[0x4a7c59, 0xdfe8c8],
            at(spot, 0.24),
            0.5,
            Role::Standing,
        );
        self.add(
            "crate ball",
            Shape::Sphere { radius: 0.19 },
            Pattern::Stripes { axis: 1, period: 0.34 },
            &[0xffc857, 0xe9724c],
            at(spot, 0.67),
            0.0,
            Role::Free,
        );

        let spot = self.spot(1.62, 0.02);
        self.group(spot, reach);
        self.add(
            "stool",
            Shape::Cylinder { radius: 0.25, half_height: 0.22 },
            Pattern::Spiral { period: 0.50 },
            &[0x6a4c93, 0xc9b6e4],
            at(spot, 0.22),
            0.0,
            Role::Standing,
        );
        self.add(
            "parcel",
            Shape::Box { half: DVec3::new(0.17, 0.14, 0.15) },
            Pattern::Plain,
            &[0xf28482],
            at(spot, 0.58),
            0.7,
            Role::Free,
        );

        let spot = self.spot(-0.35, -0.12);
        self.group(spot, reach);
        self.add(
            "orange",
            Shape::Sphere { radius: 0.20 },
            Pattern::Marble { period: 0.36 },
            &[0xf9844a, 0xf9c74f],
            at(spot, 0.20),
            0.0,
            Role::Standing,
        );
    }

    fn table_and_movers(&mut self, kind: SceneKind) {
        let place = DVec2::new(0.88, -0.62);
        self.group(place, DVec3::new(0.08, 0.0, 0.08));
        let at = |y: f64| DVec3::new(place.x, y, place.y);
        for (name, radius, low, high, color, role) in [
            ("table foot", 0.30, 0.0, 0.05, 0x54382a, Role::Standing),
            ("table leg", 0.08, 0.05, TABLE_TOP_M - 0.06, 0x6b4a35, Role::Free),
            ("table top", 0.56, TABLE_TOP_M - 0.06, TABLE_TOP_M, 0xe6d3b3, Role::Free),
        ] {
            self.add(
                name,
                Shape::Cylinder { radius, half_height: 0.5 * (high - low) },
                Pattern::Plain,
                &[color],
                at(0.5 * (low + high)),
                0.0,
                role,
            );
        }
        self.add(
            "turning box",
            Shape::Box { half: DVec3::splat(BOX_HALF_M) },
            Pattern::Faces { half: BOX_HALF_M },
            &[0x277da1, 0xf3722c, 0xf9c74f, 0x43aa8b, 0xd1495b, 0x8e6bbf, 0xfdf6ec],
            at(TABLE_TOP_M + BOX_HALF_M),
            0.35,
            Role::Free,
        );
        let moves = matches!(kind, SceneKind::Bounce | SceneKind::Flow);
        if moves {
            self.last().motion = Motion::Turn { radians: BOX_TURN_RADIANS };
        }
        self.add(
            "ball",
            Shape::Sphere { radius: BALL_RADIUS_M },
            Pattern::BeachBall { radius: BALL_RADIUS_M },
            &[0xe63946, 0xf3ece0, 0x1d6fb8, 0xf3ece0, 0x2a9d6f, 0xf3ece0, 0xf6bd2b],
            DVec3::ZERO,
            0.0,
            Role::Free,
        );
        let bounce = Motion::Bounce { radius: BALL_RADIUS_M };
        let ball = self.last();
        if moves {
            ball.motion = bounce;
        } else {
            // At rest it lies on the floor.
            ball.base = bounce.pose(&ball.base, 1.0);
            ball.motion = Motion::Still;
        }
    }
}
