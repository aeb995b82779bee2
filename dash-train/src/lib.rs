//! dash-train
