//! Rays and the solids they hit, each solid around its own origin.

use glam::DVec3;

/// Closest accepted hit, so that a ray does not find the surface it starts on.
const MIN_DISTANCE: f64 = 1e-6;

/// A half line.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Where it starts.
    pub origin: DVec3,
    /// Where it points; its length is the unit of a hit's `distance`.
    pub direction: DVec3,
}

impl Ray {
    /// The point `distance` directions along the ray.
    pub fn at(&self, distance: f64) -> DVec3 {
        self.origin + distance * self.direction
    }
}

/// Where a ray enters a solid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceHit {
    /// In lengths of the ray's direction.
    pub distance: f64,
    /// Outward unit normal.
    pub normal: DVec3,
}

/// A solid centred on its own origin, y upwards. Lengths in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Its radius.
        radius: f64,
    },
    /// A box along the axes.
    Box {
        /// Half its side lengths.
        half: DVec3,
    },
    /// A closed cylinder around the y axis.
    Cylinder {
        /// Its radius.
        radius: f64,
        /// Half its height.
        half_height: f64,
    },
    /// A closed cone around the y axis, its tip at `+half_height`.
    Cone {
        /// Radius of the base.
        radius: f64,
        /// Half its height.
        half_height: f64,
    },
}

impl Shape {
    /// The first point in front of the ray's origin where it enters the solid from outside.
    ///
    /// A ray that starts inside hits nothing: cameras are never inside an object.
    #[inline]
    pub fn hit(&self, ray: &Ray) -> Option<SurfaceHit> {
        match *self {
            Self::Sphere { radius } => hit_sphere(ray, radius),
            Self::Box { half } => hit_box(ray, half),
            Self::Cylinder {
                radius,
                half_height,
            } => hit_cylinder(ray, radius, half_height),
            Self::Cone {
                radius,
                half_height,
            } => hit_cone(ray, radius, half_height),
        }
    }

    /// Half the side lengths of a box around the solid.
    pub fn half_extent(&self) -> DVec3 {
        match *self {
            Self::Sphere { radius } => DVec3::splat(radius),
            Self::Box { half } => half,
            Self::Cylinder {
                radius,
                half_height,
            }
            | Self::Cone {
                radius,
                half_height,
            } => DVec3::new(radius, half_height, radius),
        }
    }
}

fn hit_sphere(ray: &Ray, radius: f64) -> Option<SurfaceHit> {
    let a = ray.direction.length_squared();
    let half_b = ray.origin.dot(ray.direction);
    let c = ray.origin.length_squared() - radius * radius;
    let discriminant = half_b * half_b - a * c;
    if discriminant < 0.0 {
        return None;
    }
    let distance = (-half_b - discriminant.sqrt()) / a;
    (distance > MIN_DISTANCE).then(|| SurfaceHit {
        distance,
        normal: ray.at(distance) / radius,
    })
}

fn hit_box(ray: &Ray, half: DVec3) -> Option<SurfaceHit> {
    // Slabs. A direction component of 0 gives infinities, which compare correctly; an origin
    // exactly on that slab's plane gives NaN, which max and min skip.
    let inverse = ray.direction.recip();
    let to_low = (-half - ray.origin) * inverse;
    let to_high = (half - ray.origin) * inverse;
    let (mut enter, mut leave, mut axis) = (f64::NEG_INFINITY, f64::INFINITY, 0);
    for i in 0..3 {
        let near = to_low[i].min(to_high[i]);
        if near > enter {
            (enter, axis) = (near, i);
        }
        leave = leave.min(to_low[i].max(to_high[i]));
    }
    (enter > MIN_DISTANCE && enter <= leave).then(|| {
        let mut normal = DVec3::ZERO;
        normal[axis] = -ray.direction[axis].signum();
        SurfaceHit {
            distance: enter,
            normal,
        }
    })
}

/// The hit on the horizontal disc at `height`, seen from the side that `up` (+-1) faces.
fn hit_disc(ray: &Ray, radius: f64, height: f64, up: f64) -> Option<SurfaceHit> {
    if ray.direction.y * up >= 0.0 {
        return None;
    }
    let distance = (height - ray.origin.y) / ray.direction.y;
    let p = ray.at(distance);
    (distance > MIN_DISTANCE && p.x * p.x + p.z * p.z <= radius * radius).then_some(SurfaceHit {
        distance,
        normal: DVec3::Y * up,
    })
}

fn nearer(a: Option<SurfaceHit>, b: Option<SurfaceHit>) -> Option<SurfaceHit> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if a.distance <= b.distance { a } else { b }),
        (a, b) => a.or(b),
    }
}

fn hit_cylinder(ray: &Ray, radius: f64, half_height: f64) -> Option<SurfaceHit> {
    let (o, d) = (ray.origin, ray.direction);
    let a = d.x * d.x + d.z * d.z;
    let half_b = o.x * d.x + o.z * d.z;
    let c = o.x * o.x + o.z * o.z - radius * radius;
    let discriminant = half_b * half_b - a * c;
    if discriminant < 0.0 {
        return None;
    }
    let distance = (-half_b - discriminant.sqrt()) / a;
    let p = ray.at(distance);
    // `a` is 0 for a vertical ray: the distance is not finite and only the discs count.
    let side = (distance > MIN_DISTANCE && p.y.abs() <= half_height).then(|| SurfaceHit {
        distance,
        normal: DVec3::new(p.x, 0.0, p.z) / radius,
    });
    let up = -d.y.signum();
    nearer(side, hit_disc(ray, radius, up * half_height, up))
}

