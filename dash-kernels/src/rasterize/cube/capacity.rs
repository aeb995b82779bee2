//! How many intersections the lists of the next frame have room for.
//!
//! The number that a frame needs is read back while others are drawn: each frame asks whether it
//! has arrived and never waits, so that frames drawn until then use the capacity of before.

use std::collections::HashMap;
use std::pin::Pin;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard};
use std::task::{Context, Poll, Waker};

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
/// What frames of one size need on a device.
#[derive(Default)]
struct Need {
    intersections: usize,
    /// A number on its way.
    reading: Option<Reading>,
    /// Whether it was said that a device's lists can't hold what frames need.
    warned: bool,
}

type Reading = Pin<Box<dyn Future<Output = Option<usize>> + Send>>;

type Needs = HashMap<(String, [usize; 2]), Arc<Mutex<Need>>>;

static NEEDS: LazyLock<Mutex<Needs>> = LazyLock::new(Mutex::default);

/// The capacity for a frame of `n` splats on `tiles`, whose number of intersections stands at the
/// end of `starts [n + 1]`.
pub(super) fn next(client: &Client, starts: &Buffer, n: usize, tiles: [usize; 2]) -> usize {
    let total = starts.handle().offset_start((n * size_of::<u32>()) as u64);
    if is_deterministic() {
        // The slow way adds gradients in any order.
        let needed = read(client, total).unwrap_or(1).max(1);
        if needed > most(client) {
            warn_of_slow_drawing(needed, most(client));
        }
        return fitting(client, needed);
    }
    let key = (format!("{:?}", client.service_id()), tiles);
    let need = lock(&NEEDS).entry(key).or_default().clone();
    let mut need = lock(&need);
    if need.reading.is_none() {
        need.reading = Some(Box::pin(read_later(client.clone(), total)));
    }
    need.take_what_arrived(most(client));
    let wanted = need.intersections + need.intersections / 8 * SPARE_EIGHTHS;
    fitting(client, wanted.max(FIRST).max(FIRST_PER_SPLAT * n))
}

impl Need {
    /// Asks once whether the number has arrived; the first question sends for it.
    fn take_what_arrived(&mut self, most: usize) {
        let Some(reading) = &mut self.reading else {
            return;
        };
        let Poll::Ready(read) = reading
            .as_mut()
            .poll(&mut Context::from_waker(Waker::noop()))
        else {
            return;
        };
        self.reading = None;
        let read = read.unwrap_or(0);
        let kept = self.intersections - self.intersections / DECAY;
        self.intersections = read.max(kept);
        if read > most && !self.warned {
            self.warned = true;
            warn_of_slow_drawing(read, most);
        }
    }
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

/// The most intersections that a list of 32-bit words holds on the device.
fn most(client: &Client) -> usize {
    let words = client.properties().memory.max_page_size / size_of::<u32>() as u64;
    // Indices have 32 bits, with some to spare for the last cube's idle units.
    words.min(u64::from(u32::MAX / 2)) as usize
}

/// Intersections whose gradients fit one buffer: a value of each differentiable column.
pub(super) fn slots_per_window(client: &Client) -> usize {
    most(client) / N_DIFFERENTIABLE
}

/// A capacity of at least `wanted`, in steps so that memory is used again, as far as the device's
/// largest buffer allows.
fn fitting(client: &Client, wanted: usize) -> usize {
    wanted.next_multiple_of(FIRST).min(most(client))
}

/// The number that the memory begins with; none when the device failed.
async fn read_later(client: Client, memory: Handle) -> Option<usize> {
    let bytes = client.read_async(vec![memory]).await.ok()?;
    let words: &[u32] = bytemuck::cast_slice(&bytes[0]);
    words.first().map(|&total| total as usize)
}

/// The same, waited for.
fn read(client: &Client, memory: Handle) -> Option<usize> {
    try_read_sync(read_later(client.clone(), memory))?
}
