//! Whether results have to have the same bits on every run, on devices where that costs time.

use std::sync::atomic::{AtomicBool, Ordering};

static DETERMINISTIC: AtomicBool = AtomicBool::new(false);

/// Makes the operations of this crate give the same bits on every run on the same device, from now
/// on and for the whole process. On the CPU they always do.
///
/// On a GPU gradients of hash tables are then sorted by row before they are added up, and every
/// call of [`rasterize`](crate::rasterize::rasterize) waits for the device to count the
/// intersections of tiles and splats, so that there is room for them. Only where they outgrow the
/// device's largest buffer (a fortieth of its bytes) does the order of additions stay open.
pub fn set_deterministic(deterministic: bool) {
    DETERMINISTIC.store(deterministic, Ordering::Relaxed);
}

/// Whether [`set_deterministic`] is on.
pub fn is_deterministic() -> bool {
    DETERMINISTIC.load(Ordering::Relaxed)
}
