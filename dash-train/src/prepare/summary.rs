//! What was prepared, for the user.

use std::fmt;
use std::path::PathBuf;

use super::CloudCounts;

/// A prepared dataset, and the assumptions behind it.
#[derive(Debug, Clone, PartialEq)]
pub struct PrepareSummary {
    /// The dataset's folder.
    pub path: PathBuf,
    /// Number of cameras.
    pub n_cameras: usize,
    /// Frames of each camera.
    pub n_frames: usize,
    /// Frames a second.
    pub fps: f64,
    /// Where the poses come from.
    pub poses: String,
    /// Counts of the triangulated points; `None` for random ones.
    pub cloud: Option<CloudCounts>,
    /// Number of points that were written.
    pub n_points: usize,
    /// Names of the cameras that are held out.
    pub held_out: Vec<String>,
    /// What was cut off or assumed.
    pub remarks: Vec<String>,
}

impl fmt::Display for PrepareSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: {} cameras x {} frames at {:.2} frames a second, poses {}",
            self.path.display(),
            self.n_cameras,
            self.n_frames,
            self.fps,
            self.poses
        )?;
        match self.cloud {
            Some(counts) => writeln!(
                f,
                "{} points: of {} triangulated ({:.2} px off on average), {} were doubtful, {} stood alone, {} were \
                 merged",
                counts.kept,
                counts.found,
                counts.mean_error_px,
                counts.doubtful,
                counts.outliers,
                counts.merged
            )?,
            None => writeln!(f, "{} random points where the cameras look", self.n_points)?,
        }
        match &self.held_out[..] {
            [] => write!(f, "no camera is held out for testing")?,
            names => write!(f, "held out for testing: {}", names.join(", "))?,
        }
        self.remarks
            .iter()
            .try_for_each(|remark| write!(f, "\n{remark}"))
    }
}
