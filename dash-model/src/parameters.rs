//! A module's parameters by name, for files and optimizers.
//!
//! Works on any Burn module:
//!
//! ```
//! use burn::tensor::Device;
//! use dash_model::mlp::Mlp;
//! use dash_model::parameters::{named_parameters, with_parameters};
//! use rand::SeedableRng;
//!
//! let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
//! let mlp = Mlp::new(&[4, 8, 3], &mut rng, &Device::flex());
//! let mut parameters = named_parameters(&mlp);
//! assert_eq!(parameters["layers.0.weight"].shape, [4, 8]);
//! parameters.get_mut("layers.1.bias").expect("two layers").values.fill(0.5);
//! let mlp = with_parameters(mlp, parameters)?;
//! assert_eq!(named_parameters(&mlp)["layers.1.bias"].values, [0.5; 3]);
//! # Ok::<(), dash_model::ModelError>(())
//! ```

use std::collections::BTreeMap;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Device, Tensor, TensorData};

use crate::ModelError;
use crate::gaussians::to_host;

/// A tensor in host memory.
#[derive(Debug, Clone, PartialEq)]
pub struct HostTensor {
    /// Sizes, outermost first.
    pub shape: Vec<usize>,
    /// Values in row-major order.
    pub values: Vec<f32>,
}

/// Copies all float parameters of a module to the host, by path, such as `dynamic.field.encoder.table`.
pub fn named_parameters<M: Module>(module: &M) -> BTreeMap<String, HostTensor> {
    let mut collector = Collector::default();
    module.visit(&mut collector);
    collector.found
}

/// Replaces every float parameter of `module` by the one of the same name.
///
/// The first size of a tensor may change (sets of Gaussians grow and shrink), the others may not.
///
/// # Errors
/// [`ModelError::Parameter`] for one that is missing, unknown or of another shape.
pub fn with_parameters<M: Module>(
    module: M,
    parameters: BTreeMap<String, HostTensor>,
) -> Result<M, ModelError> {
    let mut loader = Loader {
        path: Path::default(),
        parameters,
        error: None,
    };
    let module = module.map(&mut loader);
    match loader.error {
        Some(error) => Err(error),
        None => match loader.parameters.keys().next() {
            Some(unknown) => Err(ModelError::parameter(unknown, "no such parameter", "one")),
            None => Ok(module),
        },
    }
}

/// A parameter with these values in row-major order.
///
/// The values are sent as one dimension: CUDA pads the rows of tensors of more dimensions, and every kernel would copy such
/// a tensor to read rows without gaps.
pub(crate) fn parameter<const D: usize>(
    values: Vec<f32>,
    shape: [usize; D],
    device: &Device,
) -> Param<Tensor<D>> {
    if values.is_empty() {
        return Param::from_data(TensorData::new(values, shape), device);
    }
    let n = values.len();
    let flat = Tensor::<1>::from_data(TensorData::new(values, [n]), device);
    Param::from_tensor(flat.reshape(shape))
}

/// The path of the module that a visitor is in, for one's own [`ModuleVisitor`] or [`ModuleMapper`].
///
/// # Example
/// ```
/// use dash_model::parameters::Path;
///
/// let mut path = Path::default();
/// path.enter("encoder", "Struct:HashEncoder");
/// path.enter("table", "Struct:Param");
/// assert_eq!(path.name(), "encoder.table");
/// path.exit("Struct:Param");
/// assert_eq!(path.name(), "encoder");
/// ```
#[derive(Default)]
pub struct Path(Vec<String>);

impl Path {
    /// Enters a submodule, with the arguments of [`ModuleVisitor::enter_module`] and [`ModuleMapper::enter_module`].
    /// The variant of an enum adds no name.
    pub fn enter(&mut self, name: &str, container_type: &str) {
        if !container_type.starts_with("Enum:") {
            self.0.push(name.to_string());
        }
    }

    /// Leaves a submodule, with the argument of [`ModuleVisitor::exit_module`].
    pub fn exit(&mut self, container_type: &str) {
        if !container_type.starts_with("Enum:") {
            self.0.pop();
        }
    }

    /// The dotted path.
    pub fn name(&self) -> String {
        self.0.join(".")
    }
}

#[derive(Default)]
struct Collector {
    path: Path,
    found: BTreeMap<String, HostTensor>,
}

impl ModuleVisitor for Collector {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, container_type: &str) {
        self.path.exit(container_type);
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let tensor = param.val();
        let shape = tensor.dims().to_vec();
        let values = to_host(tensor);
        self.found
            .insert(self.path.name(), HostTensor { shape, values });
    }
}

struct Loader {
    path: Path,
    parameters: BTreeMap<String, HostTensor>,
    error: Option<ModelError>,
}

impl ModuleMapper for Loader {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, container_type: &str) {
        self.path.exit(container_type);
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let name = self.path.name();
        let Some(stored) = self.parameters.remove(&name) else {
            let expected = format!("a tensor of {D} dimensions");
            self.error
                .get_or_insert(ModelError::parameter(&name, expected, "none"));
            return param;
        };
        let dims = param.dims();
        if stored.shape.len() != D || stored.shape[1..] != dims[1..] {
            let expected = format!("shape {dims:?} (the first size may differ)");
            let found = format!("{:?}", stored.shape);
            self.error
                .get_or_insert(ModelError::parameter(&name, expected, found));
            return param;
        }
        let shape = std::array::from_fn(|axis| stored.shape[axis]);
        parameter(stored.values, shape, &param.val().device())
    }
}
