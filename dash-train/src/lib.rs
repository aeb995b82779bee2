//! dash-train

pub mod synth;
