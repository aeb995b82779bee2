//! Rows of COLMAP's model files.

/// A row of `cameras.bin` or `cameras.txt`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ModelCamera {
    pub(crate) id: u32,
    pub(crate) model: String,
    pub(crate) width: u64,
    pub(crate) height: u64,
    pub(crate) parameters: Vec<f64>,
}

/// A row of `images.bin` or `images.txt`: the pose is world to camera, OpenCV axes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ModelImage {
    /// (w, x, y, z).
    pub(crate) quaternion: [f64; 4],
    pub(crate) translation: [f64; 3],
    pub(crate) camera_id: u32,
    pub(crate) name: String,
}

/// Name and number of parameters of COLMAP's camera models, by their ids.
pub(crate) fn parameter_names(model: u32) -> Option<(&'static str, usize)> {
    const MODELS: [(&str, usize); 18] = [
        ("SIMPLE_PINHOLE", 3),
        ("PINHOLE", 4),
        ("SIMPLE_RADIAL", 4),
        ("RADIAL", 5),
        ("OPENCV", 8),
        ("OPENCV_FISHEYE", 8),
        ("FULL_OPENCV", 12),
        ("FOV", 5),
        ("SIMPLE_RADIAL_FISHEYE", 4),
        ("RADIAL_FISHEYE", 5),
        ("THIN_PRISM_FISHEYE", 12),
        ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
        ("SIMPLE_DIVISION", 4),
        ("DIVISION", 5),
        ("SIMPLE_FISHEYE", 3),
        ("FISHEYE", 4),
        ("EUCM", 6),
        ("EQUIRECTANGULAR", 2),
    ];
    MODELS.get(model as usize).copied()
}
