//! Rigid motions over the clip's time in [0, 1].

use super::people::{Carried, Limb, Walk, eased};
use super::pose::Pose;
use glam::{DMat3, DVec3};
use std::f64::consts::{PI, TAU};

/// A smooth swing of a group of objects about a common pivot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// The point the group turns about.
    pub pivot: DVec3,
    /// Greatest displacement along each axis, in metres.
    pub reach: DVec3,
    /// Greatest turn about the vertical.
    pub turn_radians: f64,
    /// Where in its swing it starts, in [0, 1).
    pub phase: f64,
}

impl Drift {
    fn pose(&self, time: f64) -> Pose {
        // Relative to the start, so that time 0 is the room as built.
        let swing =
            |cycles: f64| (TAU * (cycles * time + self.phase)).sin() - (TAU * self.phase).sin();
        let rotation = DMat3::from_rotation_y(self.turn_radians * swing(0.7));
        let offset = self.reach * DVec3::new(swing(0.8), swing(1.1), swing(0.6));
        Pose {
            rotation,
            position: self.pivot + offset - rotation * self.pivot,
        }
    }
}

/// How an object moves from its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// It does not.
    Still,
    /// The bouncing ball's path; the place is not used.
    Bounce {
        /// Radius of the ball: its lowest point touches the floor.
        radius: f64,
    },
    /// A turn about the vertical that starts and ends slowly.
    Turn {
        /// Angle over the whole clip.
        radians: f64,
    },
    /// A fast figure of eight around the place, in metres.
    Dart {
        /// Greatest distance from the place along each axis.
        reach: DVec3,
    },
    /// A swing of its group.
    Drift(Drift),
    /// A part of somebody who walks; the place is not used.
    Walk(&'static Walk, Limb),
    /// In the hands of somebody who walks; the place is not used.
    Carried(&'static Carried),
    /// A door; the place is its hinge.
    Hinge {
        /// The middle of the door from the hinge while it is shut, in metres.
        middle: DVec3,
        /// How far it opens.
        radians: f64,
        /// From when to when it opens.
        opens: [f64; 2],
        /// From when to when it closes.
        closes: [f64; 2],
    },
}

impl Motion {
    /// The pose at `time` of an object whose place is `base`.
    pub fn pose(&self, base: &Pose, time: f64) -> Pose {
        match *self {
            Self::Still => *base,
            Self::Bounce { radius } => Pose {
                rotation: DMat3::from_rotation_z(-2.2 * time) * DMat3::from_rotation_x(0.6),
                position: bounce_path(radius, time),
            },
            Self::Turn { radians } => {
                let eased = time - 0.5 * (TAU * time).sin() / TAU;
                Pose {
                    rotation: DMat3::from_rotation_y(radians * eased) * base.rotation,
                    ..*base
                }
            }
            Self::Dart { reach } => {
                let wave = DVec3::new(
                    (TAU * time).sin(),
                    (2.0 * TAU * time + 0.4).sin(),
                    (TAU * time + 1.0).cos(),
                );
                Pose {
                    position: base.position + reach * wave,
                    ..*base
                }
            }
            Self::Drift(drift) => drift.pose(time).then_from(base),
            Self::Walk(walk, part) => walk.pose(part, time),
            Self::Carried(carried) => carried.pose(time),
            Self::Hinge {
                middle,
                radians,
                opens,
                closes,
            } => {
                let done =
                    |[from, to]: [f64; 2]| eased(((time - from) / (to - from)).clamp(0.0, 1.0));
                let open = done(opens) - done(closes);
                let hinge = base.then_from(&Pose::new(DVec3::ZERO, radians * open));
                hinge.then_from(&Pose::new(middle, 0.0))
            }
        }
    }
}

/// Heights of the ball's first drop and of the two bounces after it, in metres.
const BOUNCE_HEIGHTS_M: [f64; 3] = [1.0, 0.6, 0.3];

/// Centre of the ball: parabolas over the floor, swept sideways and in depth.
fn bounce_path(radius: f64, time: f64) -> DVec3 {
    let [drop, first, second] = BOUNCE_HEIGHTS_M.map(|h| (2.0 * h).sqrt());
    // Gravity (in metres per clip squared) such that the last bounce ends with the clip.
    let root_gravity = drop + 2.0 * first + 2.0 * second;
    let fall = time * root_gravity;
    let landings = [drop, drop + 2.0 * first];
    let (since_apex, apex) = if fall < landings[0] {
        (fall, BOUNCE_HEIGHTS_M[0])
    } else if fall < landings[1] {
        (fall - landings[0] - first, BOUNCE_HEIGHTS_M[1])
    } else {
        (fall - landings[1] - second, BOUNCE_HEIGHTS_M[2])
    };
    let height = apex - 0.5 * since_apex * since_apex;
    DVec3::new(
        -1.1 + 2.1 * time + 0.1 * (PI * time).sin(),
        radius + height.max(0.0),
        0.55 + 0.16 * (TAU * 0.8 * time).sin(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ball_starts_at_its_apex_touches_the_floor_and_stays_above_it() {
        assert!((bounce_path(0.26, 0.0).y - 1.26).abs() < 1e-12);
        assert!((bounce_path(0.26, 1.0).y - 0.26).abs() < 1e-9);
        let heights: Vec<f64> = (0..=1000)
            .map(|i| bounce_path(0.26, f64::from(i) / 1e3).y)
            .collect();
        assert!(heights.iter().all(|y| *y >= 0.26));
        let landings = (1..1000)
            .filter(|&i| heights[i] < heights[i - 1] && heights[i] <= heights[i + 1])
            .count();
        assert_eq!(landings, 2);
        assert!(
            heights.windows(2).all(|w| (w[0] - w[1]).abs() < 0.01),
            "a jump"
        );
    }

    #[test]
    fn poses_compose_and_invert() {
        let a = Pose::new(DVec3::new(1.0, 2.0, 3.0), 0.7);
        let b = Pose::new(DVec3::new(-0.5, 0.1, 0.4), -1.9);
        let p = DVec3::new(0.3, -0.2, 0.9);
        let world = |pose: &Pose, p: DVec3| pose.rotation * p + pose.position;
        assert!((world(&a.then_from(&b), p) - world(&a, world(&b, p))).length() < 1e-12);
        assert!((a.to_object(world(&a, p)) - p).length() < 1e-12);
        let drift = Drift {
            pivot: DVec3::new(1.0, 0.0, 1.0),
            reach: DVec3::splat(0.1),
            turn_radians: 0.2,
            phase: 0.3,
        };
        let start = Motion::Drift(drift).pose(&a, 0.0);
        assert!(
            (start.position - a.position).length() < 1e-12,
            "starts at its place"
        );
        assert!((Motion::Drift(drift).pose(&a, 0.5).position - a.position).length() > 0.02);
    }
}
