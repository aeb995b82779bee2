//! Tests across crates.
//!
//! One test binary: each would link Burn once more.

mod common;
#[cfg(unix)]
mod docs;
mod extremes;
mod gradients;
mod quality;
mod threads;
mod trained_splats;
