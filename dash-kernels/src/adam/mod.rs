//! One step of the Adam optimiser, fused.

mod cpu;
#[cfg(feature = "cube")]
mod cube;
pub mod reference;
#[cfg(test)]
mod tests;

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, DispatchTensor, backend_extension};
use burn::tensor::Tensor;

use crate::KernelError;
use crate::host::HostBackend;
use crate::tensor_list::TensorList;

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

/// A parameter, its gradient and its moments, all of one length, and how it is stepped.
#[derive(Debug)]
pub struct Parameter {
    /// The values.
    pub param: Tensor<1>,
    /// Their gradient.
    pub grad: Tensor<1>,
    /// First moments.
    pub first_moment: Tensor<1>,
    /// Second moments.
    pub second_moment: Tensor<1>,
    /// Settings of its step.
    pub settings: AdamStep,
    /// Added to epsilon, `[1]`, where only the device knows it; negative numbers and NaN count as zero.
    pub damping: Option<Tensor<1>>,
}

/// A flag of the device that stops steps where it is not zero.
#[derive(Debug, Clone)]
pub struct Stop {
    /// Flags `[F]`, as [`raise_flags`](crate::finite::raise_flags) raises them.
    pub flags: Tensor<1>,
    /// The place of the flag.
    pub at: usize,
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
    let tensors = [param, grad, first_moment, second_moment].map(Tensor::into_dispatch);
    let steps = Steps {
        each: vec![(*settings, false)],
        stop: None,
    };
    let stepped = run(tensors.into(), steps).pop();
    let (param, first_moment, second_moment) = stepped.expect("one parameter was given");
    Ok((
        Tensor::from_dispatch(param),
        Tensor::from_dispatch(first_moment),
        Tensor::from_dispatch(second_moment),
    ))
}

/// [`adam_step`] of many parameters at once: on a GPU in few launches. Where `stop` is a flag of the device that is
/// raised, nothing changes. Nothing is read back.
///
/// # Errors
/// [`KernelError::Shape`] when lengths differ, a damping is not one number or the flag is not there,
/// [`KernelError::Config`] when a setting is out of range.
///
/// # Panics
/// On tensors of an autodiff device.
///
/// # Example
/// ```
/// use burn::tensor::{Device, Tensor};
/// use dash_kernels::adam::{AdamStep, Parameter, Stop, adam_steps};
///
/// let device = Device::flex();
/// let parameter = |gradient: f32| Parameter {
///     param: Tensor::zeros([1], &device),
///     grad: Tensor::from_floats([gradient], &device),
///     first_moment: Tensor::zeros([1], &device),
///     second_moment: Tensor::zeros([1], &device),
///     settings: AdamStep { learning_rate: 0.5, ..AdamStep::default() },
///     damping: None,
/// };
/// let after = |flag: f32| {
///     let stop = Stop { flags: Tensor::from_floats([flag], &device), at: 0 };
///     let stepped = adam_steps(vec![parameter(0.3), parameter(-5.0)], Some(&stop))?;
///     let values = stepped.into_iter().map(|(param, ..)| param.into_scalar::<f32>());
///     Ok::<Vec<f32>, dash_kernels::KernelError>(values.collect())
/// };
/// assert_eq!(after(0.0)?, [-0.5, 0.5]);
/// assert_eq!(after(1.0)?, [0.0, 0.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn adam_steps(
    parameters: Vec<Parameter>,
    stop: Option<&Stop>,
) -> Result<Vec<Stepped<1>>, KernelError> {
    let (mut tensors, mut each) = (Vec::new(), Vec::new());
    if let Some(stop) = stop {
        check_vector("flags", &stop.flags, |n| n > stop.at, stop.at + 1)?;
        tensors.push(stop.flags.clone().into_dispatch());
    }
    for parameter in parameters {
        let moments = [&parameter.first_moment, &parameter.second_moment];
        check_shapes(&parameter.param, [&parameter.grad, moments[0], moments[1]])?;
        validate(&parameter.settings)?;
        if let Some(damping) = &parameter.damping {
            check_vector("damping", damping, |n| n == 1, 1)?;
        }
        let Parameter {
            param,
            grad,
            first_moment,
            second_moment,
            settings,
            damping,
        } = parameter;
        each.push((settings, damping.is_some()));
        let state = [param, grad, first_moment, second_moment];
        let all = state.into_iter().chain(damping);
        tensors.extend(all.map(Tensor::into_dispatch));
    }
    if each.is_empty() {
        return Ok(Vec::new());
    }
    let stop = stop.map(|stop| stop.at);
    let stepped = run(tensors, Steps { each, stop }).into_iter();
    let tensor = Tensor::from_dispatch;
    Ok(stepped
        .map(|(param, first, second)| (tensor(param), tensor(first), tensor(second)))
        .collect())
}

