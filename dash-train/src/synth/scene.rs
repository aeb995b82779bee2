//! Objects, light and what a ray sees.

use super::motion::Motion;
use super::pose::Pose;
use super::shape::{Ray, Shape};
use super::texture::Texture;
use glam::{DMat3, DVec3};

/// Direction (a unit vector) towards the warm key light.
const KEY_DIRECTION: DVec3 = DVec3::new(-0.48, 0.64, 0.60);
const KEY_COLOR: DVec3 = DVec3::new(0.60, 0.56, 0.48);
/// Direction (a unit vector) towards the cool fill light.
const FILL_DIRECTION: DVec3 = DVec3::new(0.64, 0.48, 0.60);
const FILL_COLOR: DVec3 = DVec3::new(0.16, 0.18, 0.22);
/// Ambient light from above and from below.
const SKY_COLOR: DVec3 = DVec3::new(0.47, 0.49, 0.53);
const GROUND_COLOR: DVec3 = DVec3::new(0.33, 0.30, 0.26);

/// The lamp's light nearby, and the distance at which half of it is left, in metres.
const LAMP_COLOR: DVec3 = DVec3::new(0.85, 0.66, 0.38);
const LAMP_REACH_M: f64 = 0.9;
/// How often a screen changes in a clip.
const SCREEN_CHANGES: f64 = 400.0;

/// Half the room's width, in metres; the floor is y = 0, the back wall at [`ROOM_BACK_M`].
pub const ROOM_HALF_WIDTH_M: f64 = 2.2;
/// z of the back wall; the cameras are on the +z side.
pub const ROOM_BACK_M: f64 = -1.5;

/// What role an object plays in the shading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Floor, wall or what lies flat on them: darkens towards corners and under clutter.
    Room,
    /// Stands on the floor and darkens it around its foot.
    Standing,
    /// Neither darkens nor is darkened.
    Free,
}

/// How a surface looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Look {
    /// The same from every direction.
    #[default]
    Matte,
    /// Shines while the scene's lamp is on.
    Lamp,
    /// Shines in a colour that changes all the time.
    Screen,
    /// Shows the room in it.
    Mirror,
    /// Shows the room behind it.
    Glass,
}

/// A lamp that is switched on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lamp {
    /// Where its light comes from.
    pub position: DVec3,
    /// When.
    pub on: f64,
}

/// A textured solid on its path.
#[derive(Debug, Clone, PartialEq)]
pub struct Object {
    /// A unique name.
    pub name: String,
    /// Its form.
    pub shape: Shape,
    /// Its colours.
    pub texture: Texture,
    /// Its place before any motion.
    pub base: Pose,
    /// Its motion.
    pub motion: Motion,
    /// Its role in the shading.
    pub role: Role,
    /// How its surface looks.
    pub look: Look,
}

/// A room and what is in it.
///
/// # Shading
/// Lambert under a sky and two distant lights, without cast shadows or reflections. Corners and
/// the floor around clutter are darker. Moving objects among resting ones neither cause nor receive this. So a pixel's colour depends on a moving object exactly where that
/// object is the nearest surface. In the scene `day` a lamp lights the room from some time on, and objects of another
/// [`Look`] change their colours where they stand.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Everything in it.
    pub objects: Vec<Object>,
    /// The whole scene's motion on top of that of each object.
    pub sway: Motion,
    /// Its lamp, if it has one.
    pub lamp: Option<Lamp>,
}

impl Scene {
    /// Whether an object changes its pose during the clip.
    pub fn moves(&self, object: &Object) -> bool {
        self.sway != Motion::Still || object.motion != Motion::Still
    }

    /// Whether an object moves or changes its colour where it stands, apart from the lamp's light.
    pub fn changes(&self, object: &Object) -> bool {
        self.moves(object) || object.look != Look::Matte
    }

    /// Whether the lamp is on.
    pub fn is_lit(&self, time: f64) -> bool {
        self.lamp.is_some_and(|lamp| time >= lamp.on)
    }

