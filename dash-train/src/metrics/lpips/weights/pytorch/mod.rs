//! PyTorch's weight files. They describe their tensors by a pickle, which is a program for a stack
//! machine that may call any function of Python; here only the few instructions that `torch.save`
//! writes for a dictionary of tensors are known, and the few names they need are not called but
//! recognised. Everything else is refused.
//!
//! # Map
//! - `pickle`, `value`, `calls`: the stack machine, its values, and the names it knows.
//! - `tensors`: from values to tensors and their places.
//! - `archive`: the zip archive that PyTorch writes since version 1.6.
//! - `stream`: the stream of pickles of before, from version 0.1.10 on.
//! - `bytes`: both formats as tests write them.

pub(super) mod archive;
#[cfg(test)]
pub(in super::super) mod bytes;
mod calls;
mod pickle;
pub(super) mod stream;
mod tensors;
mod value;

/// Most bytes of pickles: those of a whole network take a few thousand.
const MAX_PICKLE_BYTES: u64 = 1 << 20;
/// What is expected of a file, for errors.
const EXPECTED: &str = "a dictionary of tensors as torch.save writes it";