/// New parameters and moments, of the tensors of [`AdamUpdate::adam_steps`].
fn run(
    tensors: Vec<DispatchTensor>,
    steps: Steps,
) -> Vec<(DispatchTensor, DispatchTensor, DispatchTensor)> {
    let mut stepped = Dispatch::adam_steps(TensorList(tensors), steps).into_iter();
    let mut found = Vec::new();
    while let (Some(param), Some(first), Some(second)) =
        (stepped.next(), stepped.next(), stepped.next())
    {
        found.push((param, first, second));
    }
    found
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

fn check_vector(
    name: &'static str,
    found: &Tensor<1>,
    fits: impl Fn(usize) -> bool,
    expected: usize,
) -> Result<(), KernelError> {
    let [n] = found.dims();
    if fits(n) {
        return Ok(());
    }
    Err(KernelError::Shape {
        op: "adam_steps",
        tensor: name,
        expected: format!("[{expected}]"),
        found: vec![n],
    })
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

/// How parameters are stepped.
#[derive(Debug, Clone)]
pub struct Steps {
    /// Settings of each parameter, and whether it has a damping.
    pub each: Vec<(AdamStep, bool)>,
    /// The place of the flag that stops all.
    pub stop: Option<usize>,
}

/// Dispatch of [`adam_step`] and [`adam_steps`] over the enabled backends.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub trait AdamUpdate: Backend {
    /// See [`adam_steps`]; shapes and settings have been checked, and there is a parameter. `tensors` are the flags, where
    /// there are any, then for each parameter the parameter, its gradient, first and second moments and its damping, where
    /// it has one. Gives for each the new parameter and moments.
    fn adam_steps(
        #[extension_type] tensors: TensorList<Self>,
        steps: Steps,
    ) -> Vec<FloatTensor<Self>>;

    /// See [`typical_gradient`]; there is an element.
    fn typical_gradient(squares: FloatTensor<Self>, correction: f64) -> FloatTensor<Self>;
}

/// A parameter's tensors: itself and its moments, its gradient and its damping.
struct OneOf<T> {
    state: [T; 3],
    grad: T,
    damping: Option<T>,
}

/// The flags, and the tensors of each parameter.
fn sorted<T>(tensors: Vec<T>, steps: &Steps) -> (Option<T>, Vec<OneOf<T>>) {
    let mut tensors = tensors.into_iter();
    let mut next = || tensors.next().expect("each parameter brings its tensors");
    let flags = steps.stop.map(|_| next());
    let each = steps.each.iter().map(|(_, is_damped)| {
        let [param, grad, first, second] = [(); 4].map(|()| next());
        OneOf {
            state: [param, first, second],
            grad,
            damping: is_damped.then(&mut next),
        }
    });
    let each = each.collect();
    (flags, each)
}

impl<B: HostBackend> AdamUpdate for B {
    fn adam_steps(TensorList(tensors): TensorList<B>, steps: Steps) -> Vec<FloatTensor<B>> {
        let (flags, each) = sorted(tensors, &steps);
        let raised = flags.zip(steps.stop);
        if raised.is_some_and(|(flags, stop)| B::values(&flags)[stop] != 0.0) {
            return each.into_iter().flat_map(|one| one.state).collect();
        }
        let stepped = each
            .into_iter()
            .zip(steps.each)
            .map(|(one, (settings, _))| {
                let damping = one.damping.map_or(0.0, |damping| B::values(&damping)[0]);
                let damping = if damping >= 0.0 {
                    f64::from(damping)
                } else {
                    0.0
                };
                let settings = AdamStep {
                    epsilon: settings.epsilon + damping,
                    ..settings
                };
                let grad = B::values(&one.grad);
                B::change(one.state, |[param, first, second]| {
                    cpu::adam_step(param, &grad, first, second, &settings);
                })
            });
        stepped.flatten().collect()
    }

    fn typical_gradient(squares: FloatTensor<B>, correction: f64) -> FloatTensor<B> {
        let found = cpu::typical_gradient(&B::values(&squares), correction);
        B::tensor(vec![found], [1], &squares)
    }
}
