//! Gradients of (tile, splat) intersections, one slot each, and their sums for each splat. No shared memory, no atomics.

use burn_cubecl::tensor::CubeTensor;
use cubecl::prelude::*;

use crate::cube::{Buffer, arg, is_finite, units};
use crate::splats::{self, N_COLUMNS, N_DIFFERENTIABLE};

use super::Saved;
use super::tile::{TileList, gradient_column};

/// The slots whose gradients are held at a time.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub(super) struct Window {
    pub first: u32,
    pub length: u32,
    is_last: u32,
}

/// Adds up each splat's slots of a window.
pub(super) fn sum_window(
    saved: &Saved,
    v_splats: &CubeTensor,
    v_slots: &Buffer,
    window: WindowLaunch,
) {
    let client = &v_splats.client;
    let lists = &saved.intersections;
    let n = saved.splats.meta.shape()[0];
    let (count, dim) = units(client, n);
    sum_slots::launch(
        client,
        count,
        dim,
        arg(&saved.splats),
        v_slots.arg(),
        lists.order.arg(),
        lists.starts.arg(),
        arg(v_splats),
        window,
        n as u32,
        lists.capacity as u32,
    );
}

/// Clears the slots of the splats behind all pixels, which are read all the same.
#[cube]
pub(super) fn clear_slots(
    v_slots: &mut [f32], // [slots per window, N_DIFFERENTIABLE]
    list: &TileList,
    slots: &[u32], // [capacity]
    end: usize,
    window: &Window,
) {
    let value = UNIT_POS as usize;
    if !list.overflowed && value < N_DIFFERENTIABLE {
        let mut place = usize::max(end, list.start);
        while place < list.end {
            // Wraps around for slots before the window.
            let slot = slots[place] - window.first;
            if slot < window.length {
                v_slots[slot as usize * N_DIFFERENTIABLE + value] = 0.0f32;
            }
            place += 1;
        }
    }
}

/// A unit owns one splat, by its place in the drawing order. A gradient with a value that is not finite, of colours or depths near the
/// largest number there is, counts as zero.
#[cube(launch)]
fn sum_slots(
    splats: &[f32],       // [N, C]
    v_slots: &[f32],      // [slots per window, N_DIFFERENTIABLE]
    order: &[u32],        // [N]
    starts: &[u32],       // [N + 1]
    v_splats: &mut [f32], // [N, C]
    window: Window,
    n: u32,
    capacity: u32,
) {
    let place = ABSOLUTE_POS;
    if place < n as usize {
        let at = order[place] as usize * N_COLUMNS;
        let is_needle = splats[at + splats::ALONG] > 0.0f32;
        let mut sums = Array::<f32>::new(N_DIFFERENTIABLE);
        #[unroll]
        for value in 0..N_DIFFERENTIABLE {
            // What earlier windows, or the cubes of overflowed lists, have added up.
            sums[value] = v_splats[at + gradient_column(value, is_needle)];
        }
        if starts[n as usize] <= capacity {
            let window_end = window.first + window.length;
            let from = u32::clamp(starts[place], window.first, window_end);
            let to = u32::clamp(starts[place + 1], window.first, window_end);
            for slot in from - window.first..to - window.first {
                #[unroll]
                for value in 0..N_DIFFERENTIABLE {
                    sums[value] += v_slots[slot as usize * N_DIFFERENTIABLE + value];
                }
            }
        }
        let mut finite = true;
        #[unroll]
        for value in 0..N_DIFFERENTIABLE {
            finite = finite && is_finite(sums[value]);
        }
        #[unroll]
        for value in 0..N_DIFFERENTIABLE {
            let kept = finite || window.is_last == 0u32;
            let column = gradient_column(value, is_needle);
            v_splats[at + column] = select(kept, sums[value], 0.0f32);
        }
    }
}
