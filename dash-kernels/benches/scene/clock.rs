//! How long work takes on a device, and how fast the device's memory is.

use std::cell::Cell;
use std::time::{Duration, Instant};

use burn::tensor::{Device, Tensor};
use dash_kernels::adam::{AdamStep, adam_step};

const VALUE_BYTES: usize = 4;
/// Runs of which the median counts, at least; of short ones as many as [`ENOUGH`] takes.
const REPETITIONS: usize = 5;
/// Half of this warms the device up: clocks that fell while it idled, memory it has yet to find.
const ENOUGH: Duration = Duration::from_millis(200);
/// A size after one that took longer than this is left out.
pub const TOO_LONG: Duration = Duration::from_secs(4);

/// Bytes per second, read and written: the better of adding a number to a large tensor and of an
/// Adam step in place, which needs no new memory.
pub fn bandwidth(device: &Device) -> f64 {
    let n = 1 << 24;
    let zeros = || Tensor::<1>::zeros([n], device);
    let tensor = zeros();
    let add = median(device, || drop(tensor.clone() + 1.0));
    let state = Cell::new(Some((zeros(), zeros(), zeros())));
    let adam = median(device, || {
        let (param, first, second) = state.take().expect("put back");
        let settings = AdamStep::default();
        let stepped = adam_step(param, tensor.clone(), first, second, &settings);
        state.set(Some(stepped.expect("equal shapes")));
    });
    let rate = |values: usize, time: Duration| (values * VALUE_BYTES) as f64 / time.as_secs_f64();
    rate(2 * n, add).max(rate(7 * n, adam))
}

/// The time of `work`, until the device has done it.
pub fn median(device: &Device, work: impl Fn()) -> Duration {
    let once = || {
        let start = Instant::now();
        work();
        device.sync().expect("the device answers");
        start.elapsed()
    };
    // The first runs compile kernels and find the lists' capacity.
    once();
    let second = once();
    if second > TOO_LONG / 4 {
        return second;
    }
    let warm = Instant::now();
    while warm.elapsed() < ENOUGH / 2 {
        once();
    }
    let (start, mut times) = (Instant::now(), Vec::new());
    while times.len() < REPETITIONS || start.elapsed() < ENOUGH {
        times.push(once());
    }
    times.sort();
    times[times.len() / 2]
}
