//! How many intersections the lists of the next frame have room for.
//!
//! The number that a frame needs is read back without waiting for it; frames drawn until it
//! arrives still use the capacity of before.

use std::collections::HashMap;
use std::future::Future;
use std::pin::Pin;
use std::sync::{LazyLock, Mutex};
use std::task::{Context, Poll, Waker};

use cubecl::prelude::*;

use crate::cube::Buffer;

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
    let mut states = STATES.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let state = states.entry(format!("{:?}", client.service_id())).or_default();
    state.frames += 1;
    if let Some(reading) = &mut state.reading {
        if let Poll::Ready(total) = reading.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            state.reading = None;
            state.needed = total.unwrap_or(state.needed).max(state.needed - state.needed / 8);
        }
    }
    if state.reading.is_none()
        && (state.frames.is_power_of_two() || state.frames % READ_EVERY == 0)
    {
        let (client, handle) = (client.clone(), starts.handle());
        state.reading = Some(Box::pin(async move {
            let bytes = client.read_async(vec![handle]).await.ok()?;
            let words: &[u32] = bytemuck::cast_slice(&bytes[0]);
            words.get(n).map(|&total| total as usize)
        }));
    }
    let wanted = state.needed + state.needed * SPARE_EIGHTHS / 8;
    let wanted = wanted.max(FIRST).max(FIRST_PER_SPLAT * n).next_multiple_of(FIRST);
    let most = client.properties().memory.max_page_size / BYTES_PER_INTERSECTION;
    wanted.min(most as usize)
}
