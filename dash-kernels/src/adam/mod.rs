//! One step of the Adam optimiser, fused.

mod cpu;
#[cfg(feature = "cube")]
mod cube;
pub mod reference;
#[cfg(test)]
mod tests;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::Tensor;

use crate::KernelError;
use crate::host::HostBackend;

/// Gradients are clamped to plus and minus this, so that their squares stay finite in f32.
pub const MAX_GRADIENT: f32 = 1e18;

/// Settings of one [`adam_step`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdamStep {
    /// Step length.
    pub learning_rate: f64,
    /// Decay of the first moment, in [0, 1).
    pub beta1: f64,
    /// Decay of the second moment, in [0, 1).
    pub beta2: f64,
    /// Added to the root of the second moment; 3D Gaussian Splatting takes 1e-15.
    pub epsilon: f64,
    /// Number of this step, from 1; corrects the moments' bias towards zero.
    pub step: u64,
    /// Skips elements whose gradient is exactly zero, moments included, so that rows of a hash table without points do
    /// not drift.
    pub skip_zero_grad: bool,
}

impl Default for AdamStep {
    /// The first step of 3D Gaussian Splatting's Adam, at a learning rate of 1e-3.
    fn default() -> Self {
        Self {
            learning_rate: 1e-3,
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-15,
            step: 1,
            skip_zero_grad: false,
        }
    }
}

/// What a step depends on that only the device knows.
#[derive(Debug, Clone)]
pub struct Conditions {
    /// Flags `[F]`, as [`raise_flags`](crate::finite::raise_flags) raises them.
    pub flags: Tensor<1>,
    /// The flag that stops the step.
    pub stop: usize,
    /// Added to epsilon, `[1]`; not negative.
    pub damping: Tensor<1>,
}

/// The parameter and its moments, all of one shape.
type Stepped<const R: usize> = (Tensor<R>, Tensor<R>, Tensor<R>);

/// One Adam step on every element: the new `(param, first_moment, second_moment)`.
///
/// Not differentiable: on an autodiff device pass `tensor.inner()`. A tensor whose storage nobody
/// else holds is updated in place.
///
/// Gradients are clamped to [`MAX_GRADIENT`]. An element is skipped, moments included, when its gradient, its parameter
/// or its step is not finite. Moments that are not finite, and negative second moments, count as zero.
///
/// # Shapes
/// All four tensors have the same shape.
///
/// # Errors
/// [`KernelError::Shape`] when they differ, [`KernelError::Config`] when a setting is out of range.
///
/// # Panics
/// On tensors of an autodiff device.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::adam::{AdamStep, adam_step};
///
/// let device = Device::flex();
/// let zeros = Tensor::<1>::zeros([2], &device);
/// let grad = Tensor::from_floats([0.3, -5.0], &device);
/// let settings = AdamStep { learning_rate: 0.5, ..AdamStep::default() };
/// let (param, _, _) = adam_step(zeros.clone(), grad, zeros.clone(), zeros, &settings)?;
/// // The first step is one learning rate long, against the gradient's sign.
/// assert_eq!(param.into_data().try_into_vec::<f32>()?, [-0.5, 0.5]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn adam_step<const R: usize>(
    param: Tensor<R>,
    grad: Tensor<R>,
    first_moment: Tensor<R>,
    second_moment: Tensor<R>,
    settings: &AdamStep,
) -> Result<Stepped<R>, KernelError> {
    check_shapes(&param, [&grad, &first_moment, &second_moment])?;
    validate(settings)?;
    let (param, first_moment, second_moment) = Dispatch::adam_step(
        param.into_dispatch(),
        grad.into_dispatch(),
        first_moment.into_dispatch(),
        second_moment.into_dispatch(),
        *settings,
    );
    Ok((
        Tensor::from_dispatch(param),
        Tensor::from_dispatch(first_moment),
        Tensor::from_dispatch(second_moment),
    ))
}

/// [`adam_step`], which changes nothing where a flag of the device stops it, and with a damping that the device has worked
/// out. Nothing is read back.
///
/// # Shapes, errors and panics
/// Those of [`adam_step`], and [`KernelError::Shape`] when the flag is not there or the damping is not one number.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::adam::{AdamStep, Conditions, adam_step_unless};
///
/// let device = Device::flex();
/// let zeros = || Tensor::<1>::zeros([2], &device);
/// let conditions = Conditions {
///     flags: Tensor::from_floats([0.0, 1.0], &device),
///     stop: 1,
///     damping: Tensor::zeros([1], &device),
/// };
/// let gradient = Tensor::from_floats([0.3, -5.0], &device);
/// let settings = AdamStep::default();
/// let (param, ..) = adam_step_unless(zeros(), gradient, zeros(), zeros(), &settings, &conditions)?;
/// assert_eq!(param.into_data().try_into_vec::<f32>()?, [0.0, 0.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn adam_step_unless<const R: usize>(
    param: Tensor<R>,
    grad: Tensor<R>,
    first_moment: Tensor<R>,
    second_moment: Tensor<R>,
    settings: &AdamStep,
    conditions: &Conditions,
) -> Result<Stepped<R>, KernelError> {
    check_shapes(&param, [&grad, &first_moment, &second_moment])?;
    validate(settings)?;
    let Conditions {
        flags,
        stop,
        damping,
    } = conditions;
    for (name, found, fits, expected) in [
        ("flags", flags.dims(), flags.dims()[0] > *stop, *stop + 1),
        ("damping", damping.dims(), damping.dims() == [1], 1),
    ] {
        if !fits {
            return Err(KernelError::Shape {
                op: "adam_step_unless",
                tensor: name,
                expected: format!("[{expected}]"),
                found: found.to_vec(),
            });
        }
    }
    let (param, first_moment, second_moment) = Dispatch::adam_step_unless(
        param.into_dispatch(),
        grad.into_dispatch(),
        first_moment.into_dispatch(),
        second_moment.into_dispatch(),
        flags.clone().into_dispatch(),
        damping.clone().into_dispatch(),
        *settings,
        *stop,
    );
    Ok((
        Tensor::from_dispatch(param),
        Tensor::from_dispatch(first_moment),
        Tensor::from_dispatch(second_moment),
    ))
}

