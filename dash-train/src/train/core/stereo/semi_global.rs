//! Semi-global matching (Hirschmüller 2008): neighbouring pixels agree on their planes, along eight directions.

use pulp::{Arch, Simd, WithSimd};

use super::{PLANES, Picture};

/// What a step to the next plane costs between neighbours, of 255.
const STEP: u16 = 6;
/// What a larger one costs where colours are alike, and at least.
const JUMP: [f32; 2] = [96.0, 24.0];
/// Mean colour difference that makes a jump half as expensive.
const EDGE: f32 = 6.0 / 255.0;
/// Beside the first and the last plane there is none: more than any path costs.
const NONE: u16 = u16::MAX / 2;

/// The cheapest way to each plane of a pixel, between two of [`NONE`].
#[derive(Clone, Copy)]
struct Path {
    costs: [u16; PLANES + 2],
    least: u16,
}

impl Path {
    const EMPTY: Self = Self {
        costs: [NONE; PLANES + 2],
        least: 0,
    };

    /// Goes on from a neighbour's path, if there is one, to a pixel with such costs.
    #[inline(always)]
    fn go_on(&mut self, from: Option<(&Self, u16)>, costs: &[u8], sums: &mut [u16]) {
        let own = &mut self.costs[1..=PLANES];
        match from {
            None => {
                for (own, &cost) in own.iter_mut().zip(costs) {
                    *own = u16::from(cost);
                }
            }
            Some((from, jump)) => {
                let farthest = from.least + jump;
                let (before, after) = (&from.costs[..PLANES], &from.costs[2..]);
                let around = before.iter().zip(&from.costs[1..]).zip(after);
                for ((own, &cost), ((before, at), after)) in own.iter_mut().zip(costs).zip(around) {
                    let best = (before.min(after) + STEP).min(*at).min(farthest);
                    // Less the least, so that costs do not grow along the path.
                    *own = u16::from(cost) + best - from.least;
                }
            }
        }
        let mut least = NONE;
        for (&own, sum) in own.iter().zip(sums) {
            least = least.min(own);
            *sum += own;
        }
        self.least = least;
    }
}

/// For each pixel the plane, with its fraction. `volume` is `[H, W, PLANES]`.
pub(super) fn planes(volume: &[u8], picture: &Picture) -> Vec<f32> {
    let mut sums = vec![0u16; volume.len()];
    for is_forward in [true, false] {
        Arch::new().dispatch(Paths {
            volume,
            picture,
            is_forward,
            sums: &mut sums,
        });
    }
    sums.chunks_exact(PLANES).map(cheapest).collect()
}

/// The paths of one way through the picture, compiled for every instruction set.
struct Paths<'a> {
    volume: &'a [u8],
    picture: &'a Picture,
    is_forward: bool,
    sums: &'a mut [u16],
}

impl WithSimd for Paths<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        add_paths(self.volume, self.picture, self.is_forward, self.sums);
    }
}

/// Adds the costs of the paths from the left and from the row above; or, backward, from the right and from below.
#[inline(always)]
fn add_paths(volume: &[u8], picture: &Picture, is_forward: bool, sums: &mut [u16]) {
    let (width, height) = (picture.camera.width, picture.camera.height);
    let last = width * height - 1;
    let index = |row: usize, column: usize| match is_forward {
        true => row * width + column,
        false => last - (row * width + column),
    };
    let mut before = vec![[Path::EMPTY; 3]; width];
    let mut now = before.clone();
    for row in 0..height {
        let mut along = Path::EMPTY;
        for (column, paths) in now.iter_mut().enumerate() {
            let pixel = index(row, column);
            let costs = &volume[pixel * PLANES..][..PLANES];
            let sums = &mut sums[pixel * PLANES..][..PLANES];
            let jump_from = |row, column| jump(picture, pixel, index(row, column));
            let source = along;
            let from = (column > 0).then(|| (&source, jump_from(row, column - 1)));
            along.go_on(from, costs, sums);
            for (direction, path) in paths.iter_mut().enumerate() {
                let from = (column + direction).checked_sub(1);
                let from = from.filter(|&from| row > 0 && from < width);
                let from = from.map(|from| (&before[from][direction], jump_from(row - 1, from)));
                path.go_on(from, costs, sums);
            }
        }
        std::mem::swap(&mut before, &mut now);
    }
}

/// What a step over several planes costs between two pixels.
#[inline(always)]
fn jump(picture: &Picture, a: usize, b: usize) -> u16 {
    let (a, b) = (picture.colors[a], picture.colors[b]);
    let difference = ((a[0] - b[0]).abs() + (a[1] - b[1]).abs() + (a[2] - b[2]).abs()) / 3.0;
    (JUMP[0] / (1.0 + difference / EDGE)).max(JUMP[1]) as u16
}

/// The plane of the least cost, the first of equals, with the fraction at which a parabola through its neighbours is
/// least.
fn cheapest(sums: &[u16]) -> f32 {
    let least = sums.iter().copied().min().unwrap_or(0);
    let plane = sums.iter().position(|&sum| sum == least).unwrap_or(0);
    if plane == 0 || plane + 1 == sums.len() {
        return plane as f32;
    }
    let [before, at, after] = [plane - 1, plane, plane + 1].map(|k| f32::from(sums[k]));
    let bend = before - 2.0 * at + after;
    match bend > 0.0 {
        true => plane as f32 + 0.5 * (before - after) / bend,
        false => plane as f32,
    }
}
