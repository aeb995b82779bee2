//! What work asks of a device: kernels launched and tensors read back. On a GPU each launch costs the host some
//! microseconds, and each read a wait for all that was launched before.

use std::cell::Cell;
use std::collections::BTreeMap;

thread_local! {
    static READS: Cell<usize> = const { Cell::new(0) };
}

/// What a thread asked of devices.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Counts {
    /// Launches of each kernel, by the kernel's name; none on a CPU.
    pub kernels: BTreeMap<String, usize>,
    /// Tensors read back, of all that [`note_read`] was told of.
    pub reads: usize,
}

impl Counts {
    /// Launches of all kernels.
    pub fn launches(&self) -> usize {
        self.kernels.values().sum()
    }
}

/// What `work` returns, and what this thread asked of devices meanwhile. Threads that count take turns; `work` must not count
/// itself.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::counts;
///
/// let (sum, counts) = counts::of(|| Tensor::<1>::ones([2], &Device::flex()).sum());
/// assert_eq!((counts.launches(), counts.reads), (0, 0));
/// # let _ = sum;
/// ```
pub fn of<T>(work: impl FnOnce() -> T) -> (T, Counts) {
    let before = READS.get();
    let (result, kernels) = watched(work);
    let reads = READS.get() - before;
    (result, Counts { kernels, reads })
}

/// To be called by what reads a tensor back to the host.
pub fn note_read() {
    READS.set(READS.get() + 1);
}

#[cfg(feature = "cube")]
fn watched<T>(work: impl FnOnce() -> T) -> (T, BTreeMap<String, usize>) {
    use std::sync::{Arc, Mutex, PoisonError};
    use std::thread::{self, ThreadId};

    use cubecl::logging::{LaunchObservation, LaunchObserver};

    /// There is one observer for the whole process.
    static TURN: Mutex<()> = Mutex::new(());

    struct Tally {
        thread: ThreadId,
        launches: Mutex<BTreeMap<&'static str, usize>>,
    }

    impl LaunchObserver for Tally {
        fn launched(&self, kernel: &'static str) {
            if thread::current().id() == self.thread {
                let launches = self.launches.lock();
                let mut launches = launches.unwrap_or_else(PoisonError::into_inner);
                *launches.entry(kernel).or_default() += 1;
            }
        }
    }

    let turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let tally = Arc::new(Tally {
        thread: thread::current().id(),
        launches: Mutex::default(),
    });
    let watching = LaunchObservation::new(tally.clone());
    let result = work();
    drop(watching);
    drop(turn);
    let mut kernels = BTreeMap::new();
    let found = tally.launches.lock();
    for (name, n) in found.unwrap_or_else(PoisonError::into_inner).iter() {
        *kernels.entry(short(name)).or_default() += n;
    }
    (result, kernels)
}

#[cfg(not(feature = "cube"))]
fn watched<T>(work: impl FnOnce() -> T) -> (T, BTreeMap<String, usize>) {
    (work(), BTreeMap::new())
}

/// A type's name with its module, without the path to it and parameters of its own.
#[cfg(feature = "cube")]
fn short(name: &str) -> String {
    let name = name.split('<').next().unwrap_or(name);
    let parts: Vec<&str> = name.split("::").collect();
    parts[parts.len().saturating_sub(2)..].join("::")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adam::{AdamStep, adam_step};
    use crate::testing::{devices, tensor, values};

    #[test]
    fn launches_of_a_device_are_counted_by_kernel() {
        for device in devices() {
            let step = || {
                let [a, b, c, d] = [(); 4].map(|()| tensor(&[1.0; 9], [9], &device));
                adam_step(a, b, c, d, &AdamStep::default())
                    .expect("one shape")
                    .0
            };
            let (stepped, counts) = of(step);
            let of_adam = counts
                .kernels
                .iter()
                .filter(|(name, _)| name.contains("adam"));
            let n = of_adam.map(|(_, n)| n).sum::<usize>();
            let is_cpu = crate::limits::largest_buffer_bytes(&device).is_none();
            assert_eq!(n, usize::from(!is_cpu), "{device:?}: {counts:?}");
            assert_eq!(values(stepped).len(), 9);
        }
    }

    #[test]
    fn reads_of_this_thread_are_counted() {
        let ((), counts) = of(|| {
            (0..3).for_each(|_| note_read());
            std::thread::spawn(note_read).join().expect("reads");
        });
        assert_eq!(counts.reads, 3);
    }
}
