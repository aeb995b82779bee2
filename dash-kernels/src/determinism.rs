//! Choice of bit-identical results on devices where they cost time.

use std::sync::atomic::{AtomicBool, Ordering};

static DETERMINISTIC: AtomicBool = AtomicBool::new(false);

/// Chooses whether operations give the same bits on every run on the same device, for the whole process. On the CPU they
/// always do.
///
/// On a GPU, gradients of hash tables are then sorted by row before they are added up, and every call of
/// [`rasterize`](crate::rasterize::rasterize) waits for the device to count the intersections of tiles and splats. Runs
/// may still differ when a frame has more intersections than the device's lists hold; a warning says so.
///
/// # Example
/// ```
/// dash_kernels::set_deterministic(true);
/// assert!(dash_kernels::is_deterministic());
/// ```
pub fn set_deterministic(deterministic: bool) {
    DETERMINISTIC.store(deterministic, Ordering::Relaxed);
}

/// Whether [`set_deterministic`] is on.
pub fn is_deterministic() -> bool {
    DETERMINISTIC.load(Ordering::Relaxed)
}
