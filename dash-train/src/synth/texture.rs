//! Procedural textures in an object's own coordinates, so that they move with it.
//!
//! Band-limited on purpose: no pattern repeats within less than [`SHORTEST_PERIOD_M`], noise is
//! smooth over [`MOTTLE_CELL_M`], and edges between colours are ramps [`EDGE_M`] wide.

use super::color::rgb;
use super::noise::{noise, random};
use glam::DVec3;
use std::f64::consts::TAU;

/// Shortest period of a pattern, in metres of surface: 10 pixels on the back wall and 13 in the
/// room's middle at 160x120, less where the surface is seen at a slant.
pub const SHORTEST_PERIOD_M: f64 = 0.32;
/// Lattice cell of the smooth noise, in metres; its wavelength is about two cells.
pub const MOTTLE_CELL_M: f64 = 0.22;
/// Width of the ramp between two colours, in metres.
pub const EDGE_M: f64 = 0.03;

/// How a texture arranges its colours. Lengths in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pattern {
    /// The first colour.
    Plain,
    /// Floor boards along z, in four colours.
    Planks {
        /// Width of a board.
        width: f64,
        /// Length of a board.
        length: f64,
    },
    /// Bricks of the first two colours in mortar of the third.
    Bricks {
        /// Width of a brick with its mortar.
        width: f64,
        /// Height of a brick with its mortar.
        height: f64,
    },
    /// Squares of the first two colours on each face.
    Checker {
        /// Side of a square.
        side: f64,
    },
    /// Bands of the first two colours along one axis.
    Stripes {
        /// 0, 1 or 2 for x, y, z.
        axis: usize,
        /// Length of one pair of bands.
        period: f64,
    },
    /// Bands of the first two colours that wind around the y axis.
    Spiral {
        /// Height of one pair of bands.
        period: f64,
    },
    /// Rings of all the colours around the y axis.
    Rings {
        /// Width of a ring.
        width: f64,
    },
    /// Segments of all the colours but the last around the y axis, caps in the last.
    BeachBall {
        /// Radius of the ball.
        radius: f64,
    },
    /// Soft diamonds of the first two colours on the xy plane.
    Diamonds {
        /// Width of a diamond.
        width: f64,
        /// Height of a diamond.
        height: f64,
    },
    /// Veins of the second colour in the first.
    Marble {
        /// Distance between veins.
        period: f64,
    },
    /// A die: one colour per face (the first six), each with a figure in the last.
    Faces {
        /// Half the side of the box.
        half: f64,
    },
    /// A sunset over hills on the xy plane.
    Sunset {
        /// Half the width.
        half_width: f64,
        /// Half the height.
        half_height: f64,
    },
}

impl Pattern {
    /// The least length within which the pattern repeats, in metres; none for single figures.
    pub fn shortest_period_m(&self) -> Option<f64> {
        match *self {
            Self::Plain | Self::Sunset { .. } => None,
            Self::Planks { width, length } => Some(2.0 * width.min(length)),
            Self::Bricks { width, height } | Self::Diamonds { width, height } => {
                Some(width.min(height))
            }
            Self::Checker { side } => Some(2.0 * side),
            Self::Stripes { period, .. } | Self::Spiral { period } | Self::Marble { period } => {
                Some(period)
            }
            // Two neighbours are one period: rings and segments alternate with a light colour.
            Self::Rings { width } => Some(2.0 * width),
            Self::BeachBall { radius } => Some(TAU * radius / 3.0),
            Self::Faces { half } => Some(2.0 * half),
        }
    }
}

/// A pattern, its colours and a little unevenness.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    /// How the colours are arranged.
    pub pattern: Pattern,
    /// Linear RGB in [0, 1].
    pub colors: Vec<DVec3>,
    /// Relative brightness swing of the smooth noise.
    pub mottle: f64,
    /// Seed of the noise.
    pub seed: u32,
}

