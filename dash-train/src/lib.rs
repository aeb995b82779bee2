//! dash-train

pub mod dataset;
pub mod ply;
