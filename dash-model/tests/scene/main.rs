//! Whole scenes on every backend: rendering, time gaps, pruning, files.

mod common;
mod files;
mod gaps;
mod other_fields;
mod ply;
mod pruning;
mod rendering;
mod stored_size;
