//! Furniture and decoration, which move in the scene `flow` alone.

use super::room::Builder;
use super::scene::{ROOM_BACK_M, Role};
use super::shape::Shape;
use super::texture::Pattern;
use glam::{DVec2, DVec3};

impl Builder {
    /// Rug, picture and shelf.
    pub(super) fn decoration(&mut self) {
        let on_wall = DVec3::new(0.12, 0.06, 0.0);
        let z = ROOM_BACK_M;
        self.group(DVec2::new(0.0, z), DVec3::new(0.1, 0.0, 0.1));
        self.add(
            "rug",
            Shape::Cylinder {
                radius: 0.99,
                half_height: 0.008,
            },
            Pattern::Rings { width: 0.18 },
            &[0xe9d8bd, 0x2f8f86, 0xe9d8bd, 0xd9694d],
            DVec3::new(0.0, 0.008, 0.35),
            0.0,
            Role::Room,
        );
        self.group(DVec2::new(-0.55, z), on_wall);
        self.add(
            "picture frame",
            Shape::Box {
                half: DVec3::new(0.70, 0.50, 0.025),
            },
            Pattern::Plain,
            &[0x5b3a24],
            DVec3::new(-0.55, 1.72, z + 0.025),
            0.0,
            Role::Free,
        );
        self.add(
            "picture",
            Shape::Box {
                half: DVec3::new(0.62, 0.42, 0.03),
            },
            Pattern::Sunset {
                half_width: 0.62,
                half_height: 0.42,
            },
            &[0xffffff],
            DVec3::new(-0.55, 1.72, z + 0.03),
            0.0,
            Role::Free,
        );
        self.group(DVec2::new(1.3, z), on_wall);
        self.add(
            "shelf",
            Shape::Box {
                half: DVec3::new(0.6, 0.035, 0.17),
            },
            Pattern::Plain,
            &[0x7a5230],
            DVec3::new(1.3, 1.5, z + 0.17),
            0.0,
            Role::Free,
        );
        self.add(
            "vase",
            Shape::Cylinder {
                radius: 0.13,
                half_height: 0.21,
            },
            Pattern::Stripes {
                axis: 1,
                period: 0.32,
            },
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
            Shape::Cone {
                radius: 0.13,
                half_height: 0.19,
            },
            Pattern::Plain,
            &[0x66a182],
            DVec3::new(1.70, 1.725, z + 0.17),
            0.0,
            Role::Free,
        );
    }

    /// What stands about on the floor.
    pub(super) fn clutter(&mut self) {
        let reach = DVec3::new(0.10, 0.0, 0.10);
        let at = |spot: DVec2, y: f64| DVec3::new(spot.x, y, spot.y);

        let spot = self.spot(-1.72, -1.0);
        self.group(spot, reach);
        self.add(
            "column",
            Shape::Cylinder {
                radius: 0.2,
                half_height: 0.55,
            },
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
            Shape::Cone {
                radius: 0.34,
                half_height: 0.48,
            },
            Pattern::Stripes {
                axis: 1,
                period: 0.44,
            },
            &[0xf08a24, 0xfff4e0],
            at(spot, 0.48),
            0.0,
            Role::Standing,
        );

        let spot = self.spot(-1.52, -0.05);
        self.group(spot, reach);
        self.add(
            "crate",
            Shape::Box {
                half: DVec3::new(0.28, 0.24, 0.28),
            },
            Pattern::Checker { side: 0.28 },
            &[0x4a7c59, 0xdfe8c8],
            at(spot, 0.24),
            0.5,
            Role::Standing,
        );
        self.add(
            "crate ball",
            Shape::Sphere { radius: 0.19 },
            Pattern::Stripes {
                axis: 1,
                period: 0.34,
            },
            &[0xffc857, 0xe9724c],
            at(spot, 0.67),
            0.0,
            Role::Free,
        );

        let spot = self.spot(1.52, -0.02);
        self.group(spot, reach);
        self.add(
            "stool",
            Shape::Cylinder {
                radius: 0.25,
                half_height: 0.22,
            },
            Pattern::Spiral { period: 0.50 },
            &[0x6a4c93, 0xc9b6e4],
            at(spot, 0.22),
            0.0,
            Role::Standing,
        );
        self.add(
            "parcel",
            Shape::Box {
                half: DVec3::new(0.17, 0.14, 0.15),
            },
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
}
