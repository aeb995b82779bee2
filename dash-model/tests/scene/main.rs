//! Whole scenes on every backend: rendering, time gaps, pruning, files.

mod common;
mod files;
mod gaps;
mod ply;
mod pruning;
mod rendering;
mod stored_size;