impl Texture {
    /// The albedo (linear RGB) at a surface point, given with its normal in object coordinates.
    pub fn albedo(&self, point: DVec3, normal: DVec3) -> DVec3 {
        let color = |index: usize| self.colors[index % self.colors.len()];
        let mix = |a: usize, b: usize, t: f64| color(a).lerp(color(b), t);
        let base = match self.pattern {
            Pattern::Plain => color(0),
            Pattern::Planks { width, length } => self.planks(point, width, length),
            Pattern::Bricks { width, height } => self.bricks(face_uv(point, normal), width, height),
            Pattern::Checker { side } => {
                let [u, v] = face_uv(point, normal);
                let edge = EDGE_M / (2.0 * side);
                let (a, b) = (bands(u / (2.0 * side), edge), bands(v / (2.0 * side), edge));
                mix(0, 1, a + b - 2.0 * a * b)
            }
            Pattern::Stripes { axis, period } => {
                mix(0, 1, bands(point[axis] / period, EDGE_M / period))
            }
            Pattern::Spiral { period } => {
                let turn = point.z.atan2(point.x) / TAU;
                mix(0, 1, bands(point.y / period + turn, EDGE_M / period))
            }
            Pattern::Rings { width } => {
                let (ring, t) = steps(point.x.hypot(point.z) / width, EDGE_M / width);
                let index = |ring: f64| ring.rem_euclid(self.colors.len() as f64) as usize;
                mix(index(ring.max(0.0)), index(ring + 1.0), t)
            }
            Pattern::BeachBall { radius } => {
                let n = self.colors.len() - 1;
                let turn = (point.z.atan2(point.x) / TAU).rem_euclid(1.0) * n as f64;
                let around = (TAU * point.x.hypot(point.z) / n as f64).max(1e-6);
                let (segment, t) = steps(turn, EDGE_M / around);
                let index = |segment: f64| segment.rem_euclid(n as f64) as usize;
                let cap = ramp(point.y.abs() - 0.93 * radius, EDGE_M);
                mix(index(segment), index(segment + 1.0), t).lerp(color(n), cap)
            }
            Pattern::Diamonds { width, height } => {
                let (u, v) = (point.x / width, point.y / height);
                let wave = 0.5 * ((TAU * u).cos() + (TAU * v).cos());
                mix(0, 1, smooth((1.8 * wave + 0.5).clamp(0.0, 1.0)))
            }
            Pattern::Marble { period } => {
                let swirl = 1.1 * (noise(point / (1.2 * period), self.seed) - 0.5);
                let phase = (point.x + 0.6 * point.y - 0.4 * point.z) / period + swirl;
                mix(0, 1, (0.5 + 0.5 * (TAU * phase).sin()).powi(2))
            }
            Pattern::Faces { half } => self.die(point, normal, half),
            Pattern::Sunset {
                half_width,
                half_height,
            } => sunset(point.x / half_width, point.y / half_height),
        };
        let unevenness = noise(point / MOTTLE_CELL_M, self.seed ^ 0x9e37) - 0.5;
        base * (1.0 + self.mottle * 2.0 * unevenness)
    }

    fn planks(&self, point: DVec3, width: f64, length: f64) -> DVec3 {
        let shade = |board: f64| {
            let start = random(board as i64, 0, 0, self.seed);
            let (piece, t) = steps(point.z / length + start, EDGE_M / length);
            let tone = |piece: f64| {
                let wear = random(board as i64, piece as i64, 1, self.seed);
                self.plank_color(board, piece) * (0.92 + 0.16 * wear)
            };
            tone(piece).lerp(tone(piece + 1.0), t)
        };
        let (board, t) = steps(point.x / width, EDGE_M / width);
        let grain = noise(
            DVec3::new(point.x / 0.16, 0.0, point.z / 0.9),
            self.seed ^ 0x51ed,
        );
        shade(board).lerp(shade(board + 1.0), t) * (0.9 + 0.2 * grain)
    }

    /// Even and odd boards have different pairs of colours, so that neighbours differ.
    fn plank_color(&self, board: f64, piece: f64) -> DVec3 {
        let index = 2.0 * board.rem_euclid(2.0) + piece.rem_euclid(2.0);
        self.colors[index as usize % self.colors.len()]
    }

