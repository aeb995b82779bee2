//! Chosen frames of a video as PNG files.

use std::path::{Path, PathBuf};

use super::image_files::write_png;
use super::index::VideoIndex;
use crate::Error;

/// Writes the frames with these ascending numbers to `folder` as `0000.png`, `0001.png` and so on, scaled to `size`.
/// Returns the files: fewer where the video can be decoded only so far, which is told.
///
/// # Errors
/// When not even the first can be decoded, or one can't be written.
pub(crate) fn write_frames(
    video: &VideoIndex,
    folder: &Path,
    frames: &[usize],
    size: Option<[usize; 2]>,
) -> Result<Vec<PathBuf>, Error> {
    let mut written = Vec::with_capacity(frames.len());
    let (Some(&first), Some(&last)) = (frames.first(), frames.last()) else {
        return Ok(written);
    };
    let decoded = video.decode_scaled(first..last + 1, size, |frame, picture| {
        // One frame may be the nearest to several times.
        while frames.get(written.len()) == Some(&frame) {
            let path = folder.join(format!("{:04}.png", written.len()));
            write_png(&path, picture.width, picture.height, &picture.rgb)?;
            written.push(path);
        }
        Ok(())
    });
    match decoded {
        Err(Error::VideoDecode { path, reason, .. }) if !written.is_empty() => {
            let next = frames.get(written.len()).unwrap_or(&last);
            let path = path.display();
            tracing::warn!("{path}: frame {next} could not be decoded, nor what follows: {reason}");
        }
        outcome => outcome?,
    }
    Ok(written)
}
