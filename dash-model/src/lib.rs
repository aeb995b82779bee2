//! dash-model
