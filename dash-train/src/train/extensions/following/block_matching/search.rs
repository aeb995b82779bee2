//! The search for where a group of Gaussians has gone from one frame to the next.

use dash_kernels::Camera;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::Error;
use crate::dataset::View;
use crate::train::core::Run;
use crate::train::core::initial_views::{difference, smoothed};

/// Cameras whose pictures are compared, at most.
const CAMERAS: usize = 8;
/// Longest side of the pictures.
const MAX_SIDE: usize = 320;
/// A Gaussian is in sight of a camera where the picture differs from its colour by less.
const IN_SIGHT: f32 = 0.12;
/// Differences count up to here: a camera from which a Gaussian has come to be hidden should not outvote others.
const MOST: f32 = 0.25;
/// Gaussians for each group, groups, and members of one that are asked, at most.
const GROUP: usize = 16;
const GROUPS: usize = 32;
const ASKED: usize = 64;
/// How much ways count beside places where Gaussians are put into groups.
const ALIKE: f32 = 3.0;
/// How far around is looked, in units of the fastest way of late.
const REACH: f32 = 2.0;
/// Places along a radius of that.
const PLACES: i32 = 6;
/// Halvings of their distance around the best.
const REFINED: usize = 2;
/// Fewest sights of a group that tell anything.
const MIN_SIGHTS: usize = 24;
/// Share of the difference at the place that the field expects below which another place is better.
const BETTER: f32 = 0.7;
/// By how much a place that is a reach away from where the last way leads has to be better than that.
const STRAIGHT: f32 = 0.01;

/// A camera's pictures at the last known frame and at the new one.
pub(super) struct Pair {
    pub(super) cameras: [Camera; 2],
    pub(super) colors: [Vec<[f32; 3]>; 2],
}

impl Pair {
    fn color(&self, frame: usize, point: Vec3) -> Option<[f32; 3]> {
        let camera = &self.cameras[frame];
        let ([u, v], _) = camera.project_inside(DVec3::from(point).to_array())?;
        Some(self.colors[frame][v as usize * camera.width + u as usize])
    }
}

/// Pictures of some of the cameras that have them at both times.
pub(super) fn pairs<M>(run: &Run<M>, times: [f32; 2]) -> Result<Vec<Pair>, Error> {
    let views = |time: f32| {
        let views = run.train_views.iter();
        let views = views.map(|&index| &run.dataset.views[index]);
        views.filter(move |view| view.time == time)
    };
    let mut both: Vec<[&View; 2]> = views(times[0])
        .filter_map(|a| {
            let b = views(times[1]).find(|b| b.camera_index == a.camera_index)?;
            Some([a, b])
        })
        .collect();
    both.sort_by_key(|[a, _]| a.camera_index);
    let kept = both.len().min(CAMERAS);
    let background = run.scene.settings.background;
    let pairs = (0..kept).into_par_iter().map(|k| {
        let [a, b] = both[k * both.len() / kept].map(|view| view.at_most(MAX_SIDE, background));
        let (a, b) = (a?, b?);
        Ok(Pair {
            colors: [smoothed(&a.rgb, &a.camera), smoothed(&b.rgb, &b.camera)],
            cameras: [a.camera, b.camera],
        })
    });
    pairs.collect()
}

/// Puts Gaussians into groups of such as are near each other and went the same way.
pub(super) fn groups(rows: &[usize], places: &[Vec3], ways: &[Vec3]) -> Vec<Vec<usize>> {
    let Some(&first) = rows.first() else {
        return Vec::new();
    };
    let apart = |a: usize, b: usize| {
        places[a].distance_squared(places[b]) + ALIKE * ALIKE * ways[a].distance_squared(ways[b])
    };
    let wanted = rows.len().div_ceil(GROUP).min(GROUPS);
    let mut nearest = vec![(f32::INFINITY, 0); rows.len()];
    // Each seed is the one farthest from those before it.
    let mut seed = first;
    for group in 0..wanted {
        for (nearest, &row) in nearest.iter_mut().zip(rows) {
            let distance = apart(row, seed);
            if distance < nearest.0 {
                *nearest = (distance, group);
            }
        }
        let farthest = (0..rows.len()).max_by(|&a, &b| nearest[a].0.total_cmp(&nearest[b].0));
        seed = farthest.map_or(first, |place| rows[place]);
    }
    let mut groups = vec![Vec::new(); wanted];
    for (&(_, group), &row) in nearest.iter().zip(rows) {
        groups[group].push(row);
    }
    groups.retain(|group| !group.is_empty());
    groups
}

