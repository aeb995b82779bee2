//! Search for NaN and infinity in tensors, without reading them back.

mod cpu;
#[cfg(feature = "cube")]
mod cube;
#[cfg(test)]
mod tests;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::Tensor;

use crate::KernelError;
use crate::host::HostBackend;

/// Value of the flag of a tensor that is not finite.
pub const RAISED: f32 = 1.0;
/// Tensors of a launch: WebGPU promises a kernel eight buffers, of which one holds the flags and one the uniforms.
pub const AT_ONCE: usize = 6;

/// A tensor that is searched, its flag, and where its rows are marked.
#[derive(Debug, Clone)]
pub struct Searched {
    /// The values `[n]`. On an autodiff device pass `tensor.inner()`.
    pub values: Tensor<1>,
    /// The place of its flag.
    pub flag: usize,
    /// The place of the first row's mark among the flags, and values in a row; `None`: rows are not marked.
    pub marks: Option<(usize, usize)>,
}

/// Raises flags, to 1, where values are not finite, without reading anything back: flag `any` for all tensors together, each
/// tensor's own, and the marks of its rows at fault. No flag is lowered, so flags and marks can be those of many steps
/// and be read once.
///
/// The other operations of this crate give finite results for any input, so a fault has to be searched for in the
/// parameters, in gradients and in the optimizer's state.
///
/// # Shapes
/// `flags [F] -> [F]`, in place where nobody else holds their storage.
///
/// # Errors
/// [`KernelError::Shape`] when a flag or a mark lies behind the last of `flags`.
///
/// # Panics
/// On tensors of an autodiff device, or of different devices.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::finite::{Searched, raise_flags};
///
/// let device = Device::flex();
/// let searched = |values: [f32; 4], flag| Searched {
///     values: Tensor::from_floats(values, &device),
///     flag,
///     marks: Some((3, 2)),
/// };
/// let tensors = [searched([1.0; 4], 1), searched([0.0, 0.0, 0.0, f32::NAN], 2)];
/// // One flag for all, one for each tensor, and marks of two rows of two values.
/// let flags = raise_flags(Tensor::zeros([5], &device), &tensors, 0)?;
/// assert_eq!(flags.into_data().try_into_vec::<f32>()?, [1.0, 0.0, 1.0, 0.0, 1.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn raise_flags(
    flags: Tensor<1>,
    tensors: &[Searched],
    any: usize,
) -> Result<Tensor<1>, KernelError> {
    let [n_flags] = flags.dims();
    let end_of = |searched: &Searched| {
        let [n] = searched.values.dims();
        let marks = searched.marks;
        let end = marks.map_or(0, |(first, width)| first + n.div_ceil(width.max(1)));
        end.max(searched.flag + 1)
    };
    let end = tensors.iter().map(end_of).fold(any + 1, usize::max);
    if end > n_flags {
        return Err(KernelError::Shape {
            op: "raise_flags",
            tensor: "flags",
            expected: format!("[{end}] or more"),
            found: vec![n_flags],
        });
    }
    let is_empty = |searched: &Searched| searched.values.dims()[0] == 0;
    let filled = tensors.iter().filter(|searched| !is_empty(searched));
    let filled: Vec<&Searched> = filled.collect();
    let mut flags = flags.into_dispatch();
    for group in filled.chunks(AT_ONCE) {
        // A short group repeats its last tensor.
        let place = |k: usize| group[k.min(group.len() - 1)];
        let tensor = |k: usize| place(k).values.clone().into_dispatch();
        let [a, b, c, d, e, f] = std::array::from_fn(tensor);
        let slots = Slots {
            any,
            n: group.len(),
            flags: std::array::from_fn(|k| place(k).flag),
            marks: std::array::from_fn(|k| place(k).marks.unwrap_or((0, 0))),
        };
        flags = Dispatch::raise_flags(a, b, c, d, e, f, flags, slots);
    }
    Ok(Tensor::from_dispatch(flags))
}

/// Whether each tensor is finite throughout. Reads back a few bytes for any number of tensors, and waits for the device.
/// On an autodiff device pass `tensor.inner()`.
///
/// # Panics
/// On tensors of an autodiff device, or of different devices.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::finite::all_finite;
///
/// let device = Device::flex();
/// let tensors = [[1.0, 2.0], [f32::NAN, 0.0]].map(|row| Tensor::<1>::from_floats(row, &device));
/// assert_eq!(all_finite(&tensors), [true, false]);
/// ```
pub fn all_finite(tensors: &[Tensor<1>]) -> Vec<bool> {
    let Some(device) = tensors.first().map(|tensor| tensor.device()) else {
        return Vec::new();
    };
    let searched: Vec<_> = tensors
        .iter()
        .enumerate()
        .map(|(flag, values)| Searched {
            values: values.clone(),
            flag,
            marks: None,
        })
        .collect();
    let flags = Tensor::zeros([tensors.len() + 1], &device);
    let flags = raise_flags(flags, &searched, tensors.len()).expect("a flag for each tensor");
    let flags = flags.into_data().try_into_vec::<f32>();
    let mut flags = flags.expect("the flags were made as f32");
    flags.truncate(tensors.len());
    flags.into_iter().map(|flag| flag != RAISED).collect()
}

/// Flags and marks of the tensors of a launch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slots {
    /// The flag of all tensors together.
    pub any: usize,
    /// Tensors that count; the others repeat the last of them.
    pub n: usize,
    /// The flag of each tensor.
    pub flags: [usize; AT_ONCE],
    /// The first mark of each tensor, and values in a row; 0 for rows that are not marked.
    pub marks: [(usize, usize); AT_ONCE],
}

/// Dispatch of [`raise_flags`] over the enabled backends.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait RaiseFlags: Backend {
    /// See [`raise_flags`]; no tensor is empty, and all flags and marks are there.
    #[allow(clippy::too_many_arguments)]
    fn raise_flags(
        a: FloatTensor<Self>,
        b: FloatTensor<Self>,
        c: FloatTensor<Self>,
        d: FloatTensor<Self>,
        e: FloatTensor<Self>,
        f: FloatTensor<Self>,
        flags: FloatTensor<Self>,
        slots: Slots,
    ) -> FloatTensor<Self>;
}

impl<B: HostBackend> RaiseFlags for B {
    fn raise_flags(
        a: FloatTensor<B>,
        b: FloatTensor<B>,
        c: FloatTensor<B>,
        d: FloatTensor<B>,
        e: FloatTensor<B>,
        f: FloatTensor<B>,
        flags: FloatTensor<B>,
        slots: Slots,
    ) -> FloatTensor<B> {
        let tensors = [a, b, c, d, e, f];
        let tensors = tensors.iter().take(slots.n).enumerate();
        let broken: Vec<_> = tensors
            .filter(|(_, tensor)| !cpu::all_finite(&B::values(tensor)))
            .collect();
        if broken.is_empty() {
            return flags;
        }
        let [flags] = B::change([flags], |[flags]| {
            flags[slots.any] = RAISED;
            for (k, tensor) in broken {
                flags[slots.flags[k]] = RAISED;
                let (first, width) = slots.marks[k];
                for row in cpu::broken_rows(&B::values(tensor), width) {
                    flags[first + row] = RAISED;
                }
            }
        });
        flags
    }
}
