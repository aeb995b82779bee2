//! The errors of this crate.

/// Why there is no window, or no picture in it.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The system can't open a window.
    #[error(
        "no window: {0}; a desktop and a graphics driver are needed (Vulkan; mesa-vulkan-drivers has one without a GPU), or \
         render pictures with `dash render`"
    )]
    Window(String),
    /// The model refused to draw.
    #[error(transparent)]
    Model(#[from] dash_model::ModelError),
    /// The host refused what was asked of it.
    #[error("{0}")]
    Host(String),
}
