//! PyTorch's weight files.
//!
//! They describe their tensors by a pickle: a program for a stack machine that may call any function of Python.
//! This reader knows the few instructions that `torch.save` writes for a dictionary of tensors, and recognises the
//! few names they need without calling anything. Everything else is refused.
//!
//! Burn's `pytorch-reader` 0.22.1 can't replace it. It refuses tensors wrapped in `torch.nn.parameter.Parameter`, as
//! torchvision's `vgg16-397923af.pth` of 2017 has them. It also accepts a storage that declares more elements than
//! the file holds and calls of unknown functions beside the tensors; of an archive with one entry twice it takes the last.
//!
//! # Map
//! - `pickle`, `value`, `calls`: the stack machine, its values, and the names it knows.
//! - `tensors`: from values to tensors and their places.
//! - `archive`: the zip archive that PyTorch writes since version 1.6.
//! - `stream`: the older stream of pickles, since version 0.1.10.
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
