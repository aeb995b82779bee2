//! Readers on written fixtures and on real captures.
