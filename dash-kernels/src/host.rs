//! Host memory of the CPU backends: the one bridge between tensors and slices.

use std::borrow::Cow;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, TensorMetadata};
use burn::tensor::{TensorData, try_read_sync};

/// A backend whose tensors live in host memory.
///
/// Every operation implements its kernels once for all of these.
pub trait HostBackend: Backend {
    /// The tensor's values in row-major order, borrowed where the tensor is contiguous.
    ///
    /// # Panics
    /// When the tensor is not `f32`.
    fn values(tensor: &FloatTensor<Self>) -> Cow<'_, [f32]>;

    /// Applies `work` to the tensors' values, in place where their memory is not shared.
    ///
    /// # Panics
    /// When a tensor is not `f32`.
    fn change<const N: usize>(
        tensors: [FloatTensor<Self>; N],
        work: impl FnOnce([&mut [f32]; N]),
    ) -> [FloatTensor<Self>; N] {
        let places = tensors.each_ref().map(|t| (t.shape(), t.device()));
        let mut values = tensors.map(|tensor| -> Vec<f32> {
            try_read_sync(Self::float_into_data(tensor))
                .expect("a host backend's tensors are read without waiting")
                .expect("reading host memory cannot fail")
                .try_into_vec()
                .expect("the caller passes f32 tensors")
        });
        work(values.each_mut().map(Vec::as_mut_slice));
        let mut places = places.into_iter();
        values.map(|values| {
            let (shape, device) = places.next().expect("one for each");
            Self::float_from_data(TensorData::new(values, shape), &device)
        })
    }

    /// A tensor of `shape` on the device of `like`.
    fn tensor<const R: usize>(
        values: Vec<f32>,
        shape: [usize; R],
        like: &FloatTensor<Self>,
    ) -> FloatTensor<Self> {
        Self::float_from_data(TensorData::new(values, shape), &like.device())
    }
}

#[cfg(feature = "ndarray")]
impl HostBackend for burn::backend::NdArray {
    fn values(tensor: &FloatTensor<Self>) -> Cow<'_, [f32]> {
        let burn::backend::ndarray::NdArrayTensor::F32(storage) = tensor else {
            panic!("expected an f32 tensor, found {:?}", tensor.dtype());
        };
        let view = storage.view();
        match view.to_slice() {
            Some(values) => Cow::Borrowed(values),
            None => Cow::Owned(view.iter().copied().collect()),
        }
    }
}

#[cfg(feature = "flex")]
impl HostBackend for burn::backend::Flex {
    fn values(tensor: &FloatTensor<Self>) -> Cow<'_, [f32]> {
        assert_eq!(
            tensor.dtype(),
            burn::tensor::DType::F32,
            "expected an f32 tensor"
        );
        // A view of nothing may start behind the end of its storage, which `as_slice` panics at.
        if tensor.shape().num_elements() == 0 {
            return Cow::Borrowed(&[]);
        }
        match tensor.as_slice::<f32>() {
            Some(values) => Cow::Borrowed(values),
            None => Cow::Owned(tensor.to_contiguous().storage::<f32>().to_vec()),
        }
    }

    fn change<const N: usize>(
        mut tensors: [FloatTensor<Self>; N],
        work: impl FnOnce([&mut [f32]; N]),
    ) -> [FloatTensor<Self>; N] {
        for tensor in &mut tensors {
            let values = Self::values(tensor);
            if values.len() != tensor.storage::<f32>().len() || !tensor.is_contiguous() {
                let data = TensorData::new(values.into_owned(), tensor.shape());
                *tensor = burn::backend::flex::FlexTensor::from_data(data);
            }
        }
        work(tensors.each_mut().map(|tensor| tensor.storage_mut::<f32>()));
        tensors
    }
}

/// The sizes of a tensor of rank `R`.
///
/// # Panics
/// When the rank differs.
pub(crate) fn dims<const R: usize>(tensor: &impl TensorMetadata) -> [usize; R] {
    let shape = tensor.shape();
    let sizes: &[usize] = &shape;
    match sizes.try_into() {
        Ok(sizes) => sizes,
        Err(_) => panic!("expected a tensor of rank {R}, found shape {sizes:?}"),
    }
}
