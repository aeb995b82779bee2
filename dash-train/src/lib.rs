//! dash-train

pub mod cameras;
pub mod metrics;
pub mod video;
