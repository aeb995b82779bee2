//! The values of a pickle. They live in a list and refer to each other by index, so that sharing costs
//! nothing and nesting has no depth.

/// Index of a value.
pub(super) type Id = usize;

/// A value of a pickle.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    None,
    Bool(bool),
    Int(i64),
    Text(String),
    Tuple(Vec<Id>),
    List(Vec<Id>),
    /// Keys and values in the order they were set.
    Dict(Vec<(Id, Id)>),
    Name(Name),
    Storage(Storage),
    Tensor(Strided),
    /// A number that nothing here needs.
    Other,
}

/// A name of Python or PyTorch that a pickle may mention.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Name {
    OrderedDict,
    RebuildTensor,
    Parameter,
    Storage(Element),
}

/// Type of a storage's elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Element {
    /// PyTorch's name for such storages.
    pub storage: &'static str,
    /// Bytes of one.
    pub bytes: u64,
}

/// The only storage whose values are of use.
pub(super) const FLOAT_STORAGE: &str = "FloatStorage";

/// The types that state dictionaries have.
pub(super) const ELEMENTS: [Element; 10] = [
    element(FLOAT_STORAGE, 4),
    element("DoubleStorage", 8),
    element("HalfStorage", 2),
    element("BFloat16Storage", 2),
    element("LongStorage", 8),
    element("IntStorage", 4),
    element("ShortStorage", 2),
    element("CharStorage", 1),
    element("ByteStorage", 1),
    element("BoolStorage", 1),
];

const fn element(storage: &'static str, bytes: u64) -> Element {
    Element { storage, bytes }
}

/// A run of elements that the file holds outside the pickle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Storage {
    /// Its name, a text.
    pub key: Id,
    /// How many elements.
    pub n_elements: u64,
    /// Of what type.
    pub element: Element,
}

/// A tensor as a view of a storage.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Strided {
    /// The storage.
    pub storage: Id,
    /// Its first element.
    pub offset: u64,
    /// Sizes, outermost first.
    pub shape: Vec<usize>,
    /// Elements from one index to the next, of each dimension.
    pub strides: Vec<u64>,
}

impl Value {
    /// What it is, for errors.
    pub(super) fn kind(&self) -> &'static str {
        match self {
            Self::None => "nothing",
            Self::Bool(_) | Self::Int(_) | Self::Other => "a number",
            Self::Text(_) => "a text",
            Self::Tuple(_) => "a tuple",
            Self::List(_) => "a list",
            Self::Dict(_) => "a dictionary",
            Self::Name(_) => "a name",
            Self::Storage(_) => "a storage",
            Self::Tensor(_) => "a tensor",
        }
    }
}
