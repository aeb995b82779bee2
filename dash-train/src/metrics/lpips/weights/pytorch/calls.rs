//! The names that a pickle may mention, and what becomes of calls of them: none is made.

use super::pickle::Machine;
use super::value::{ELEMENTS, Id, Name, Storage, Strided, Value};

/// Most dimensions of a tensor.
const MAX_DIMENSIONS: usize = 8;

impl Machine<'_> {
    /// A name, which is only recognised: nothing is looked up or called.
    pub(super) fn name(&mut self) -> Result<(), String> {
        let (module, name) = (self.line()?, self.line()?);
        let known = match (module.as_str(), name.as_str()) {
            ("collections", "OrderedDict") => Name::OrderedDict,
            // The first wrote PyTorch up to 0.3, the second all since.
            ("torch._utils", "_rebuild_tensor" | "_rebuild_tensor_v2") => Name::RebuildTensor,
            // Around each tensor in torchvision's files of 2017, and where parameters were saved.
            ("torch.nn.parameter", "Parameter") | ("torch._utils", "_rebuild_parameter") => {
                Name::Parameter
            }
            ("torch", storage) => ELEMENTS
                .into_iter()
                .find(|element| element.storage == storage)
                .map(Name::Storage)
                .ok_or_else(|| refused(&module, &name))?,
            _ => return Err(refused(&module, &name)),
        };
        self.push(Value::Name(known))
    }

    /// A storage from `("storage", type, key, location, number of elements[, None])`.
    pub(super) fn storage(&mut self) -> Result<(), String> {
        let wrong = || "a reference to no storage".to_string();
        let reference = self.pop()?;
        let Value::Tuple(parts) = &self.values[reference] else {
            return Err(wrong());
        };
        let (kind, element, key, n_elements) = match parts[..] {
            [kind, element, key, _, n_elements] => (kind, element, key, n_elements),
            [kind, element, key, _, n_elements, view] => {
                if self.values[view] != Value::None {
                    return Err("a view of a storage, which no published weight file has".into());
                }
                (kind, element, key, n_elements)
            }
            _ => return Err(wrong()),
        };
        let is_storage = matches!(&self.values[kind], Value::Text(kind) if kind == "storage");
        match (
            &self.values[element],
            &self.values[key],
            self.count(n_elements),
        ) {
            (&Value::Name(Name::Storage(element)), Value::Text(_), Some(n_elements))
                if is_storage =>
            {
                self.push(Value::Storage(Storage {
                    key,
                    n_elements,
                    element,
                }))
            }
            _ => Err(wrong()),
        }
    }

    /// A call with the arguments on the stack.
    pub(super) fn reduce(&mut self) -> Result<(), String> {
        let arguments = self.pop()?;
        let name = self.pop()?;
        let (Value::Name(name), Value::Tuple(arguments)) =
            (&self.values[name], &self.values[arguments])
        else {
            return Err("a call of something that is no name".into());
        };
        match (name, &arguments[..]) {
            (Name::OrderedDict, []) => self.push(Value::Dict(Vec::new())),
            (Name::OrderedDict, &[pairs]) => self.ordered_dict(pairs),
            (Name::RebuildTensor, &[storage, offset, shape, strides, ..]) => {
                self.tensor(storage, offset, shape, strides)
            }
            (Name::Parameter, &[tensor, ..]) if matches!(self.values[tensor], Value::Tensor(_)) => {
                self.stack.push(tensor);
                Ok(())
            }
            (name, arguments) => Err(format!("{name:?} of {} values", arguments.len())),
        }
    }

    /// A dictionary from a list of pairs, as Python 2 wrote it.
    fn ordered_dict(&mut self, pairs: Id) -> Result<(), String> {
        let pairs = self.items(pairs)?;
        let mut dict = Vec::with_capacity(pairs.len());
        for pair in pairs {
            match self.items(pair)?[..] {
                [key, value] => dict.push((key, value)),
                _ => return Err("a dictionary of what are no pairs".into()),
            }
        }
        self.push(Value::Dict(dict))
    }

    fn tensor(&mut self, storage: Id, offset: Id, shape: Id, strides: Id) -> Result<(), String> {
        let sizes = |items: Vec<Id>| -> Option<Vec<u64>> {
            items.into_iter().map(|item| self.count(item)).collect()
        };
        let wrong = || "a tensor without storage, shape or strides".to_string();
        let (shape, strides) = {
            let (shape, strides) = (self.tuple(shape)?, self.tuple(strides)?);
            if shape.len() != strides.len() || shape.len() > MAX_DIMENSIONS {
                return Err(format!("a tensor of {} dimensions", shape.len()));
            }
            (
                sizes(shape).ok_or_else(wrong)?,
                sizes(strides).ok_or_else(wrong)?,
            )
        };
        let shape: Option<Vec<usize>> = shape
            .into_iter()
            .map(|side| usize::try_from(side).ok())
            .collect();
        let offset = self.count(offset).ok_or_else(wrong)?;
        if !matches!(self.values[storage], Value::Storage(_)) {
            return Err(wrong());
        }
        self.push(Value::Tensor(Strided {
            storage,
            offset,
            shape: shape.ok_or_else(wrong)?,
            strides,
        }))
    }

    /// The few items of a tuple.
    fn tuple(&self, id: Id) -> Result<Vec<Id>, String> {
        match &self.values[id] {
            Value::Tuple(items) if items.len() <= MAX_DIMENSIONS => Ok(items.clone()),
            other => Err(format!("{} where a shape should be", other.kind())),
        }
    }

    /// A copy of a list's or tuple's items. References can ask for the same ones again and again, so
    /// that what is copied in all is bounded by what the pickle holds.
    fn items(&mut self, id: Id) -> Result<Vec<Id>, String> {
        let (Value::List(items) | Value::Tuple(items)) = &self.values[id] else {
            return Err(format!("{} where a list should be", self.values[id].kind()));
        };
        self.copied += items.len();
        if self.copied > self.bytes.len() {
            return Err("more references than a weight file has".into());
        }
        Ok(items.clone())
    }

    fn count(&self, id: Id) -> Option<u64> {
        match self.values[id] {
            Value::Int(value) => value.try_into().ok(),
            _ => None,
        }
    }
}

fn refused(module: &str, name: &str) -> String {
    format!("the name `{module}.{name}`; only tensors are read, and nothing is executed")
}