    /// The scene at an instant.
    pub fn at(&self, time: f64) -> Instant<'_> {
        let room = self.sway.pose(&Pose::new(DVec3::ZERO, 0.0), time);
        let posed = self
            .objects
            .iter()
            .map(|object| {
                let pose = room.then_from(&object.motion.pose(&object.base, time));
                Posed {
                    object,
                    pose,
                    object_from_world: pose.rotation.transpose(),
                    moving: self.moves(object),
                    changes: self.changes(object),
                }
            })
            .collect();
        Instant {
            posed,
            room,
            time,
            lamp: self.lamp.filter(|_| self.is_lit(time)),
        }
    }
}

/// An object at an instant.
#[derive(Debug, Clone, Copy)]
pub struct Posed<'a> {
    /// The object.
    pub object: &'a Object,
    /// Where it is.
    pub pose: Pose,
    /// Inverse of the pose's rotation.
    pub object_from_world: DMat3,
    /// Whether it moves during the clip.
    pub moving: bool,
    /// Whether it moves, or changes its colour where it stands.
    pub changes: bool,
}

/// A scene at an instant.
#[derive(Debug, Clone)]
pub struct Instant<'a> {
    /// The objects in the scene's order.
    pub posed: Vec<Posed<'a>>,
    room: Pose,
    time: f64,
    /// Where it is on.
    lamp: Option<Lamp>,
}

/// What a ray sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Index of the object.
    pub object: usize,
    /// In lengths of the ray's direction.
    pub distance: f64,
    /// The point in object coordinates.
    pub local_point: DVec3,
    /// The outward unit normal in object coordinates.
    pub local_normal: DVec3,
}

impl Instant<'_> {
    /// The nearest surface along a ray.
    pub fn trace(&self, ray: &Ray) -> Option<Seen> {
        self.trace_but(ray, None)
    }

    /// The same without one object.
    fn trace_but(&self, ray: &Ray, left_out: Option<usize>) -> Option<Seen> {
        let mut nearest: Option<Seen> = None;
        for (index, posed) in self.posed.iter().enumerate() {
            if left_out == Some(index) {
                continue;
            }
            let local = Ray {
                origin: posed.pose.to_object(ray.origin),
                direction: posed.object_from_world * ray.direction,
            };
            nearest = nearer(nearest, index, posed, &local);
        }
        nearest
    }

    /// Linear RGB of a point that a ray sees. Only mirrors and glass look different from elsewhere.
    pub fn shade(&self, seen: &Seen, ray: &Ray) -> DVec3 {
        let posed = &self.posed[seen.object];
        let own = || {
            let texture = &posed.object.texture;
            texture.albedo(seen.local_point, seen.local_normal)
        };
        let beyond = |ray: &Ray| {
            let hit = self.trace_but(ray, Some(seen.object));
            hit.map_or(DVec3::ZERO, |hit| self.lit(&hit))
        };
        match posed.object.look {
            Look::Matte => self.lit(seen),
            Look::Lamp if self.lamp.is_none() => 0.6 * self.lit(seen),
            Look::Lamp => 1.2 * own(),
            Look::Screen => screen_color(seen.local_point, self.time) * own(),
            Look::Mirror => {
                let normal = posed.pose.rotation * seen.local_normal;
                let direction = ray.direction - 2.0 * ray.direction.dot(normal) * normal;
                let origin = ray.at(seen.distance);
                0.9 * own() * beyond(&Ray { origin, direction })
            }
            Look::Glass => 0.12 * self.lit(seen) + 0.85 * own() * beyond(ray),
        }
    }

    /// Linear RGB of a seen point of a matte surface; the same from every direction.
    fn lit(&self, seen: &Seen) -> DVec3 {
        let posed = &self.posed[seen.object];
        let albedo = posed
            .object
            .texture
            .albedo(seen.local_point, seen.local_normal);
        let normal = posed.pose.rotation * seen.local_normal;
        let facing = |direction: DVec3| normal.dot(direction).max(0.0);
        let point = posed.pose.rotation * seen.local_point + posed.pose.position;
        let mut light = GROUND_COLOR.lerp(SKY_COLOR, 0.5 + 0.5 * normal.y)
            + KEY_COLOR * facing(KEY_DIRECTION)
            + FILL_COLOR * facing(FILL_DIRECTION);
        if let Some(lamp) = self.lamp {
            let way = lamp.position - point;
            let distance = way.length().max(1e-3);
            light +=
                LAMP_COLOR * facing(way / distance) / (1.0 + (distance / LAMP_REACH_M).powi(2));
        }
        albedo * light * self.openness(posed.object.role, point, normal)
    }

    /// The share of ambient light that reaches a point past corners and clutter.
    fn openness(&self, role: Role, point: DVec3, normal: DVec3) -> f64 {
        if role == Role::Free {
            return 1.0;
        }
        let p = self.room.to_object(point);
        let n = self.room.rotation.transpose() * normal;
        // A plane does not darken itself.
        let near = |distance: f64, along: f64| {
            1.0 - 0.30 * (1.0 - along.abs()) * (-distance.max(0.0) / 0.22).exp()
        };
        let mut open = near(p.y, n.y);
        if role == Role::Room {
            open *= near(p.z - ROOM_BACK_M, n.z)
                * near(ROOM_HALF_WIDTH_M - p.x, n.x)
                * near(ROOM_HALF_WIDTH_M + p.x, n.x);
            if n.y > 0.9 && p.y < 0.1 {
                for posed in self
                    .posed
                    .iter()
                    .filter(|p| p.object.role == Role::Standing)
                {
                    open *= 1.0 - contact_darkness(posed, point);
                }
            }
        }
        open
    }
}

