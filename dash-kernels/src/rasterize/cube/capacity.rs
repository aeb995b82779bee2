//! How many intersections the lists of the next frame have room for.
//!
//! The number that a frame needs is read back without waiting for it; frames drawn until it
//! arrives still use the capacity of before.

use std::collections::HashMap;
use std::future::Future;
use std::pin::Pin;
use std::sync::{LazyLock, Mutex};
use std::task::{Context, Poll, Waker};

use burn::tensor::try_read_sync;
use cubecl::prelude::*;
use cubecl::server::Handle;

use crate::cube::Buffer;
use crate::determinism::is_deterministic;

/// Room before anything is known: per splat, and at least.
const FIRST_PER_SPLAT: usize = 8;
const FIRST: usize = 1 << 16;
/// Room kept beyond what was needed last, in eighths of it.
const SPARE_EIGHTHS: usize = 2;
/// Bytes of the largest buffer per intersection: a gradient of each differentiable column.
const BYTES_PER_INTERSECTION: u64 = (crate::splats::N_DIFFERENTIABLE * 4) as u64;
/// Frames between two readings once the first few have been read.
const READ_EVERY: u64 = 16;

type Reading = Pin<Box<dyn Future<Output = Option<usize>> + Send>>;

#[derive(Default)]
struct State {
    frames: u64,
    needed: usize,
    reading: Option<Reading>,
}

static STATES: LazyLock<Mutex<HashMap<String, State>>> = LazyLock::new(Mutex::default);

/// The capacity for a frame of `n` splats whose number of intersections stands at the end of
/// `starts [n + 1]`.
pub(super) fn next(client: &Client, starts: &Buffer, n: usize) -> usize {
    if is_deterministic() {
        // The slow way adds gradients in any order.
        let total = try_read_sync(first_word(client.clone(), total_handle(starts, n)));
        return fitting(client, total.flatten().unwrap_or(1).max(1));
    }
    let mut states = STATES
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner());
    let state = states
        .entry(format!("{:?}", client.service_id()))
        .or_default();
    state.frames += 1;
    if let Some(Poll::Ready(total)) = state.reading.as_mut().map(poll) {
        state.reading = None;
        state.needed = total
            .unwrap_or(state.needed)
            .max(state.needed - state.needed / 8);
    }
    if state.reading.is_none()
        && (state.frames.is_power_of_two() || state.frames.is_multiple_of(READ_EVERY))
    {
        let mut reading: Reading = Box::pin(first_word(client.clone(), total_handle(starts, n)));
        // The first poll sends the request off.
        if let Poll::Ready(total) = poll(&mut reading) {
            state.needed = total.unwrap_or(state.needed);
        } else {
            state.reading = Some(reading);
        }
    }
    let wanted = state.needed + state.needed * SPARE_EIGHTHS / 8;
    fitting(client, wanted.max(FIRST).max(FIRST_PER_SPLAT * n))
}

/// A capacity of at least `wanted`, in steps so that memory is used again, as far as the device's
/// largest buffer allows.
fn fitting(client: &Client, wanted: usize) -> usize {
    let most = client.properties().memory.max_page_size / BYTES_PER_INTERSECTION;
    wanted.next_multiple_of(FIRST).min(most as usize)
}

/// Asks a future how far it is.
fn poll(reading: &mut Reading) -> Poll<Option<usize>> {
    reading
        .as_mut()
        .poll(&mut Context::from_waker(Waker::noop()))
}

/// The number at the end of `starts [n + 1]`.
fn total_handle(starts: &Buffer, n: usize) -> Handle {
    starts.handle().offset_start((n * size_of::<u32>()) as u64)
}

/// The number that the handle begins with; none when the device failed.
async fn first_word(client: Client, handle: Handle) -> Option<usize> {
    let bytes = client.read_async(vec![handle]).await.ok()?;
    let words: &[u32] = bytemuck::cast_slice(&bytes[0]);
    words.first().map(|&total| total as usize)
}