/// The root mean square of what is positive among `squares [n]`, over a `correction` of their bias: with an optimizer's second
/// moments the typical gradient of the elements that have one. `-> [1]`, 0 where nothing is positive. Nothing is read back.
///
/// # Panics
/// On tensors of an autodiff device.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::adam::typical_gradient;
///
/// let squares = Tensor::from_floats([0.0, 4.0, 12.0], &Device::flex());
/// let found = typical_gradient(squares, 0.5);
/// assert_eq!(found.into_data().try_into_vec::<f32>()?, [4.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn typical_gradient(squares: Tensor<1>, correction: f64) -> Tensor<1> {
    if squares.dims() == [0] {
        return Tensor::zeros([1], &squares.device());
    }
    let found = Dispatch::typical_gradient(squares.into_dispatch(), correction);
    Tensor::from_dispatch(found)
}

fn check_shapes<const R: usize>(
    param: &Tensor<R>,
    others: [&Tensor<R>; 3],
) -> Result<(), KernelError> {
    let expected = param.dims();
    for (name, other) in ["grad", "first_moment", "second_moment"]
        .into_iter()
        .zip(others)
    {
        if other.dims() != expected {
            return Err(KernelError::Shape {
                op: "adam_step",
                tensor: name,
                expected: format!("{expected:?}, as `param`"),
                found: other.dims().to_vec(),
            });
        }
    }
    Ok(())
}

fn validate(settings: &AdamStep) -> Result<(), KernelError> {
    let wrong = if !(settings.learning_rate >= 0.0 && settings.learning_rate.is_finite()) {
        format!(
            "`learning_rate` is {}, expected 0 or more",
            settings.learning_rate
        )
    } else if !(0.0..1.0).contains(&settings.beta1) || !(0.0..1.0).contains(&settings.beta2) {
        format!(
            "`beta1` is {} and `beta2` {}, expected both in [0, 1)",
            settings.beta1, settings.beta2
        )
    } else if !(settings.epsilon >= 0.0 && settings.epsilon.is_finite()) {
        format!("`epsilon` is {}, expected 0 or more", settings.epsilon)
    } else if settings.step == 0 {
        "`step` is 0, expected to count from 1".into()
    } else {
        return Ok(());
    };
    Err(KernelError::Config {
        op: "adam_step",
        what: wrong,
    })
}

/// Dispatch of [`adam_step`] over the enabled backends.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait AdamUpdate: Backend {
    /// See [`adam_step`]; shapes and settings have been checked.
    fn adam_step(
        param: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        first_moment: FloatTensor<Self>,
        second_moment: FloatTensor<Self>,
        settings: AdamStep,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);

    /// See [`adam_step_unless`]; shapes and settings have been checked.
    #[allow(clippy::too_many_arguments)]
    fn adam_step_unless(
        param: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        first_moment: FloatTensor<Self>,
        second_moment: FloatTensor<Self>,
        flags: FloatTensor<Self>,
        damping: FloatTensor<Self>,
        settings: AdamStep,
        stop: usize,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);

    /// See [`typical_gradient`]; there is an element.
    fn typical_gradient(squares: FloatTensor<Self>, correction: f64) -> FloatTensor<Self>;
}

impl<B: HostBackend> AdamUpdate for B {
    fn adam_step(
        param: FloatTensor<B>,
        grad: FloatTensor<B>,
        first_moment: FloatTensor<B>,
        second_moment: FloatTensor<B>,
        settings: AdamStep,
    ) -> (FloatTensor<B>, FloatTensor<B>, FloatTensor<B>) {
        let grad = B::values(&grad);
        let state = [param, first_moment, second_moment];
        let [param, first_moment, second_moment] = B::change(state, |[param, first, second]| {
            cpu::adam_step(param, &grad, first, second, &settings);
        });
        (param, first_moment, second_moment)
    }

    fn adam_step_unless(
        param: FloatTensor<B>,
        grad: FloatTensor<B>,
        first_moment: FloatTensor<B>,
        second_moment: FloatTensor<B>,
        flags: FloatTensor<B>,
        damping: FloatTensor<B>,
        settings: AdamStep,
        stop: usize,
    ) -> (FloatTensor<B>, FloatTensor<B>, FloatTensor<B>) {
        if B::values(&flags)[stop] != 0.0 {
            return (param, first_moment, second_moment);
        }
        let damping = f64::from(B::values(&damping)[0]);
        let settings = AdamStep {
            epsilon: settings.epsilon + if damping >= 0.0 { damping } else { 0.0 },
            ..settings
        };
        B::adam_step(param, grad, first_moment, second_moment, settings)
    }

    fn typical_gradient(squares: FloatTensor<B>, correction: f64) -> FloatTensor<B> {
        let found = cpu::typical_gradient(&B::values(&squares), correction);
        B::tensor(vec![found], [1], &squares)
    }
}
