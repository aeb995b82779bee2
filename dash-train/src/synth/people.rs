//! People who walk through the room, and what they carry.

use super::pose::Pose;
use glam::{DMat3, DVec3};
use std::f64::consts::{PI, TAU};

/// Half of the time over which speeds are measured and turns are made; things are taken and put down in this time.
const BLEND: f64 = 0.012;
/// Length of a step, in metres.
const STEP_M: f64 = 0.62;
/// Metres per clip at which legs swing fully.
const STROLL_M: f64 = 16.0;
/// Height of the hips, the shoulders and the hands of one who carries, in metres.
const HIP_M: f64 = 0.90;
const SHOULDER_M: f64 = 1.42;
const HANDS_M: DVec3 = DVec3::new(0.0, 1.10, 0.40);
/// Lengths of both limbs of legs and arms, in metres.
pub(super) const LEG_M: f64 = 0.43;
pub(super) const ARM_M: f64 = 0.29;

/// A way through the room: times and places on the floor (x, z), in metres. Whoever walks it stands where two places in a row
/// are the same.
#[derive(Debug, PartialEq)]
pub struct Walk {
    /// In the order of their times.
    pub keys: &'static [(f64, [f64; 2])],
    /// From when to when something is carried.
    pub carries: [f64; 2],
}

/// A limb of a body. Sides are -1 for the left and 1 for the right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Limb {
    /// Hips to shoulders.
    Torso,
    /// The head.
    Head,
    /// From hip to knee.
    Thigh(f64),
    /// From knee to foot.
    Shin(f64),
    /// From shoulder to elbow.
    UpperArm(f64),
    /// From elbow to hand.
    Forearm(f64),
}

/// Something that is carried by one after the other, and lies in between.
#[derive(Debug, PartialEq)]
pub struct Carried {
    /// Who carries it, the first from the clip's beginning, the second to its end.
    pub by: [&'static Walk; 2],
    /// Where it lies.
    pub place: [f64; 3],
}

impl Walk {
    /// Who walks here, at a time: on the floor, looking along z.
    fn body(&self, time: f64) -> Pose {
        let [x, z] = self.place(time);
        Pose::new(DVec3::new(x, 0.0, z), self.heading(time))
    }

    /// The direction of the way, as a turn about the vertical. Whoever stands looks where they came from, and turns when they
    /// go on.
    fn heading(&self, time: f64) -> f64 {
        let ways = self.keys.windows(2).filter(|pair| pair[0].1 != pair[1].1);
        let of = |pair: &[(f64, [f64; 2])]| {
            let ((from, a), (_, b)) = (pair[0], pair[1]);
            (from, (b[0] - a[0]).atan2(b[1] - a[1]))
        };
        let mut headings = ways.map(of);
        let mut heading = headings.next().map_or(0.0, |(_, first)| first);
        for (from, next) in headings {
            let share = (0.5 + 0.5 * (time - from) / BLEND).clamp(0.0, 1.0);
            let turn = (next - heading + PI).rem_euclid(TAU) - PI;
            heading += eased(share) * turn;
        }
        heading
    }

    fn place(&self, time: f64) -> [f64; 2] {
        let next = self.keys.iter().position(|(at, _)| *at > time);
        match next {
            Some(0) => self.keys[0].1,
            None => self.keys[self.keys.len() - 1].1,
            Some(next) => {
                let ((from, a), (to, b)) = (self.keys[next - 1], self.keys[next]);
                let share = (time - from) / (to - from);
                std::array::from_fn(|i| a[i] + share * (b[i] - a[i]))
            }
        }
    }

    /// Metres per clip, around a time.
    fn speed(&self, time: f64) -> f64 {
        let [from, to] = [time - BLEND, time + BLEND].map(|time| self.place(time));
        (to[0] - from[0]).hypot(to[1] - from[1]) / (2.0 * BLEND)
    }

    /// Metres walked.
    fn distance(&self, time: f64) -> f64 {
        let mut sum = 0.0;
        for pair in self.keys.windows(2) {
            let ((from, a), (to, b)) = (pair[0], pair[1]);
            let share = ((time - from) / (to - from)).clamp(0.0, 1.0);
            sum += share * (b[0] - a[0]).hypot(b[1] - a[1]);
        }
        sum
    }

    /// How much is carried, from 0 to 1.
    fn carrying(&self, time: f64) -> f64 {
        let [from, to] = self.carries;
        let rises = ((time - from) / BLEND + 1.0).clamp(0.0, 1.0);
        let falls = ((to - time) / BLEND + 1.0).clamp(0.0, 1.0);
        rises.min(falls)
    }

