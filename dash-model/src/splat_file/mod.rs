//! Files of Gaussians by the kind that their name ends with.

mod axes;
mod glb;
mod raw;
mod spz;
#[cfg(test)]
mod tests;

use std::fmt;
use std::path::Path;

use crate::splat_ply::{SplatFile, read_splat_ply, write_splat_ply};
use crate::{GaussianRows, ModelError};

/// A kind of files of Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SplatFormat {
    /// The standard 3DGS PLY; when read SuperSplat's compressed one, too.
    Ply,
    /// Niantic's SPZ, version 3: 8 to 24 bits a value, gzipped; about a tenth of a PLY.
    Spz,
    /// The `.splat` of antimatter15's viewer: 32 bytes a Gaussian, one colour for all directions.
    Splat,
    /// glTF 2.0 with `KHR_gaussian_splatting`, single precision.
    Glb,
}

impl SplatFormat {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Ply, Self::Spz, Self::Splat, Self::Glb];

    /// The kind that a name's ending says, in any case; `None` where it says none of them.
    pub fn of(path: &Path) -> Option<Self> {
        let ending = path.extension()?.to_str()?.to_ascii_lowercase();
        let mut all = Self::ALL.into_iter();
        all.find(|format| format.extension() == ending)
    }

    /// The ending of its files, without the dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Spz => "spz",
            Self::Splat => "splat",
            Self::Glb => "glb",
        }
    }
}

impl fmt::Display for SplatFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.extension())
    }
}

/// Reads a file of Gaussians of the kind that its name says.
///
/// # Errors
/// [`ModelError::Io`] or [`ModelError::Format`], the latter also where the name says no kind.
pub fn read_splats(path: &Path) -> Result<SplatFile, ModelError> {
    match SplatFormat::of(path) {
        Some(SplatFormat::Ply) => read_splat_ply(path),
        Some(SplatFormat::Spz) => spz::read(path),
        Some(SplatFormat::Splat) => raw::read(path),
        Some(SplatFormat::Glb) => glb::read(path),
        None => Err(unknown(path)),
    }
}

/// Writes a file of Gaussians of the kind that its name says, through a sibling scratch file.
///
/// A PLY keeps all values. SPZ rounds them, and `.splat` has no higher colour coefficients. Only a PLY says the near plane (world
/// units), see [`write_splat_ply`].
///
/// # Errors
/// [`ModelError::Io`]; [`ModelError::Format`] where the name says no kind.
///
/// # Example
/// ```
/// use dash_model::{GaussianRows, read_splats, write_splats};
///
/// let rows = GaussianRows::from_points(&[[0.0, 0.0, 1.0]], &[[0.9, 0.3, 0.1]], 0, 0.1);
/// let path = std::env::temp_dir().join(format!("one-{}.spz", std::process::id()));
/// write_splats(&path, &rows, 0.01)?;
/// assert_eq!(read_splats(&path)?.rows.len(), 1);
/// # std::fs::remove_file(path).expect("it was written");
/// # Ok::<(), dash_model::ModelError>(())
/// ```
pub fn write_splats(path: &Path, rows: &GaussianRows, near_plane: f64) -> Result<(), ModelError> {
    match SplatFormat::of(path) {
        Some(SplatFormat::Ply) => write_splat_ply(path, rows, near_plane),
        Some(SplatFormat::Spz) => spz::write(path, rows),
        Some(SplatFormat::Splat) => raw::write(path, rows),
        Some(SplatFormat::Glb) => glb::write(path, rows),
        None => Err(unknown(path)),
    }
}

fn unknown(path: &Path) -> ModelError {
    let endings = SplatFormat::ALL.map(|format| format!(".{format}"));
    let found = path.extension().unwrap_or_default().to_string_lossy();
    ModelError::format(
        path,
        format!("a name that ends in one of {}", endings.join(", ")),
        format!("`{found}`"),
    )
}

/// The sigmoid of a logit.
fn opacity(logit: f32) -> f32 {
    1.0 / (1.0 + (-logit).exp())
}

/// The logit of an opacity: infinite at 0 and 1.
fn logit_of(opacity: f32) -> f32 {
    (opacity / (1.0 - opacity)).ln()
}

/// A quaternion of length one; that of no rotation in place of zeros.
fn unit(quat: [f32; 4]) -> [f32; 4] {
    let length = quat
        .iter()
        .map(|q| f64::from(*q).powi(2))
        .sum::<f64>()
        .sqrt();
    match length > 0.0 {
        true => quat.map(|q| (f64::from(q) / length) as f32),
        false => [1.0, 0.0, 0.0, 0.0],
    }
}

/// A value in 8 bits, rounded and clamped.
fn byte(value: f32) -> u8 {
    value.round() as u8
}
