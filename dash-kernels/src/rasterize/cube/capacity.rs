//! How many intersections the lists of the next frame have room for.
//!
//! The number that a frame needs is sent for when the frame is drawn, and taken in by the next one, which never waits
//! for what is still on its way (CUDA, whose readings can't be asked whether they are there, waits for the number
//! alone, sent before the frame before was blended). On wgpu a number that nobody takes keeps a thread in the driver,
//! and a program that ends meanwhile may crash there: a thread of ours takes each as it comes. The first frame of a
//! size waits for its own number, where anything can wait: in a browser it has the room of a guess.

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

/// Room before anything is known: per splat, and at least.
const FIRST_PER_SPLAT: usize = 8;
const FIRST: usize = 1 << 16;
/// Room kept beyond what was needed last, in eighths of it.
const SPARE_EIGHTHS: usize = 2;
/// Part of the room that a frame which needs less gives back: pictures of several layers and of many cameras are
/// drawn in turns.
const DECAY: usize = 4096;
/// Bytes that an intersection takes while gradients are worked out: its key, slot and rows, what they are sorted
/// into, and a value of each differentiable column.
const BYTES: u64 = 4 * (7 + N_DIFFERENTIABLE as u64);

/// What frames of one size need on a device.
#[derive(Default)]
struct Need {
    intersections: usize,
    /// A number on its way.
    reading: Option<Reading>,
    /// Whether the thread of [`wait_apart`] has one.
    is_awaited: bool,
    /// Whether it was said that a device's lists can't hold what frames need.
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
        // The slow way adds gradients in any order.
        let needed = try_read_sync(send_for(client, total)).flatten();
        let needed = needed.unwrap_or(1).max(1);
        if needed > most {
            warn_of_slow_drawing(needed, most);
        }
        return fitting(needed, most);
    }
    let device = format!("{:?}", client.service_id());
    let mut needs = lock(&NEEDS);
    // Those of other sizes, too: what is done with a number should not wait for a frame that may never come.
    for (_, need) in needs.iter_mut().filter(|(key, _)| key.0 == device) {
        need.take_what_arrived(most);
    }
    let key = (device, tiles);
    let is_first = !needs.contains_key(&key);
    let need = needs.entry(key.clone()).or_default();
    if is_first && let Some(needed) = try_read_sync(send_for(client, total.clone())) {
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
    let wanted = need.intersections + need.intersections / 8 * SPARE_EIGHTHS;
    fitting(wanted.max(FIRST).max(FIRST_PER_SPLAT * n), most)
}

impl Need {
    /// Takes in the number that was sent for, if it is there.
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
        let kept = self.intersections - self.intersections / DECAY;
        self.intersections = needed.max(kept);
        if needed > most && !self.warned {
            self.warned = true;
            warn_of_slow_drawing(needed, most);
        }
    }
}

/// Has a thread wait for a number and take it in; gives it back where there is none that could.
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

/// What a panic elsewhere leaves is as good as before: every state is a whole one.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// The most intersections that a device's lists hold: a list fits a buffer, and all that they take half of the memory,
/// where that is known.
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

/// A capacity of at least `wanted`, in steps so that memory is used again, but not of more than `most`.
fn fitting(wanted: usize, most: usize) -> usize {
    wanted.next_multiple_of(FIRST).min(most)
}

/// Whether a number that frames on so many tiles need is on its way, in anybody's hands.
#[cfg(test)]
pub(super) fn is_on_its_way(tiles: [usize; 2]) -> bool {
    let needs = lock(&NEEDS);
    let mut of_size = needs.iter().filter(|(key, _)| key.1 == tiles);
    of_size.any(|(_, need)| need.is_awaited || need.reading.is_some())
}

/// Sends for the number that the memory begins with, as it is now. None arrives when the device failed.
fn send_for(client: &Client, memory: Handle) -> Reading {
    let client = client.clone();
    let mut is_sent = false;
    let mut reading: Reading = Box::pin(async move {
        let answer = client.read_async(vec![memory]);
        // On CUDA the first question for an answer waits for it, so that it is put off until the reading is polled again.
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
