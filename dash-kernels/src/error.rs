//! Errors of the kernels.

/// What an operation refuses, one variant for each kind of mistake.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum KernelError {
    /// A tensor's shape does not fit the operation.
    #[error(
        "{op}: `{tensor}` has shape {found:?}, expected {expected}; check the argument order and sizes"
    )]
    Shape {
        /// The operation.
        op: &'static str,
        /// The tensor.
        tensor: &'static str,
        /// The shape expected.
        expected: String,
        /// The shape found.
        found: Vec<usize>,
    },
    /// A tensor or list exceeds the device's largest buffer.
    #[error(
        "{what} needs a buffer of {bytes} bytes, the device's largest has {limit}; {remedy}, or use the CPU"
    )]
    Limit {
        /// The tensor or list that is too large.
        what: &'static str,
        /// Its size in bytes.
        bytes: u64,
        /// The device's limit in bytes.
        limit: u64,
        /// How to make it smaller.
        remedy: &'static str,
    },
    /// A setting is out of range.
    #[error("{op}: {what}")]
    Config {
        /// The operation.
        op: &'static str,
        /// The setting, the value found and the range expected.
        what: String,
    },
    /// A camera can't be drawn from, or its pose is no rigid transform.
    #[error("camera: {what}")]
    Camera {
        /// The value found and what was expected.
        what: String,
    },
    /// A list of rows does not fit the tensor.
    #[error("{op}: {what}")]
    Rows {
        /// The operation.
        op: &'static str,
        /// The row found and what was expected.
        what: String,
    },
}
