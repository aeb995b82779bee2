//! How well other views agree with a view on its planes.

use glam::{DMat3, DVec3};
use pulp::{Arch, Simd, WithSimd};

use super::{PLANES, Picture, Planes, transfer};

/// Radius of the windows that are correlated, pixels.
const RADIUS: usize = 2;
/// Side of such a window.
const SIDE: usize = 2 * RADIUS + 1;
/// Variance of a window that is taken for noise: two steps of 255, squared.
pub(super) const NOISE: f32 = 5e-5;
/// Share of the windows' correlation; the rest is what colours differ by.
pub(super) const CORRELATION: f32 = 0.7;
/// Mean colour difference from which on a larger one costs no more.
pub(super) const MOST_DIFFERENCE: f32 = 0.12;
/// Cost where no view has a plane in sight: what windows cost that have nothing in common.
pub(super) const UNSEEN: f32 = 0.5;

/// What the nearest plane costs more than the farthest, of 255: where nothing tells planes apart, the farthest hides
/// nothing. Without it, what is dark takes the depth of what stands before it. A transparent background needs no such cost.
pub(super) const NEARNESS: f32 = 30.0;

/// For each pixel the cost of each plane `[H, W, PLANES]`, of 255: the mean over the half of the views that agree best,
/// of at most six, since the others may have something in front.
pub(super) fn volume(picture: &Picture, others: &[&Picture], planes: Planes) -> Vec<u8> {
    let n = picture.colors.len();
    let mut volume = vec![0; n * PLANES];
    let transfers: Vec<_> = others
        .iter()
        .map(|other| transfer(&picture.camera, &other.camera))
        .collect();
    let nearness = match picture.is_cut_out {
        true => 0.0,
        false => NEARNESS,
    };
    let mut correlator = Correlator::of(picture);
    let mut best = Vec::new();
    for plane in 0..PLANES {
        let inverse = planes.inverse(plane as f64);
        best.clear();
        best.resize(n, Best::NONE);
        for (other, (matrix, shift)) in others.iter().zip(&transfers) {
            Arch::new().dispatch(Comparison {
                correlator: &mut correlator,
                picture,
                other,
                transfer: (*matrix, *shift * inverse),
                best: &mut best,
            });
        }
        let nearer = nearness * plane as f32 / PLANES as f32;
        let of_plane = volume.iter_mut().skip(plane).step_by(PLANES);
        for (out, best) in of_plane.zip(&best) {
            *out = (best.mean().clamp(0.0, 1.0) * 255.0 + nearer).min(255.0) as u8;
        }
    }
    volume
}

/// One view compared on one plane, compiled for every instruction set: a closure would not be inlined into their code.
struct Comparison<'a> {
    correlator: &'a mut Correlator,
    picture: &'a Picture,
    other: &'a Picture,
    transfer: (DMat3, DVec3),
    best: &'a mut [Best],
}

impl WithSimd for Comparison<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let (picture, other) = (self.picture, self.other);
        self.correlator
            .add(picture, other, self.transfer, self.best);
    }
}

/// The three lowest of some costs, and how many there are.
#[derive(Clone, Copy)]
struct Best {
    lowest: [f32; 3],
    seen: f32,
}

impl Best {
    const NONE: Self = Self {
        lowest: [f32::INFINITY; 3],
        seen: 0.0,
    };

    /// Adds one, unless it is infinite.
    #[inline(always)]
    fn add(&mut self, cost: f32) {
        let [first, second, third] = self.lowest;
        let beside_first = cost.max(first);
        let beside_second = beside_first.max(second);
        self.lowest = [
            cost.min(first),
            beside_first.min(second),
            beside_second.min(third),
        ];
        self.seen += if cost < f32::INFINITY { 1.0 } else { 0.0 };
    }

    /// Of the lower half.
    fn mean(&self) -> f32 {
        let [first, second, third] = self.lowest;
        match self.seen as u32 {
            0 => UNSEEN,
            1 | 2 => first,
            3 | 4 => (first + second) / 2.0,
            _ => (first + second + third) / 3.0,
        }
    }
}

/// Compares a picture with what others show.
struct Correlator {
    /// Luma of each pixel of the picture, its mean around it and its variance there.
    luma: Vec<f32>,
    means: Vec<f32>,
    variances: Vec<f32>,
    /// What another picture shows at each pixel.
    warped: Vec<[f32; 4]>,
    /// Means around each pixel of the other's luma, of its square, of its product with the picture's.
    sums: [Vec<f32>; 3],
    /// A buffer of [`box_means`].
    rows: Vec<f32>,
}

impl Correlator {
    fn of(picture: &Picture) -> Self {
        let width = picture.camera.width;
        let luma: Vec<f32> = picture.colors.iter().map(|color| color[3]).collect();
        let n = luma.len();
        let mut rows = vec![0.0; n];
        let mut means = luma.clone();
        box_means(&mut means, &mut rows, width);
        let mut squares: Vec<f32> = luma.iter().map(|v| v * v).collect();
        box_means(&mut squares, &mut rows, width);
        let variances = squares.iter().zip(&means);
        Self {
            variances: variances.map(|(s, m)| (s - m * m).max(0.0)).collect(),
            means,
            warped: vec![[f32::NAN; 4]; n],
            sums: std::array::from_fn(|_| vec![0.0; n]),
            luma,
            rows,
        }
    }

