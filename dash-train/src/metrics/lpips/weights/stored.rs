//! Where the values of a tensor are in a file.

/// Bytes of a 32-bit float.
pub(super) const FLOAT_BYTES: u64 = 4;
/// What failed, for an [`Error::Io`].
pub(super) const READ_WEIGHTS: &str = "read the LPIPS weights";

/// Where a tensor's values are in a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Place {
    /// 32-bit little-endian floats in row-major order from this byte on, within the file.
    Floats {
        /// Byte of the first value.
        offset: u64,
        /// Checksum of the values' bytes, where the file has one.
        crc32: Option<u32>,
    },
    /// Not as they are needed; what is there instead.
    Other(String),
}

/// A tensor that a file holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct StoredTensor {
    /// Sizes, outermost first.
    pub shape: Vec<usize>,
    /// Where its values are.
    pub place: Place,
}

/// Bytes of a tensor of 32-bit floats; `None` when there are more than a file can have.
pub(super) fn float_bytes(shape: &[usize]) -> Option<u64> {
    shape.iter().try_fold(FLOAT_BYTES, |bytes, &side| {
        bytes.checked_mul(u64::try_from(side).ok()?)
    })
}
