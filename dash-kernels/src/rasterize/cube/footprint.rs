//! The tiles that a splat overlaps. A unit owns one splat.

use cubecl::prelude::*;

use crate::cube::is_finite;
use crate::splats::{self, ALPHA_MIN, N_COLUMNS};

use super::super::tiles::TILE;

/// Rounding of sigma, as a part of its terms' magnitudes: a tile is kept when rounding might.
const SIGMA_ROUNDING: f32 = 1e-6;
/// The same of a needle, whose distances are off by thousandths of a pixel.
const NEEDLE_ROUNDING: f32 = 1e-2;
/// The same for the logarithm of the opacity.
const CUT_ROUNDING: f32 = 1e-4;

/// The size of an image as launched.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub(super) struct ImageSize {
    width: u32,
    height: u32,
    pub tile_columns: u32,
}

/// A splat's place in the image, as far as tiles are concerned.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Footprint {
    x: f32,
    y: f32,
    a: f32,
    b: f32,
    c: f32,
    /// Sigma beyond which alpha is under its minimum.
    cut: f32,
    /// Of a needle, see [`ALONG`](splats::ALONG); zeros of other splats.
    across_x: f32,
    across_y: f32,
    offset: f32,
    along: f32,
    /// Tiles touched by the box: first and one past the last.
    pub tile_x0: u32,
    pub tile_x1: u32,
    pub tile_y0: u32,
    pub tile_y1: u32,
}

/// The pixels' centres of a tile, from the first to the last.
#[derive(CubeType, Clone, Copy)]
struct Area {
    left: f32,
    top: f32,
    right: f32,
    bottom: f32,
}

/// Pixels of `0..size` whose centres (at +0.5) lie within `radius` of `centre`.
#[cube]
fn pixel_range(centre: f32, radius: f32, size: u32) -> (u32, u32) {
    let size = f32::cast_from(size);
    let from = f32::clamp((centre - radius - 0.5f32).ceil(), 0.0f32, size);
    let to = f32::clamp((centre + radius - 0.5f32).floor() + 1.0f32, 0.0f32, size);
    (u32::cast_from(from), u32::cast_from(to))
}

/// The footprint of a row; without tiles when nothing of it is drawn.
#[cube]
pub(super) fn footprint(
    splats: &[f32], // [N, C]
    row: usize,
    image: &ImageSize,
) -> Footprint {
    let at = row * N_COLUMNS;
    let mut finite = true;
    #[unroll]
    for column in 0..N_COLUMNS {
        finite = finite && is_finite(splats[at + column]);
    }
    let radius_x = splats[at + splats::RADIUS_X];
    let radius_y = splats[at + splats::RADIUS_Y];
    let opacity = splats[at + splats::OPACITY];
    let mut found = Footprint {
        x: splats[at + splats::MEAN_X],
        y: splats[at + splats::MEAN_Y],
        a: splats[at + splats::CONIC_A],
        b: splats[at + splats::CONIC_B],
        c: splats[at + splats::CONIC_C],
        cut: 0.0f32,
        across_x: splats[at + splats::ACROSS_X],
        across_y: splats[at + splats::ACROSS_Y],
        offset: splats[at + splats::ACROSS_OFFSET],
        along: splats[at + splats::ALONG],
        tile_x0: 0u32,
        tile_x1: 0u32,
        tile_y0: 0u32,
        tile_y1: 0u32,
    };
    let alpha_min = comptime!(ALPHA_MIN as f32);
    if finite && radius_x > 0.0f32 && radius_y > 0.0f32 && opacity >= alpha_min {
        let (x0, x1) = pixel_range(found.x, radius_x, image.width);
        let (y0, y1) = pixel_range(found.y, radius_y, image.height);
        if x0 < x1 && y0 < y1 {
            let tile = comptime!(TILE as u32);
            found.cut = (opacity / alpha_min).ln() + CUT_ROUNDING;
            found.tile_x0 = x0 / tile;
            found.tile_x1 = x1.div_ceil(tile);
            found.tile_y0 = y0 / tile;
            found.tile_y1 = y1.div_ceil(tile);
        }
    }
    found
}