    /// Adds each pixel's cost by what another view shows around it, if all pixels lie on a plane; infinite where that
    /// is not in sight.
    #[inline(always)]
    fn add(
        &mut self,
        picture: &Picture,
        other: &Picture,
        transfer: (DMat3, DVec3),
        best: &mut [Best],
    ) {
        let width = picture.camera.width;
        warp(other, transfer, width, &mut self.warped);
        let [means, squares, products] = &mut self.sums;
        let lumas = self.luma.iter().zip(&self.warped);
        let sums = means.iter_mut().zip(&mut *squares).zip(&mut *products);
        for ((own, color), ((mean, square), product)) in lumas.zip(sums) {
            // What is not in sight correlates with nothing.
            let luma = if color[3].is_nan() { 0.0 } else { color[3] };
            (*mean, *square, *product) = (luma, luma * luma, luma * own);
        }
        for sums in [&mut *means, squares, products] {
            box_means(sums, &mut self.rows, width);
        }
        let own = self.means.iter().zip(&self.variances);
        let others = means.iter().zip(&*squares).zip(&*products);
        let colors = picture.colors.iter().zip(&self.warped);
        for (((best, own), ((mean, square), product)), (a, b)) in
            best.iter_mut().zip(own).zip(others).zip(colors)
        {
            let covariance = product - own.0 * mean;
            let variance = (square - mean * mean).max(0.0);
            let correlation = covariance / ((own.1 + NOISE) * (variance + NOISE)).sqrt();
            let difference = (a[0] - b[0]).abs() + (a[1] - b[1]).abs() + (a[2] - b[2]).abs();
            let difference = (difference * (1.0 / (3.0 * MOST_DIFFERENCE))).min(1.0);
            let cost = CORRELATION * 0.5 * (1.0 - correlation) + (1.0 - CORRELATION) * difference;
            best.add(if b[3].is_nan() { f32::INFINITY } else { cost });
        }
    }
}

/// What another view shows at each pixel if all of them lie on a plane; NaN where it has that not in sight.
#[inline(always)]
fn warp(other: &Picture, (matrix, shift): (DMat3, DVec3), width: usize, warped: &mut [[f32; 4]]) {
    let size = [other.camera.width, other.camera.height];
    let [right, below] = size.map(|side| side as f32 - 0.5);
    let step = matrix.x_axis.as_vec3();
    let mut places = vec![[0.0f32; 2]; width];
    for (y, row) in warped.chunks_exact_mut(width).enumerate() {
        let first = (matrix * DVec3::new(0.5, y as f64 + 0.5, 1.0) + shift).as_vec3();
        for (x, place) in places.iter_mut().enumerate() {
            let x = x as f32;
            let depth = first.z + step.z * x;
            let u = (first.x + step.x * x) / depth - 0.5;
            let v = (first.y + step.y * x) / depth - 0.5;
            *place = [if depth > 0.0 { u } else { f32::NAN }, v];
        }
        for (&[u, v], out) in places.iter().zip(row) {
            let is_inside = u > -0.5 && v > -0.5 && u < right && v < below;
            *out = match is_inside {
                true => bilinear(&other.colors, size, [u, v]),
                false => [f32::NAN; 4],
            };
        }
    }
}

/// The colour at a place between pixel centres, within half a pixel of the picture.
#[inline(always)]
fn bilinear(colors: &[[f32; 4]], [width, height]: [usize; 2], [u, v]: [f32; 2]) -> [f32; 4] {
    let (u, v) = (u.max(0.0), v.max(0.0));
    let x = (u as usize).min(width - 1);
    let y = (v as usize).min(height - 1);
    let (a, b) = (u - x as f32, v - y as f32);
    let top = &colors[y * width..][..width];
    let bottom = &colors[(y + 1).min(height - 1) * width..][..width];
    let right = (x + 1).min(width - 1);
    std::array::from_fn(|c| {
        let top = top[x][c] + a * (top[right][c] - top[x][c]);
        let bottom = bottom[x][c] + a * (bottom[right][c] - bottom[x][c]);
        top + b * (bottom - top)
    })
}

/// The mean around each pixel; pixels at the border stand for those beyond it.
#[inline(always)]
fn box_means(values: &mut [f32], rows: &mut [f32], width: usize) {
    let height = values.len() / width;
    let mut padded = vec![0.0; width + 2 * RADIUS];
    for (row, out) in values.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        padded[..RADIUS].fill(row[0]);
        padded[RADIUS..RADIUS + width].copy_from_slice(row);
        padded[RADIUS + width..].fill(row[width - 1]);
        sum_of(std::array::from_fn(|k| &padded[k..k + width]), out, 1.0);
    }
    let scale = 1.0 / (SIDE * SIDE) as f32;
    for (y, out) in values.chunks_exact_mut(width).enumerate() {
        let row = |k: usize| {
            let row = (y + k).saturating_sub(RADIUS).min(height - 1);
            &rows[row * width..][..width]
        };
        sum_of(std::array::from_fn(row), out, scale);
    }
}

/// The sum of rows of a window, scaled.
#[inline(always)]
fn sum_of([a, b, c, d, e]: [&[f32]; SIDE], out: &mut [f32], scale: f32) {
    let rows = a.iter().zip(b).zip(c).zip(d).zip(e);
    for (out, ((((a, b), c), d), e)) in out.iter_mut().zip(rows) {
        *out = (a + b + c + d + e) * scale;
    }
}
