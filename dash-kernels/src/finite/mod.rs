//! Search for NaN and infinity in tensors, without reading them back.

mod cpu;
#[cfg(feature = "cube")]
mod cube;
#[cfg(test)]
mod tests;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::{Tensor, TensorData, try_read_sync};

use crate::host::HostBackend;

/// Value of the flag of a tensor that is not finite.
const RAISED: f32 = 1.0;
/// Tensors of a launch: WebGPU promises a kernel eight buffers, of which one holds the flags and one the uniforms.
const AT_ONCE: usize = 6;

/// Whether each tensor is finite throughout. Reads back a few bytes for any number of tensors, and waits for the device.
/// On an autodiff device pass `tensor.inner()`.
///
/// The other operations of this crate give finite results for any input, so a fault has to be searched for in the
/// parameters and the optimizer's state.
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
    let is_empty = |tensor: &Tensor<1>| tensor.dims()[0] == 0;
    let filled: Vec<_> = tensors.iter().filter(|tensor| !is_empty(tensor)).collect();
    let Some(device) = filled.first().map(|tensor| tensor.device()) else {
        return vec![true; tensors.len()];
    };
    let mut flags = Tensor::<1>::zeros([filled.len()], &device).into_dispatch();
    for (k, group) in filled.chunks(AT_ONCE).enumerate() {
        // A short group repeats its last tensor.
        let last = group.len() - 1;
        let tensor = |k: usize| group[k.min(last)].clone().into_dispatch();
        let [a, b, c, d, e, f] = std::array::from_fn(tensor);
        flags = Dispatch::raise_flags(a, b, c, d, e, f, flags, k * AT_ONCE, last);
    }
    let mut flags = Tensor::<1>::from_dispatch(flags)
        .into_data()
        .try_into_vec::<f32>()
        .expect("the flags were made as f32")
        .into_iter();
    let sound = |tensor| is_empty(tensor) || flags.next() != Some(RAISED);
    tensors.iter().map(sound).collect()
}

/// Dispatch of [`all_finite`] over the enabled backends.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait RaiseFlags: Backend {
    /// The flags, raised from `first` on for tensors with a value that is not finite; tensors after `last` repeat it.
    #[allow(clippy::too_many_arguments)]
    fn raise_flags(
        a: FloatTensor<Self>,
        b: FloatTensor<Self>,
        c: FloatTensor<Self>,
        d: FloatTensor<Self>,
        e: FloatTensor<Self>,
        f: FloatTensor<Self>,
        flags: FloatTensor<Self>,
        first: usize,
        last: usize,
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
        first: usize,
        last: usize,
    ) -> FloatTensor<B> {
        let tensors = [a, b, c, d, e, f].into_iter().take(last + 1).enumerate();
        let broken = tensors.filter(|(_, tensor)| !cpu::all_finite(&B::values(tensor)));
        let broken: Vec<usize> = broken.map(|(k, _)| first + k).collect();
        if broken.is_empty() {
            return flags;
        }
        let (device, shape) = (flags.device(), flags.shape());
        let mut values: Vec<f32> = try_read_sync(B::float_into_data(flags))
            .expect("a host backend's tensors are read without waiting")
            .expect("reading host memory cannot fail")
            .try_into_vec()
            .expect("the flags were made as f32");
        for slot in broken {
            values[slot] = RAISED;
        }
        B::float_from_data(TensorData::new(values, shape), &device)
    }
}