    fn bricks(&self, [u, v]: [f64; 2], width: f64, height: f64) -> DVec3 {
        let row = (v / height).floor();
        let shifted = u / width + 0.5 * row.rem_euclid(2.0);
        let brick = shifted.floor();
        // Distance to the nearest edge of the brick, in metres.
        let inside_u = (0.5 - (shifted - brick - 0.5).abs()) * width;
        let inside_v = (0.5 - (v / height - row - 0.5).abs()) * height;
        let tone = random(brick as i64, row as i64, 2, self.seed);
        let mortar = ramp(0.035 - inside_u.min(inside_v), EDGE_M);
        self.colors[0]
            .lerp(self.colors[1], tone)
            .lerp(self.colors[2], mortar)
    }

    fn die(&self, point: DVec3, normal: DVec3, half: f64) -> DVec3 {
        let [u, v] = face_uv(point, normal);
        let axis = dominant(normal);
        let face = 2 * axis + usize::from(normal[axis] < 0.0);
        let radius = u.hypot(v);
        let outside = match face % 3 {
            0 => radius - 0.58 * half,
            1 => (u.abs() + v.abs()) - 0.75 * half,
            _ => (u.abs().min(v.abs()) - 0.24 * half).max(u.abs().max(v.abs()) - 0.72 * half),
        };
        self.colors[face].lerp(self.colors[6], ramp(-outside, EDGE_M))
    }
}

/// Sky, sun and two ranges of hills over [-1, 1]^2.
fn sunset(u: f64, v: f64) -> DVec3 {
    let sky = rgb(0xf7b267).lerp(rgb(0x355070), smooth((0.5 + 0.55 * v).clamp(0.0, 1.0)));
    let sun = ramp(0.36 - (1.45 * (u - 0.3)).hypot(v - 0.12), 0.1);
    let far_hill = ramp(-0.18 + 0.2 * (2.6 * u + 0.9).sin() - v, 0.1);
    let near_hill = ramp(-0.52 + 0.18 * (3.1 * u - 1.2).sin() - v, 0.1);
    sky.lerp(rgb(0xfff1c1), sun)
        .lerp(rgb(0x8a4f7d), far_hill)
        .lerp(rgb(0x2a6f6b), near_hill)
}

fn smooth(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

/// 0 well below zero, 1 well above, a smooth ramp of the given width around it.
fn ramp(distance: f64, width: f64) -> f64 {
    smooth((distance / width + 0.5).clamp(0.0, 1.0))
}

/// A square wave of period 1 between 0 and 1 with ramps `edge` wide.
fn bands(phase: f64, edge: f64) -> f64 {
    let distance = 0.25 - (phase.rem_euclid(1.0) - 0.5).abs();
    ramp(distance, edge)
}

/// Splits `x` into a whole step and the share (0 to 1) of the next step near its upper end, the
/// ramp `edge` wide around every whole number.
fn steps(x: f64, edge: f64) -> (f64, f64) {
    let shifted = x + 0.5 * edge;
    let step = shifted.floor();
    let into = shifted - step;
    // Just above a whole number the ramp from the step below ends.
    (step - 1.0, smooth((into / edge).clamp(0.0, 1.0)))
}

fn dominant(normal: DVec3) -> usize {
    let a = normal.abs();
    if a.x >= a.y && a.x >= a.z {
        0
    } else if a.y >= a.z {
        1
    } else {
        2
    }
}

/// Coordinates on the face that the normal is nearest to: v is up on side faces.
fn face_uv(point: DVec3, normal: DVec3) -> [f64; 2] {
    match dominant(normal) {
        0 => [point.z, point.y],
        1 => [point.x, point.z],
        _ => [point.x, point.y],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_change_across_whole_numbers_only() {
        let value = |x: f64| {
            let (step, t) = steps(x, 0.2);
            step + t
        };
        assert_eq!(value(2.5), 2.0);
        assert_eq!(value(2.89), 2.0);
        assert!((value(3.0) - 2.5).abs() < 1e-12, "halfway over 3");
        assert_eq!(value(3.11), 3.0);
        assert_eq!(value(-0.5), -1.0);
    }
}
