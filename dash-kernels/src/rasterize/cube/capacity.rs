//! Capacity of a frame's lists of intersections.
//!
//! Each frame starts to read back the number of intersections it needs; the next frame takes the number if it has
//! arrived, and does not wait for it. CUDA can't tell whether a reading has arrived: there the next frame waits for the
//! number, which was sent before the previous frame was blended. On wgpu a reading that nobody takes keeps a thread in
//! the driver, and a program that ends meanwhile may crash there, so a thread of this module takes every reading. The
//! first frame of a size waits for its own number; in a browser nothing can wait, and it takes a guess.

use std::collections::HashMap;
use std::future::poll_fn;
use std::pin::Pin;
#[cfg(not(target_family = "wasm"))]
use std::sync::mpsc::{Sender, channel};
use std::sync::{LazyLock, Mutex, MutexGuard};
use std::task::{Context, Poll, Waker};
#[cfg(not(target_family = "wasm"))]
use std::thread;

use burn::tensor::try_read_sync;
use cubecl::prelude::*;
use cubecl::server::Handle;

use crate::cube::{Buffer, largest_buffer};
use crate::determinism::is_deterministic;
use crate::splats::N_DIFFERENTIABLE;

/// Capacity before a reading arrives: per splat, and at least.
const FIRST_PER_SPLAT: usize = 8;
const FIRST: usize = 1 << 16;
/// Capacity where nothing is known and nothing can wait: per splat, and at least. A list that is too short costs far more
/// than one that is too long.
const GUESS_PER_SPLAT: usize = 16;
const GUESS: usize = 1 << 20;
/// Spare capacity beyond the last need, in eighths of it.
const SPARE_EIGHTHS: usize = 2;
/// A frame that needs less gives back this fraction of the capacity, and no more: frames of several layers and cameras
/// alternate.
const DECAY: usize = 4096;
/// Bytes of an intersection in the backward pass: its key, slot and rows, their sorted copies, and a value of each
/// differentiable column.
const BYTES: u64 = 4 * (7 + N_DIFFERENTIABLE as u64);

/// Need of frames of one size on a device.
#[derive(Default)]
struct Need {
    /// `None` before the first reading arrived.
    intersections: Option<usize>,
    /// A reading that has not arrived.
    reading: Option<Reading>,
    /// Whether the thread of [`wait_apart`] has a reading.
    is_awaited: bool,
    /// Whether a warning was given that the device's lists are too small.
    warned: bool,
}

type Reading = Pin<Box<dyn Future<Output = Option<usize>> + Send>>;

type Key = (String, [usize; 2]);
type Needs = HashMap<Key, Need>;

static NEEDS: LazyLock<Mutex<Needs>> = LazyLock::new(Mutex::default);

/// The capacity for a frame of `n` splats on `tiles`, whose number of intersections stands at the
/// end of `starts [n + 1]`.
pub(super) fn next(client: &Client, starts: &Buffer, n: usize, tiles: [usize; 2]) -> usize {
    let total = starts.handle().offset_start((n * size_of::<u32>()) as u64);
    let most = most(client);
    if is_deterministic() {
        // Overflowed lists add gradients in any order.
        let needed = try_read_sync(send_for(client, total)).flatten();
        let needed = needed.unwrap_or(1).max(1);
        if needed > most {
            warn_of_slow_drawing(needed, most);
        }
        return fitting(needed, most);
    }
    let device = format!("{:?}", client.service_id());
    let mut needs = lock(&NEEDS);
    // Of all sizes: the next frame of another size may never come.
    for (_, need) in needs.iter_mut().filter(|(key, _)| key.0 == device) {
        need.take_what_arrived(most);
    }
    let key = (device, tiles);
    let is_first = !needs.contains_key(&key);
    let need = needs.entry(key.clone()).or_default();
    // A browser may not forget a reading on its way, and can't wait for it.
    let may_wait = is_first && !cfg!(target_family = "wasm");
    if may_wait && let Some(needed) = try_read_sync(send_for(client, total.clone())) {
        need.take(needed, most);
    } else if need.reading.is_none() && !need.is_awaited {
        let reading = send_for(client, total);
        if client.name().starts_with("wgpu") {
            need.is_awaited = true;
            need.reading = wait_apart(key, reading, most);
        } else {
            need.reading = Some(reading);
        }
    }
    let wanted = match need.intersections {
        Some(known) => known + known / 8 * SPARE_EIGHTHS,
        None => GUESS.max(GUESS_PER_SPLAT * n),
    };
    fitting(wanted.max(FIRST).max(FIRST_PER_SPLAT * n), most)
}

