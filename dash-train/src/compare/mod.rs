//! Methods for dynamic scenes on the same data, at the same cost.

mod method;

pub use method::Method;