/// The light of a screen at a point of it: soft bands, whose colours jump.
fn screen_color(point: DVec3, time: f64) -> DVec3 {
    let slot = (SCREEN_CHANGES * time).floor();
    let wave = |k: f64, along: f64| 0.5 + 0.5 * (2.4 * slot * (1.0 + 0.37 * k) + along).sin();
    DVec3::new(
        wave(0.0, 5.0 * point.x),
        wave(1.0, 7.0 * point.y),
        wave(2.0, 4.0 * (point.x - point.y)),
    )
}

/// How much a standing object darkens a floor point.
fn contact_darkness(posed: &Posed<'_>, point: DVec3) -> f64 {
    let foot = posed.object.shape.half_extent();
    let local = posed.object_from_world * (point - posed.pose.position);
    let (gap, spread) = match posed.object.shape {
        Shape::Box { half } => {
            let outside = (local.abs() - half).max(DVec3::ZERO);
            (outside.x.hypot(outside.z), 0.14)
        }
        Shape::Sphere { radius } => (
            (local.x.hypot(local.z) - 0.4 * radius).max(0.0),
            0.55 * radius,
        ),
        _ => ((local.x.hypot(local.z) - foot.x).max(0.0), 0.14),
    };
    if gap > 4.0 * spread {
        // Under 1e-7.
        return 0.0;
    }
    0.5 * (-(gap / spread).powi(2)).exp()
}

/// The nearer of `nearest` and the hit of `local`, a ray in `posed`'s coordinates.
pub(super) fn nearer(
    nearest: Option<Seen>,
    index: usize,
    posed: &Posed<'_>,
    local: &Ray,
) -> Option<Seen> {
    let Some(hit) = posed.object.shape.hit(local) else {
        return nearest;
    };
    // Of coinciding surfaces the first object is seen, whatever the order of the calls.
    if nearest.is_some_and(|seen| (seen.distance, seen.object) <= (hit.distance, index)) {
        return nearest;
    }
    Some(Seen {
        object: index,
        distance: hit.distance,
        local_point: local.at(hit.distance),
        local_normal: hit.normal,
    })
}
