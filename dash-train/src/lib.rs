pub mod cameras;
pub mod dataset;
mod error;
pub mod metrics;
pub mod ply;
pub mod synth;
pub mod train;
pub mod video;
