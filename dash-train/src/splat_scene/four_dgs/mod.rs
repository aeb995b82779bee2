//! Clips in the open 4D container `.4dgs` (crate `fourdgs`): Gaussians that move along lines within windows of time.
//!
//! Static Gaussians have one window without end. The path of each dynamic one is cut into windows in which a line, one rotation
//! and one size follow it within a stated error ([`fit`]).

mod fit;
mod grid;
mod read;
#[cfg(test)]
mod tests;
mod write;

pub use fit::{Piece, fit};
pub use read::Motions;
pub use write::{ClipOptions, Written, write_clip};

/// Keys of what we add to a file's header.
mod key {
    /// Frames of the clip that was fitted.
    pub const FRAMES: &str = "dash.frames";
    /// Frames per second.
    pub const FRAME_RATE: &str = "dash.frame_rate";
    /// Nearest depth that is drawn, world units.
    pub const NEAR_PLANE: &str = "dash.near_plane";
}
