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
use crate::tensor_list::TensorList;

/// Value of the flag of a tensor that is not finite.
pub const RAISED: f32 = 1.0;
/// A tensor that is searched, its flag, and where its rows are marked.
#[derive(Debug, Clone)]
pub struct Searched {
    /// The values `[n]`. On an autodiff device pass `tensor.inner()`.
    pub values: Tensor<1>,
    /// The place of its flag.
    pub flag: usize,
    /// The place of the first row's mark among the flags, and values in a row; `None`: rows are not marked.
    pub marks: Option<(usize, usize)>,
    /// The place among the flags that the first value is copied to, such as a loss to be read with them.
    pub copy: Option<usize>,
}

/// Raises flags, to 1, where values are not finite, without reading anything back: flag `any` for all tensors together, each
/// tensor's own, and the marks of its rows at fault. No flag is lowered, so flags and marks can be those of many steps
/// and be read once.
///
/// What draws a picture gives finite results for any input, so a fault has to be searched for in the parameters, in gradients
/// and in the optimizer's state.
///
/// # Shapes
/// `flags [F] -> [F]`, in place where nobody else holds their storage.
///
/// # Errors
/// [`KernelError::Shape`] when a flag, a mark or the place of a copy lies behind the last of `flags`.
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
///     copy: None,
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
        let copied = searched.copy.map_or(0, |place| place + 1);
        end.max(copied).max(searched.flag + 1)
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
    let is_filled = |searched: &&Searched| searched.values.dims()[0] > 0;
    let filled = || tensors.iter().filter(is_filled);
    let slots = Slots {
        any,
        each: filled().map(Slot::of).collect(),
    };
    if slots.each.is_empty() {
        return Ok(flags);
    }
    let tensors = filled().map(|searched| searched.values.clone().into_dispatch());
    let tensors = TensorList(tensors.collect());
    let flags = Dispatch::raise_flags(tensors, flags.into_dispatch(), slots);
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
            copy: None,
        })
        .collect();
    let flags = Tensor::zeros([tensors.len() + 1], &device);
    let flags = raise_flags(flags, &searched, tensors.len()).expect("a flag for each tensor");
    let flags = flags.into_data().try_into_vec::<f32>();
    let mut flags = flags.expect("the flags were made as f32");
    flags.truncate(tensors.len());
    flags.into_iter().map(|flag| flag != RAISED).collect()
}

/// Where a tensor's flag, marks and copy are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slot {
    /// The tensor's flag.
    pub flag: usize,
    /// The first mark, and values in a row; 0 of these: rows are not marked.
    pub marks: (usize, usize),
    /// Where the first value is copied to.
    pub copy: Option<usize>,
}

impl Slot {
    fn of(searched: &Searched) -> Self {
        Self {
            flag: searched.flag,
            marks: searched.marks.unwrap_or((0, 0)),
            copy: searched.copy,
        }
    }
}

/// Those of all tensors.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Slots {
    /// The flag of all tensors together.
    pub any: usize,
    /// In the order of the tensors.
    pub each: Vec<Slot>,
}

/// Dispatch of [`raise_flags`] over the enabled backends.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait RaiseFlags: Backend {
    /// See [`raise_flags`]; there is a tensor, none is empty, and all places are there.
    fn raise_flags(
        #[extension_type] tensors: TensorList<Self>,
        flags: FloatTensor<Self>,
        slots: Slots,
    ) -> FloatTensor<Self>;
}

impl<B: HostBackend> RaiseFlags for B {
    fn raise_flags(
        TensorList(tensors): TensorList<B>,
        flags: FloatTensor<B>,
        slots: Slots,
    ) -> FloatTensor<B> {
        let tensors = || tensors.iter().zip(&slots.each);
        let is_broken = |tensor| !cpu::all_finite(&B::values(tensor));
        let broken: Vec<bool> = tensors().map(|(tensor, _)| is_broken(tensor)).collect();
        if !broken.contains(&true) && slots.each.iter().all(|slot| slot.copy.is_none()) {
            return flags;
        }
        let [flags] = B::change([flags], |[flags]| {
            for ((tensor, slot), &is_broken) in tensors().zip(&broken) {
                let values = B::values(tensor);
                if let Some(place) = slot.copy {
                    flags[place] = values[0];
                }
                if is_broken {
                    flags[slots.any] = RAISED;
                    flags[slot.flag] = RAISED;
                    let (first, width) = slot.marks;
                    for row in cpu::broken_rows(&values, width) {
                        flags[first + row] = RAISED;
                    }
                }
            }
        });
        flags
    }
}
