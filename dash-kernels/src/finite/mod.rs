//! Whether tensors hold anything that is not a number, without reading them back.

mod cpu;
#[cfg(feature = "cube")]
mod cube;
#[cfg(test)]
mod tests;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::{Device, Tensor, TensorData, try_read_sync};

use crate::KernelError;
use crate::host::HostBackend;

/// What a flag holds once something that is not finite was found.
const RAISED: f32 = 1.0;

/// One flag per watched tensor, on the tensors' device: many tensors are looked through for the
/// price of reading a few bytes back.
///
/// The other operations of this crate give finite results whatever they are given, so what went
/// wrong has to be looked for where values are kept.
#[derive(Debug)]
pub struct FiniteFlags {
    flags: Tensor<1>,
    n_used: usize,
}

impl FiniteFlags {
    /// Room for `n` tensors on `device`, none of them looked at.
    pub fn new(n: usize, device: &Device) -> Self {
        Self {
            flags: Tensor::zeros([n.max(1)], &device.clone().inner()),
            n_used: 0,
        }
    }

    /// Looks through the next tensor. On an autodiff device pass `tensor.inner()`.
    ///
    /// # Errors
    /// [`KernelError::Config`] when there is no room left.
    ///
    /// # Panics
    /// On tensors of an autodiff device.
    pub fn watch<const R: usize>(&mut self, tensor: Tensor<R>) -> Result<(), KernelError> {
        let [room] = self.flags.dims();
        if self.n_used == room {
            return Err(KernelError::Config {
                op: "watch",
                what: format!("there is room for {room} tensors, expected no more of them"),
            });
        }
        // The flags are replaced by the empty tensor meanwhile, so that they are written in place.
        let device = self.flags.device();
        let flags = std::mem::replace(&mut self.flags, Tensor::empty([0], &device));
        self.flags = Tensor::from_dispatch(Dispatch::raise_flag(
            tensor.into_dispatch(),
            flags.into_dispatch(),
            self.n_used,
        ));
        self.n_used += 1;
        Ok(())
    }

    /// For each tensor, in the order in which they were watched, whether all of it is finite. Waits for the device.
    pub fn read(self) -> Vec<bool> {
        let flags: Vec<f32> = self
            .flags
            .into_data()
            .into_vec()
            .expect("the flags were made as f32");
        let flags = flags.iter().take(self.n_used);
        flags.map(|&flag| flag != RAISED).collect()
    }
}

/// Dispatch of [`FiniteFlags::watch`] over the enabled backends.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait RaiseFlag: Backend {
    /// The flags, that of `slot` raised if a value is not finite.
    fn raise_flag(
        values: FloatTensor<Self>,
        flags: FloatTensor<Self>,
        slot: usize,
    ) -> FloatTensor<Self>;
}

impl<B: HostBackend> RaiseFlag for B {
    fn raise_flag(values: FloatTensor<B>, flags: FloatTensor<B>, slot: usize) -> FloatTensor<B> {
        if cpu::all_finite(&B::values(&values)) {
            return flags;
        }
        let (device, shape) = (flags.device(), flags.shape());
        let mut values: Vec<f32> = try_read_sync(B::float_into_data(flags))
            .expect("a host backend's tensors are read without waiting")
            .expect("reading host memory cannot fail")
            .into_vec()
            .expect("the flags were made as f32");
        values[slot] = RAISED;
        B::float_from_data(TensorData::new(values, shape), &device)
    }
}
