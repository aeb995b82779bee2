//! How many intersections the lists of the next frame have room for.
//!
//! The number that a frame needs is read back by a thread that waits for it, so that drawing does
//! not; frames drawn until it arrives still use the capacity of before.

use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard};

use burn::tensor::try_read_sync;
use cubecl::prelude::*;
use cubecl::server::Handle;

use crate::cube::Buffer;
use crate::determinism::is_deterministic;
use crate::splats::N_DIFFERENTIABLE;

/// Room before anything is known: per splat, and at least.
const FIRST_PER_SPLAT: usize = 8;
const FIRST: usize = 1 << 16;
/// Room kept beyond what was needed last, in eighths of it.
const SPARE_EIGHTHS: usize = 2;
/// Part of the room that a frame which needs less gives back: pictures of several layers are drawn
/// in turns.
const DECAY: usize = 64;
/// Bytes of the largest buffer per intersection: a gradient of each differentiable column.
const BYTES_PER_INTERSECTION: u64 = (N_DIFFERENTIABLE * size_of::<f32>()) as u64;

/// What frames of one size need on a device.
#[derive(Debug, Clone, Copy, Default)]
struct Need {
    intersections: usize,
    /// Whether a thread waits for a number.
    reading: bool,
}

type Needs = HashMap<(String, [usize; 2]), Arc<Mutex<Need>>>;

static NEEDS: LazyLock<Mutex<Needs>> = LazyLock::new(Mutex::default);

/// The capacity for a frame of `n` splats on `tiles`, whose number of intersections stands at the
/// end of `starts [n + 1]`.
pub(super) fn next(client: &Client, starts: &Buffer, n: usize, tiles: [usize; 2]) -> usize {
    let total = starts.handle().offset_start((n * size_of::<u32>()) as u64);
    if is_deterministic() {
        // The slow way adds gradients in any order.
        return fitting(client, read(client, total).unwrap_or(1).max(1));
    }
    let key = (format!("{:?}", client.service_id()), tiles);
    let need = lock(&NEEDS).entry(key).or_default().clone();
    let mut now = lock(&need);
    if !now.reading {
        now.reading = true;
        let (client, need) = (client.clone(), need.clone());
        std::thread::spawn(move || {
            let read = read(&client, total);
            let mut now = lock(&need);
            now.reading = false;
            let kept = now.intersections - now.intersections / DECAY;
            now.intersections = read.unwrap_or(0).max(kept);
        });
    }
    let wanted = now.intersections + now.intersections / 8 * SPARE_EIGHTHS;
    fitting(client, wanted.max(FIRST).max(FIRST_PER_SPLAT * n))
}

/// What a panic elsewhere leaves is as good as before: every state is a whole one.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// A capacity of at least `wanted`, in steps so that memory is used again, as far as the device's
/// largest buffer and 32-bit indices allow.
fn fitting(client: &Client, wanted: usize) -> usize {
    let most = client.properties().memory.max_page_size / BYTES_PER_INTERSECTION;
    let most = most.min(u64::from(u32::MAX) / N_DIFFERENTIABLE as u64);
    wanted.next_multiple_of(FIRST).min(most as usize)
}

/// The number that the memory begins with, waited for; none when the device failed.
fn read(client: &Client, memory: Handle) -> Option<usize> {
    let bytes = try_read_sync(client.read_async(vec![memory]))?.ok()?;
    let words: &[u32] = bytemuck::cast_slice(&bytes[0]);
    words.first().map(|&total| total as usize)
}
