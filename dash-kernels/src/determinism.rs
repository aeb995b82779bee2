//! Whether results have to have the same bits on every run, on devices where that costs time.

use std::sync::atomic::{AtomicBool, Ordering};

static DETERMINISTIC: AtomicBool = AtomicBool::new(false);

/// Makes the operations of this crate give the same bits on every run on the same device, from now
/// on and for the whole process. On the CPU they always do.
///
/// On a GPU gradients of hash tables are then sorted by row before they are added up, and a frame
/// whose intersections outgrow their lists waits for the device to learn how many there are.
pub fn set_deterministic(deterministic: bool) {
    DETERMINISTIC.store(deterministic, Ordering::Relaxed);
}

/// Whether [`set_deterministic`] is on.
pub fn is_deterministic() -> bool {
    DETERMINISTIC.load(Ordering::Relaxed)
}
