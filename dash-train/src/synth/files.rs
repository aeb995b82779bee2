//! Single files: PNG, NPY, PLY, JSON and MP4.

use super::cloud::CloudPoint;
use crate::Error;
use crate::video::{Encoding, VideoWriter, version_status};
use dash_model::unfinished::create_dir_all;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use npyz::WriterBuilder;
use serde::Serialize;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Frame rate of the videos; the Neural 3D Video clips have it.
const VIDEO_FRAMES_PER_SECOND: f64 = 30.0;
/// About 40 dB from the rendered frames at 160x120.
const FOR_TRAINING: Encoding = Encoding {
    // Full chroma: halved, colours would bleed over several pixels of small pictures.
    // One thread: cameras are encoded side by side, and the bytes do not depend on cores.
    // A key frame every half second: training reads frames in random order, and a decoder has to
    // start at the key frame before the one it wants.
    arguments: &[
        "-c:v", "libx264", "-crf", "12", "-pix_fmt", "yuv444p", "-g", "15", "-threads", "1",
    ],
    even_sides: false,
};

fn create(path: &Path) -> Result<BufWriter<File>, Error> {
    if let Some(folder) = path.parent() {
        create_dir_all(folder).map_err(Error::write(folder, "create the folder"))?;
    }
    let file = File::create(path).map_err(Error::write(path, "create the file"))?;
    Ok(BufWriter::new(file))
}

fn finish(mut file: BufWriter<File>, path: &Path) -> Result<(), Error> {
    file.flush().map_err(Error::write(path, "write the file"))
}

/// An 8-bit image; `color` gives the channels of `pixels`.
pub(super) fn write_png(
    path: &Path,
    pixels: &[u8],
    [width, height]: [usize; 2],
    color: ExtendedColorType,
) -> Result<(), Error> {
    let mut encoded = Vec::new();
    let encoder =
        PngEncoder::new_with_quality(&mut encoded, CompressionType::Fast, FilterType::Adaptive);
    encoder
        .write_image(pixels, width as u32, height as u32, color)
        .map_err(|error| Error::ImageEncode {
            path: path.to_path_buf(),
            reason: error.to_string(),
        })?;
    // Apart, so that an error says what the system said.
    let mut file = create(path)?;
    let written = file.write_all(&encoded);
    written.map_err(Error::write(path, "write the file"))?;
    finish(file, path)
}

/// A two-dimensional f64 array.
pub(super) fn write_npy(path: &Path, table: &[f64], columns: usize) -> Result<(), Error> {
    let mut file = create(path)?;
    let write = |file: &mut BufWriter<File>| -> io::Result<()> {
        let mut npy = npyz::WriteOptions::new()
            .default_dtype()
            .shape(&[(table.len() / columns) as u64, columns as u64])
            .writer(file)
            .begin_nd()?;
        npy.extend(table.iter().copied())?;
        npy.finish()
    };
    write(&mut file).map_err(Error::write(path, "write the file"))?;
    finish(file, path)
}

/// A binary little-endian point cloud.
pub(super) fn write_ply(path: &Path, points: &[CloudPoint]) -> Result<(), Error> {
    #[derive(Serialize)]
    struct Ply<'a> {
        vertex: &'a [CloudPoint],
    }
    let mut file = create(path)?;
    let ply = Ply { vertex: points };
    serde_ply::to_writer(&ply, serde_ply::SerializeOptions::binary_le(), &mut file)
        .map_err(|error| Error::write(path, "write the file")(error.0))?;
    finish(file, path)
}

/// Indented JSON.
pub(super) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Error> {
    let mut file = create(path)?;
    serde_json::to_writer_pretty(&mut file, value)
        .map_err(|error| Error::write(path, "write the file")(error.into()))?;
    finish(file, path)
}

/// Text or bytes.
pub(super) fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let mut file = create(path)?;
    file.write_all(bytes)
        .map_err(Error::write(path, "write the file"))?;
    finish(file, path)
}

/// Fails unless `program` starts: before minutes of rendering, not after.
pub(super) fn check_ffmpeg(program: &str) -> Result<(), Error> {
    version_status(program.as_ref())
        .map(|_| ())
        .map_err(|source| Error::FfmpegNotStarted {
            program: program.to_owned(),
            source,
        })
}

/// A video that takes frames as they come.
pub(super) fn video_writer(
    program: &str,
    path: &Path,
    size: [usize; 2],
) -> Result<VideoWriter, Error> {
    VideoWriter::create_with(
        program.as_ref(),
        path,
        size,
        VIDEO_FRAMES_PER_SECOND,
        &FOR_TRAINING,
    )
    .map_err(Error::synth_video)
}