/// Sigma at the offset, and how far it may be off.
#[cube]
fn sigma(splat: &Footprint, dx: f32, dy: f32) -> (f32, f32) {
    let squares = 0.5f32 * (splat.a * dx * dx + splat.c * dy * dy);
    let mixed = splat.b * dx * dy;
    (squares + mixed, (squares + mixed.abs()) * SIGMA_ROUNDING)
}

/// Whether the splat reaches any pixel's centre of the tile: the smallest sigma over the rectangle
/// of these is that of the centre or lies on an edge that faces it.
#[cube]
pub(super) fn overlaps(splat: &Footprint, tile_x: u32, tile_y: u32, image: &ImageSize) -> bool {
    let size = comptime!(TILE as f32);
    let left = f32::cast_from(tile_x) * size + 0.5f32;
    let top = f32::cast_from(tile_y) * size + 0.5f32;
    let right = f32::min(left + (size - 1.0f32), f32::cast_from(image.width) - 0.5f32);
    let bottom = f32::min(top + (size - 1.0f32), f32::cast_from(image.height) - 0.5f32);
    let area = Area {
        left,
        top,
        right,
        bottom,
    };
    let x = f32::clamp(splat.x, left, right);
    let y = f32::clamp(splat.y, top, bottom);
    let mut reached = x == splat.x && y == splat.y;
    // Not an ellipse: nothing is known of where it ends.
    if !(splat.a > 0.0f32 && splat.c > 0.0f32 && splat.a * splat.c > splat.b * splat.b) {
        reached = true;
    }
    if splat.along > 0.0f32 {
        reached = needle_reaches(splat, &area);
    } else {
        reached = reached || conic_reaches(splat, &area);
    }
    reached
}

/// The same of a needle: no more than where the smallest distances across and along reach.
#[cube]
fn needle_reaches(splat: &Footprint, area: &Area) -> bool {
    let (half_x, half_y) = (
        0.5f32 * (area.right - area.left),
        0.5f32 * (area.bottom - area.top),
    );
    let (x, y) = (area.left + half_x, area.top + half_y);
    let (nx, ny) = (splat.across_x, splat.across_y);
    let w = (nx * x + ny * y - splat.offset).abs() - (nx.abs() * half_x + ny.abs() * half_y);
    let z =
        (nx * (splat.y - y) - ny * (splat.x - x)).abs() - (ny.abs() * half_x + nx.abs() * half_y);
    let (w, z) = (f32::max(w, 0.0f32), f32::max(z, 0.0f32));
    let across = splat.a + splat.c - splat.along;
    let sigma = 0.5f32 * (across * w * w + splat.along * z * z);
    sigma * (1.0f32 - NEEDLE_ROUNDING) <= splat.cut
}

/// The same of an ordinary splat, whose smallest sigma lies on an edge.
#[cube]
fn conic_reaches(splat: &Footprint, area: &Area) -> bool {
    let x = f32::clamp(splat.x, area.left, area.right);
    let y = f32::clamp(splat.y, area.top, area.bottom);
    let mut reached = false;
    if x != splat.x {
        let dx = splat.x - x;
        let best = f32::clamp(splat.y + splat.b / splat.c * dx, area.top, area.bottom);
        let (value, rounding) = sigma(splat, dx, splat.y - best);
        reached = reached || value - rounding <= splat.cut;
    }
    if y != splat.y {
        let dy = splat.y - y;
        let best = f32::clamp(splat.x + splat.b / splat.a * dy, area.left, area.right);
        let (value, rounding) = sigma(splat, splat.x - best, dy);
        reached = reached || value - rounding <= splat.cut;
    }
    reached
}
