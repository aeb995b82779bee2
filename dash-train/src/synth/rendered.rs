//! Rendered pictures, and the part of them that the frames of a camera share.

use dash_kernels::Camera;

/// A rendered view. All buffers are row-major, one entry per pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    /// Picture width.
    pub width: usize,
    /// Picture height.
    pub height: usize,
    /// sRGB, three bytes per pixel, samples averaged in linear light.
    pub rgb: Vec<u8>,
    /// Whether a moving object is the nearest surface in at least half of the pixel's samples.
    pub moving: Vec<bool>,
    /// Whether one that moves, or changes its colour where it stands, is in any sample; elsewhere colours change with the
    /// lamp alone.
    pub touched: Vec<bool>,
    /// Depth (camera z, metres) of the pixel's centre; infinite where nothing is hit.
    pub depth: Vec<f32>,
}

/// The resting objects as a camera sees them, shared by all of its frames with the same light.
pub(super) struct Rest {
    /// The view without the moving objects.
    pub(super) view: Rendered,
    /// Per pixel, a depth that no sample's surface is nearer than.
    pub(super) nearest: Vec<f32>,
    /// Per pixel, a depth that no sample's surface is further than.
    pub(super) farthest: Vec<f32>,
}

impl Rendered {
    /// A picture of the camera's size in which nothing is seen.
    pub(super) fn empty(camera: &Camera) -> Self {
        let pixels = camera.width * camera.height;
        Self {
            width: camera.width,
            height: camera.height,
            rgb: vec![0; 3 * pixels],
            moving: vec![false; pixels],
            touched: vec![false; pixels],
            depth: vec![f32::INFINITY; pixels],
        }
    }

    /// Becomes a copy of a view of the same size.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.rgb.copy_from_slice(&other.rgb);
        self.moving.copy_from_slice(&other.moving);
        self.touched.copy_from_slice(&other.touched);
        self.depth.copy_from_slice(&other.depth);
    }

    /// Share of the pixels that are moving.
    pub fn moving_share(&self) -> f64 {
        let moving = self.moving.iter().filter(|m| **m).count();
        moving as f64 / self.moving.len().max(1) as f64
    }
}
