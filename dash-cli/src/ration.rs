//! How often a run that trains copies its scene for who looks at it.

use std::time::{Duration, Instant};

/// A copy takes at most this share of the time until the next.
const SHARE: u32 = 50;
/// Copies are not made faster than this.
const SHORTEST: Duration = Duration::from_secs(2);

/// When the last copy was made, and how long it took.
#[derive(Debug, Default)]
pub struct Ration {
    last: Option<Instant>,
    cost: Duration,
}

impl Ration {
    /// Whether another copy may be made.
    pub fn is_due(&self) -> bool {
        let pause = (self.cost * SHARE).max(SHORTEST);
        self.last.is_none_or(|last| last.elapsed() >= pause)
    }

    /// Makes one.
    pub fn spend<T>(&mut self, copy: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let made = copy();
        self.cost = start.elapsed();
        self.last = Some(Instant::now());
        made
    }
}