/// Gaussians that are taken to go as one. All but the members are by row of the whole set.
pub(super) struct Group<'a> {
    pub(super) members: &'a [usize],
    /// Where they were at the last known frame.
    pub(super) last: &'a [Vec3],
    /// How they would go on to the new one at their last velocity.
    pub(super) ways: &'a [Vec3],
    /// The longest such way of late.
    pub(super) speeds: &'a [f32],
}

/// A member that a camera saw at the last known frame, and the colour there.
struct Sight<'a> {
    member: usize,
    pair: &'a Pair,
    color: [f32; 3],
}

impl Group<'_> {
    /// How far the group is at the new frame from where it was, if the pictures are clearly better there than where it is `expected`; a
    /// Gaussian's `color` tells which cameras have it in sight.
    pub(super) fn find(
        &self,
        pairs: &[Pair],
        color: impl Fn(usize) -> [f32; 3],
        expected: &[Vec3],
    ) -> Option<Vec3> {
        let sights = self.sights(pairs, color);
        if sights.len() < MIN_SIGHTS {
            return None;
        }
        let mean = |sum: Vec3| sum / self.members.len() as f32;
        let way = mean(self.members.iter().map(|&row| self.ways[row]).sum());
        let speed: f32 = self.members.iter().map(|&row| self.speeds[row]).sum();
        let reach = REACH * speed / self.members.len() as f32;
        let shifted = |shift: Vec3| disagreement(&sights, |row| self.last[row] + shift);
        let judged =
            |shift: Vec3| shifted(shift) + STRAIGHT * shift.distance(way) / reach.max(1e-12);
        let mut best = (judged(way), way);
        let mut look = |shift: Vec3| {
            let cost = judged(shift);
            if cost < best.0 {
                best = (cost, shift);
            }
            best.1
        };
        let mut step = reach / PLACES as f32;
        let mut around = way;
        for place in places(PLACES).filter(|place| place.length() <= PLACES as f32) {
            around = look(place * step);
        }
        for _ in 0..REFINED {
            step *= 0.5;
            let centre = around;
            for place in places(1) {
                around = look(centre + place * step);
            }
        }
        let now = disagreement(&sights, |row| expected[row]);
        let there = shifted(around);
        (there < BETTER * now).then_some(around)
    }

    fn sights<'a>(&self, pairs: &'a [Pair], color: impl Fn(usize) -> [f32; 3]) -> Vec<Sight<'a>> {
        let asked = self.members.iter();
        let asked = asked.step_by(self.members.len().div_ceil(ASKED).max(1));
        let mut sights = Vec::new();
        for &member in asked {
            for pair in pairs {
                if let Some(seen) = pair.color(0, self.last[member])
                    && difference(seen, color(member)) < IN_SIGHT
                {
                    sights.push(Sight {
                        member,
                        pair,
                        color: seen,
                    });
                }
            }
        }
        sights
    }
}

/// Mean difference of what was seen from what pictures of the new frame show at places; infinite where most of the
/// places are out of the pictures.
fn disagreement(sights: &[Sight], place: impl Fn(usize) -> Vec3) -> f32 {
    let (mut sum, mut seen) = (0.0, 0);
    for sight in sights {
        if let Some(color) = sight.pair.color(1, place(sight.member)) {
            sum += difference(color, sight.color).min(MOST);
            seen += 1;
        }
    }
    if 2 * seen < sights.len() {
        f32::INFINITY
    } else {
        sum / seen as f32
    }
}

/// All steps of up to so many along each axis.
fn places(most: i32) -> impl Iterator<Item = Vec3> {
    let along = move || -most..=most;
    along().flat_map(move |x| {
        along().flat_map(move |y| along().map(move |z| glam::IVec3::new(x, y, z).as_vec3()))
    })
}

#[cfg(test)]
mod tests;
