//! A module's parameters by name, for files and optimisers.

use std::collections::BTreeMap;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Device, Tensor, TensorData};

/// Row-major values and their shape.
#[derive(Debug, Clone, PartialEq)]
pub struct HostTensor {
    /// Sizes, outermost first.
    pub shape: Vec<usize>,
    /// Values in row-major order.
    pub values: Vec<f32>,
}

/// All float parameters of a module by their path, such as `dynamic.field.encoder.table`.
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
/// The name that is missing or whose shape does not fit, and why.
pub fn with_parameters<M: Module>(
    module: M,
    parameters: BTreeMap<String, HostTensor>,
) -> Result<M, String> {
    let mut loader = Loader {
        path: Path::default(),
        parameters,
        error: None,
    };
    let module = module.map(&mut loader);
    match loader.error {
        Some(error) => Err(error),
        None => match loader.parameters.keys().next() {
            Some(extra) => Err(format!("`{extra}`, which this model does not have")),
            None => Ok(module),
        },
    }
}

/// A parameter with these values in row-major order. CUDA pads the rows of what it is sent in more than one dimension, and
/// kernels, which read rows without gaps, would copy it whenever it is used; this is sent in one.
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

/// The path of the module being visited.
#[derive(Default)]
pub struct Path(Vec<String>);

impl Path {
    /// Enters a submodule, as [`ModuleVisitor::enter_module`] and [`ModuleMapper::enter_module`] are told.
    /// The choice that an enum makes has no name of its own: what is in it does.
    pub fn enter(&mut self, name: &str, container_type: &str) {
        if !container_type.starts_with("Enum:") {
            self.0.push(name.to_string());
        }
    }

    /// Leaves it.
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
        let values = crate::gaussians::to_host(tensor);
        self.found
            .insert(self.path.name(), HostTensor { shape, values });
    }
}

struct Loader {
    path: Path,
    parameters: BTreeMap<String, HostTensor>,
    error: Option<String>,
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
            self.error.get_or_insert(format!("no `{name}`"));
            return param;
        };
        let expected = param.dims();
        if stored.shape.len() != D || stored.shape[1..] != expected[1..] {
            self.error.get_or_insert(format!(
                "`{name}` of shape {:?}, not {expected:?}",
                stored.shape
            ));
            return param;
        }
        let shape = std::array::from_fn(|axis| stored.shape[axis]);
        parameter(stored.values, shape, &param.val().device())
    }
}
