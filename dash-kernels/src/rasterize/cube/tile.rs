//! What a cube reads while it blends a tile, forward and backward: the frame, the tile's list, its splats.

use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::splats::{self, ALPHA_MIN, EXPONENT_ROUNDING, N_COLUMNS};

use super::super::RasterizeOptions;
use super::super::tiles::TILE;
use super::intersect::Intersections;

/// The numbers of a frame.
pub(super) fn frame(
    lists: &Intersections,
    options: &RasterizeOptions,
    splats: &CubeTensor,
) -> FrameLaunch {
    let [red, green, blue] = options.background;
    FrameLaunch::new(
        options.width as u32,
        options.height as u32,
        lists.tiles[0] as u32,
        lists.tiles[1] as u32,
        splats.meta.shape()[0] as u32,
        lists.capacity as u32,
        red,
        green,
        blue,
    )
}

/// The numbers of a frame as launched.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub(super) struct Frame {
    pub width: u32,
    pub height: u32,
    pub tile_columns: u32,
    pub tile_rows: u32,
    pub n_splats: u32,
    pub capacity: u32,
    /// Background.
    pub red: f32,
    pub green: f32,
    pub blue: f32,
}

/// An [`Intersections`] as launched, as far as a picture needs it: browsers bind no more than eight buffers to a kernel.
#[derive(CubeType, CubeLaunch)]
pub(super) struct Lists {
    pub order: Box<[u32]>,   // [N]
    tile_counts: Box<[u32]>, // [N]
    rows: Box<[u32]>,        // [capacity]
    ranges: Box<[u32]>,      // [2 n_tiles + 1]
}

pub(super) fn lists_arg(lists: &Intersections) -> ListsLaunch {
    ListsLaunch::new(
        lists.order.arg(),
        lists.tile_counts.arg(),
        lists.rows.arg(),
        lists.ranges.arg(),
    )
}

/// A tile's list: its own, or all splats where the lists overflowed.
#[derive(CubeType, Clone, Copy)]
pub(super) struct TileList {
    pub overflowed: bool,
    pub start: usize,
    pub end: usize,
}

#[cube]
pub(super) fn tile_list(tile: usize, lists: &Lists, frame: &Frame) -> TileList {
    let n_tiles = (frame.tile_columns * frame.tile_rows) as usize;
    let mut list = TileList {
        overflowed: lists.ranges[2 * n_tiles] > frame.capacity,
        start: 0usize,
        end: frame.n_splats as usize,
    };
    if !list.overflowed {
        list.start = lists.ranges[2 * tile] as usize;
        list.end = lists.ranges[2 * tile + 1] as usize;
    }
    list
}

/// What blending reads of a splat; nothing is drawn where the opacity is zero.
#[derive(CubeType, Clone, Copy)]
pub(super) struct Splat {
    pub x: f32,
    pub y: f32,
    /// The conic; `a` and `b` of a needle are the unit vector across.
    pub a: f32,
    pub b: f32,
    pub c: f32,
    pub opacity: f32,
    pub red: f32,
    pub green: f32,
    pub blue: f32,
    pub depth: f32,
    /// Inverse variances across and along; zero along of other splats.
    pub across: f32,
    pub along: f32,
    /// Distance of a needle's centre along its axis.
    pub far: f32,
}

/// The splat at a place of a tile's list. The place of a needle is the point of its axis next to the tile's middle, from
/// there: all distances are small.
#[cube]
pub(super) fn read_splat(
    splats: &[f32], // [N, C]
    place: usize,
    list: &TileList,
    lists: &Lists,
    middle: (f32, f32),
) -> Splat {
    let row = if list.overflowed {
        lists.order[place] as usize
    } else {
        lists.rows[place] as usize
    };
    let at = row * N_COLUMNS;
    let mut splat = Splat {
        x: splats[at + splats::MEAN_X],
        y: splats[at + splats::MEAN_Y],
        a: splats[at + splats::CONIC_A],
        b: splats[at + splats::CONIC_B],
        c: splats[at + splats::CONIC_C],
        opacity: splats[at + splats::OPACITY],
        red: splats[at + splats::RED],
        green: splats[at + splats::GREEN],
        blue: splats[at + splats::BLUE],
        depth: splats[at + splats::DEPTH],
        across: 0.0f32,
        along: splats[at + splats::ALONG],
        far: 0.0f32,
    };
    if splat.along > 0.0f32 {
        let (nx, ny) = (splats[at + splats::ACROSS_X], splats[at + splats::ACROSS_Y]);
        let (mid_x, mid_y) = middle;
        let distance = splats[at + splats::ACROSS_OFFSET] - (nx * mid_x + ny * mid_y);
        splat.far = nx * (splat.y - mid_y) - ny * (splat.x - mid_x);
        splat.across = splat.a + splat.c - splat.along;
        splat.x = distance * nx;
        splat.y = distance * ny;
        splat.a = nx;
        splat.b = ny;
    }
    // A row that draws nothing may hold anything.
    if list.overflowed && lists.tile_counts[row] == 0u32 {
        splat.opacity = 0.0f32;
    }
    splat
}

/// Distances of a needle's centre across and along from the pixel at this offset from its place.
#[cube]
pub(super) fn across_along(splat: &Splat, dx: f32, dy: f32) -> (f32, f32) {
    let along = splat.a * dy - splat.b * dx;
    (splat.a * dx + splat.b * dy, along + splat.far)
}

/// Alpha before it is clamped, zero where the splat is skipped.
#[cube]
pub(super) fn alpha_at(splat: &Splat, dx: f32, dy: f32, #[comptime] is_needle: bool) -> f32 {
    let sigma = if comptime!(is_needle) {
        let (w, z) = across_along(splat, dx, dy);
        0.5f32 * (splat.across * w * w + splat.along * z * z)
    } else {
        0.5f32 * (splat.a * dx * dx + splat.c * dy * dy) + splat.b * dx * dy
    };
    let alpha = splat.opacity * (-sigma).exp();
    let drawn = sigma >= -EXPONENT_ROUNDING && alpha >= comptime!(ALPHA_MIN as f32);
    select(drawn, alpha, 0.0f32)
}

/// The column that the gradient of the column `value` is written to: a needle's shape has columns of its own.
#[cube]
pub(super) fn gradient_column(value: usize, is_needle: bool) -> usize {
    let is_shape = value == splats::CONIC_A || value == splats::CONIC_B || value == splats::CONIC_C;
    let moved = value + comptime!(splats::ACROSS_X - splats::CONIC_A);
    select(is_shape && is_needle, moved, value)
}

/// The middle of a tile.
#[cube]
pub(super) fn middle(tile: usize, frame: &Frame) -> (f32, f32) {
    let side = comptime!(TILE as f32);
    let tile = tile as u32;
    let column = f32::cast_from(tile % frame.tile_columns);
    let row = f32::cast_from(tile / frame.tile_columns);
    ((column + 0.5f32) * side, (row + 0.5f32) * side)
}

/// The first pixel of this unit: column and row.
#[cube]
pub(super) fn first_pixel(tile: usize, frame: &Frame, #[comptime] per_unit: usize) -> (u32, u32) {
    let side = comptime!(TILE as u32);
    let tile = tile as u32;
    let column = tile % frame.tile_columns * side + UNIT_POS % side;
    let row = tile / frame.tile_columns * side + UNIT_POS / side * comptime!(per_unit as u32);
    (column, row)
}