    /// Where a limb of the body is.
    pub(super) fn pose(&self, limb: Limb, time: f64) -> Pose {
        let body = self.body(time);
        let phase = PI * self.distance(time) / STEP_M;
        let effort = (self.speed(time) / STROLL_M).min(1.0);
        let swing = 0.55 * effort * phase.sin();
        let held = self.carrying(time);
        let at = |x: f64, y: f64| body.then_from(&Pose::new(DVec3::new(x, y, 0.0), 0.0));
        let thigh = |side: f64| turned(&at(0.1 * side, HIP_M), side * swing);
        let arm = |side: f64| {
            let forward = (1.0 - held) * -0.8 * side * swing + held * 0.55;
            turned(&at(0.23 * side, SHOULDER_M), forward)
        };
        match limb {
            Limb::Torso => at(0.0, 0.5 * (HIP_M + SHOULDER_M)),
            Limb::Head => at(0.0, SHOULDER_M + 0.2),
            Limb::Thigh(side) => below(&thigh(side), LEG_M),
            Limb::Shin(side) => {
                let knee = end(&thigh(side), LEG_M);
                let bent = 0.45 * effort * (1.0 - side * phase.cos());
                below(&turned(&knee, -bent), LEG_M)
            }
            Limb::UpperArm(side) => below(&arm(side), ARM_M),
            Limb::Forearm(side) => {
                let elbow = end(&arm(side), ARM_M);
                below(&turned(&elbow, 0.25 + held * 0.75), ARM_M)
            }
        }
    }
}

impl Carried {
    /// Where it is.
    pub(super) fn pose(&self, time: f64) -> Pose {
        let lies = Pose::new(DVec3::from(self.place), 0.3);
        let [first, second] = self.by;
        let by = if time < 0.5 * (first.carries[1] + second.carries[0]) {
            first
        } else {
            second
        };
        let held = by.body(time).then_from(&Pose::new(HANDS_M, 0.0));
        let share = eased(by.carrying(time));
        // Both stand upright: their turns are about the vertical alone.
        let yaw = |pose: &Pose| pose.rotation.z_axis.x.atan2(pose.rotation.z_axis.z);
        let turn = (yaw(&held) - yaw(&lies) + PI).rem_euclid(TAU) - PI;
        Pose::new(
            lies.position.lerp(held.position, share),
            yaw(&lies) + share * turn,
        )
    }
}

/// A share that begins and ends slowly.
pub(super) fn eased(share: f64) -> f64 {
    share * share * (3.0 - 2.0 * share)
}

/// A joint turned forwards about its own x axis.
fn turned(joint: &Pose, forward_radians: f64) -> Pose {
    Pose {
        rotation: joint.rotation * DMat3::from_rotation_x(-forward_radians),
        position: joint.position,
    }
}

/// The middle of a limb that hangs from a joint.
fn below(joint: &Pose, length: f64) -> Pose {
    joint.then_from(&Pose::new(DVec3::new(0.0, -0.5 * length, 0.0), 0.0))
}

/// The lower end of a limb.
fn end(joint: &Pose, length: f64) -> Pose {
    joint.then_from(&Pose::new(DVec3::new(0.0, -length, 0.0), 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    static WALK: Walk = Walk {
        keys: &[
            (0.1, [2.0, 1.0]),
            (0.3, [0.0, 1.0]),
            (0.5, [0.0, 1.0]),
            (0.7, [0.0, -1.0]),
        ],
        carries: [0.0, 0.4],
    };

    #[test]
    fn limbs_hang_together_and_nothing_jumps() {
        let ends = |limb: Limb, length: f64, time: f64| {
            let pose = WALK.pose(limb, time);
            let half = pose.rotation * DVec3::new(0.0, 0.5 * length, 0.0);
            [pose.position + half, pose.position - half]
        };
        let limbs = [
            Limb::Torso,
            Limb::Head,
            Limb::Shin(1.0),
            Limb::Forearm(-1.0),
        ];
        for step in 0..1000 {
            let time = f64::from(step) / 1000.0;
            for side in [-1.0, 1.0] {
                for (upper, lower, length) in [
                    (Limb::Thigh(side), Limb::Shin(side), LEG_M),
                    (Limb::UpperArm(side), Limb::Forearm(side), ARM_M),
                ] {
                    let joint = ends(upper, length, time)[1];
                    assert!((joint - ends(lower, length, time)[0]).length() < 1e-9);
                }
            }
            for limb in limbs {
                let [a, b] = [time, time + 1e-3].map(|time| WALK.pose(limb, time).position);
                assert!(
                    (a - b).length() < 0.08,
                    "{limb:?} at {time}: {}",
                    (a - b).length()
                );
            }
        }
    }

    #[test]
    fn who_walks_looks_ahead_and_who_stands_looks_where_they_came_from() {
        let ahead = |time: f64| WALK.body(time).rotation.z_axis;
        assert!((ahead(0.2) - DVec3::NEG_X).length() < 1e-9);
        assert!((ahead(0.4) - DVec3::NEG_X).length() < 1e-9);
        assert!((ahead(0.6) - DVec3::NEG_Z).length() < 1e-9);
        assert_eq!((WALK.carrying(0.2), WALK.carrying(0.6)), (1.0, 0.0));
    }

    #[test]
    fn what_is_put_down_lies_until_it_is_taken() {
        static LATER: Walk = Walk {
            keys: &[
                (0.7, [2.0, 1.0]),
                (0.8, [0.0, 0.6]),
                (0.9, [0.0, 0.6]),
                (1.0, [2.0, 1.0]),
            ],
            carries: [0.9, 1.0],
        };
        static PARCEL: Carried = Carried {
            by: [&WALK, &LATER],
            place: [-0.4, 0.2, 1.0],
        };
        for time in [0.45, 0.6, 0.8] {
            let lies = PARCEL.pose(time).position;
            assert!((lies - DVec3::from(PARCEL.place)).length() < 1e-9, "{time}");
        }
        let held = |walk: &Walk, time: f64| walk.body(time).then_from(&Pose::new(HANDS_M, 0.0));
        for (walk, time) in [(&WALK, 0.2), (&LATER, 0.95)] {
            let off = PARCEL.pose(time).position - held(walk, time).position;
            assert!(off.length() < 1e-9, "{time}");
        }
    }
}
