//! Damaged and clean scenes.
