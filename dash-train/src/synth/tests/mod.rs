//! Scenes, pictures and datasets against what is exactly known about them.

mod datasets;
mod layouts;
mod scenes;