impl Need {
    /// Takes the reading if it has arrived.
    fn take_what_arrived(&mut self, most: usize) {
        let Some(reading) = &mut self.reading else {
            return;
        };
        let mut context = Context::from_waker(Waker::noop());
        if let Poll::Ready(needed) = reading.as_mut().poll(&mut context) {
            self.take(needed, most);
        }
    }

    fn take(&mut self, needed: Option<usize>, most: usize) {
        (self.reading, self.is_awaited) = (None, false);
        let needed = needed.unwrap_or(0);
        let known = self.intersections.unwrap_or(0);
        self.intersections = Some(needed.max(known - known / DECAY));
        if needed > most && !self.warned {
            self.warned = true;
            warn_of_slow_drawing(needed, most);
        }
    }
}

/// Has a thread wait for a reading and take it; returns the reading where there is no thread.
#[cfg(not(target_family = "wasm"))]
fn wait_apart(key: Key, reading: Reading, most: usize) -> Option<Reading> {
    type Awaited = (Key, Reading, usize);
    static WAITING: LazyLock<Sender<Awaited>> = LazyLock::new(|| {
        let (sender, receiver) = channel::<Awaited>();
        // Without the thread its end of the channel is gone.
        let _ = thread::Builder::new()
            .name("dash-capacity".into())
            .spawn(move || {
                for (key, reading, most) in receiver {
                    let needed = try_read_sync(reading).flatten();
                    if let Some(need) = lock(&NEEDS).get_mut(&key) {
                        need.take(needed, most);
                    }
                }
            });
        sender
    });
    let refused = WAITING.send((key, reading, most)).err();
    refused.map(|refused| refused.0.1)
}

#[cfg(target_family = "wasm")]
fn wait_apart(_: Key, reading: Reading, _: usize) -> Option<Reading> {
    Some(reading)
}

fn warn_of_slow_drawing(needed: usize, most: usize) {
    tracing::warn!(
        "a frame needs {needed} intersections of splats and tiles; lists on this device hold \
         {most}. Such frames are drawn correctly but slowly, and their gradients are added up in \
         any order; lower the number of Gaussians or the resolution"
    );
}

/// The state behind a poisoned lock is still valid: no update leaves it incomplete.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// Largest capacity of a device: a list fits one buffer, and all lists take at most half of the memory, where its size is
/// known.
fn most(client: &Client) -> usize {
    let words = largest_buffer(client) / size_of::<u32>() as u64;
    let memory = client.properties().memory.max_memory();
    let all = memory.map_or(u64::MAX, |bytes| bytes / 2 / BYTES);
    // Indices have 32 bits, with some to spare for the last cube's idle units.
    words.min(all).min(u64::from(u32::MAX / 2)) as usize
}

/// Intersections whose gradients fit one buffer: a value of each differentiable column.
pub(super) fn slots_per_window(client: &Client) -> usize {
    let words = largest_buffer(client) / size_of::<u32>() as u64;
    (words as usize / N_DIFFERENTIABLE).min(most(client))
}

/// A capacity of at least `wanted` but at most `most`, in steps, so that memory is reused.
fn fitting(wanted: usize, most: usize) -> usize {
    wanted.next_multiple_of(FIRST).min(most)
}

/// Whether a reading of frames on so many tiles has not arrived yet.
#[cfg(test)]
pub(super) fn is_on_its_way(tiles: [usize; 2]) -> bool {
    let needs = lock(&NEEDS);
    let mut of_size = needs.iter().filter(|(key, _)| key.1 == tiles);
    of_size.any(|(_, need)| need.is_awaited || need.reading.is_some())
}

/// Starts to read the number at the start of the memory; `None` when the device failed.
fn send_for(client: &Client, memory: Handle) -> Reading {
    let client = client.clone();
    let mut is_sent = false;
    let mut reading: Reading = Box::pin(async move {
        let answer = client.read_async(vec![memory]);
        // On CUDA the first poll of the answer waits for it, so it is delayed until the reading is polled again.
        poll_fn(|context| {
            let state = if is_sent {
                Poll::Ready(())
            } else {
                Poll::Pending
            };
            is_sent = true;
            context.waker().wake_by_ref();
            state
        })
        .await;
        let bytes = answer.await.ok()?;
        let words: &[u32] = bytemuck::cast_slice(&bytes[0]);
        words.first().map(|&total| total as usize)
    });
    let sent = reading
        .as_mut()
        .poll(&mut Context::from_waker(Waker::noop()));
    debug_assert!(sent.is_pending());
    reading
}
