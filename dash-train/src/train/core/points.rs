//! Points that Gaussians start from.

/// Points in world units with colours in [0, 1].
#[derive(Debug, Default)]
pub(crate) struct InitialPoints {
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) colors: Vec<[f32; 3]>,
    /// Those of them, the first, that the dataset brought.
    pub(crate) given: usize,
}