fn hit_cone(ray: &Ray, radius: f64, half_height: f64) -> Option<SurfaceHit> {
    let (o, d) = (ray.origin, ray.direction);
    // x^2 + z^2 = (slope * below)^2 with `below` the drop from the tip.
    let slope = radius / (2.0 * half_height);
    let below = half_height - o.y;
    let a = d.x * d.x + d.z * d.z - slope * slope * d.y * d.y;
    let half_b = o.x * d.x + o.z * d.z + slope * slope * below * d.y;
    let c = o.x * o.x + o.z * o.z - slope * slope * below * below;
    let discriminant = half_b * half_b - a * c;
    let mut side = None;
    if discriminant >= 0.0 {
        let root = discriminant.sqrt();
        for distance in [(-half_b - root) / a, (-half_b + root) / a] {
            let p = ray.at(distance);
            let normal = DVec3::new(p.x, slope * slope * (half_height - p.y), p.z);
            // The mirrored cone above the tip and exits from the solid are no hits.
            if distance > MIN_DISTANCE && p.y.abs() <= half_height && normal.dot(d) < 0.0 {
                side = nearer(
                    side,
                    Some(SurfaceHit {
                        distance,
                        normal: normal.normalize(),
                    }),
                );
            }
        }
    }
    nearer(side, hit_disc(ray, radius, -half_height, -1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray {
            origin: origin.into(),
            direction: direction.into(),
        }
    }

    fn assert_hit(shape: Shape, ray: &Ray, distance: f64, normal: [f64; 3]) {
        let hit = shape.hit(ray).expect("the ray meets the solid");
        assert!(
            (hit.distance - distance).abs() < 1e-12
                && (hit.normal - DVec3::from(normal)).length() < 1e-12,
            "{shape:?}: got {hit:?}, expected {distance} {normal:?}"
        );
    }

    #[test]
    fn sphere_by_hand() {
        let sphere = Shape::Sphere { radius: 2.0 };
        assert_hit(
            sphere,
            &ray([0.0, 0.0, 5.0], [0.0, 0.0, -1.0]),
            3.0,
            [0.0, 0.0, 1.0],
        );
        // Half as long a direction doubles the distance.
        assert_hit(
            sphere,
            &ray([0.0, 0.0, 5.0], [0.0, 0.0, -0.5]),
            6.0,
            [0.0, 0.0, 1.0],
        );
        // Off centre: x = 1.2 meets the sphere at z = 1.6.
        assert_hit(
            sphere,
            &ray([1.2, 0.0, 4.0], [0.0, 0.0, -1.0]),
            2.4,
            [0.6, 0.0, 0.8],
        );
        assert_eq!(sphere.hit(&ray([2.1, 0.0, 5.0], [0.0, 0.0, -1.0])), None);
        assert_eq!(
            sphere.hit(&ray([0.0, 0.0, 5.0], [0.0, 0.0, 1.0])),
            None,
            "behind"
        );
        assert_eq!(
            sphere.hit(&ray([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])),
            None,
            "inside"
        );
    }

    #[test]
    fn box_by_hand() {
        let shape = Shape::Box {
            half: DVec3::new(1.0, 2.0, 3.0),
        };
        assert_hit(
            shape,
            &ray([0.0, 0.0, 5.0], [0.0, 0.0, -1.0]),
            2.0,
            [0.0, 0.0, 1.0],
        );
        assert_hit(
            shape,
            &ray([-4.0, 1.0, 0.0], [1.0, 0.0, 0.0]),
            3.0,
            [-1.0, 0.0, 0.0],
        );
        // Diagonal in xy: enters x = 1 at distance 2 where y is 1.
        assert_hit(
            shape,
            &ray([3.0, 3.0, 0.5], [-1.0, -1.0, 0.0]),
            2.0,
            [1.0, 0.0, 0.0],
        );
        assert_eq!(shape.hit(&ray([0.0, 2.1, 5.0], [0.0, 0.0, -1.0])), None);
        assert_eq!(
            shape.hit(&ray([0.0, 0.0, 5.0], [0.0, 0.0, 1.0])),
            None,
            "behind"
        );
    }

    #[test]
    fn cylinder_and_cone_by_hand() {
        let cylinder = Shape::Cylinder {
            radius: 1.0,
            half_height: 2.0,
        };
        assert_hit(
            cylinder,
            &ray([0.0, 1.0, 4.0], [0.0, 0.0, -1.0]),
            3.0,
            [0.0, 0.0, 1.0],
        );
        assert_hit(
            cylinder,
            &ray([0.5, 5.0, 0.0], [0.0, -1.0, 0.0]),
            3.0,
            [0.0, 1.0, 0.0],
        );
        assert_eq!(cylinder.hit(&ray([0.0, 2.1, 4.0], [0.0, 0.0, -1.0])), None);
        assert_eq!(cylinder.hit(&ray([1.5, 5.0, 0.0], [0.0, -1.0, 0.0])), None);
        let cone = Shape::Cone {
            radius: 1.0,
            half_height: 1.0,
        };
        // Halfway up (y = 0) the radius is 0.5; the normal leans up with slope 1/2.
        let lean = 1.25f64.sqrt();
        assert_hit(
            cone,
            &ray([0.0, 0.0, 4.0], [0.0, 0.0, -1.0]),
            3.5,
            [0.0, 0.5 / lean, 1.0 / lean],
        );
        assert_hit(
            cone,
            &ray([0.3, -4.0, 0.2], [0.0, 1.0, 0.0]),
            3.0,
            [0.0, -1.0, 0.0],
        );
        assert_eq!(cone.hit(&ray([0.6, 0.0, 4.0], [0.0, 0.0, -1.0])), None);
        assert_eq!(
            cone.hit(&ray([0.0, 1.5, 4.0], [0.0, 0.0, -1.0])),
            None,
            "mirrored cone"
        );
    }
}
