//! One array of a NumPy archive (`.npz`).

use std::io::Read;
use std::path::Path;

use flate2::read::DeflateDecoder;
use rawzip::{CompressionMethod, ZipArchive};

use crate::Error;
use crate::files::refuse_pointer;

/// Most bytes of an array per byte of its archive: a small file can't fill the memory. Points don't shrink to a tenth.
const MAX_RATIO: u64 = 100;

/// The bytes of the array `name`, a NumPy file, as `numpy.savez` and `numpy.savez_compressed` store it.
///
/// # Errors
/// Names `path` when it is no such archive, is damaged, or has no such array.
pub(crate) fn array(path: &Path, bytes: &[u8], name: &str) -> Result<Vec<u8>, Error> {
    let what = format!("a NumPy archive with the array `{name}`");
    refuse_pointer(path, bytes, &what)?;
    inflated(bytes, &format!("{name}.npy")).map_err(|found| {
        let remedy = format!("write it again with `numpy.savez(FILE, {name}=..)`");
        Error::invalid(path, what, found, remedy)
    })
}

fn inflated(bytes: &[u8], member: &str) -> Result<Vec<u8>, String> {
    let damaged = |e: rawzip::Error| format!("a damaged zip archive: {e}");
    let archive = ZipArchive::from_slice(bytes).map_err(damaged)?;
    for record in archive.entries() {
        let record = record.map_err(damaged)?;
        if record.file_path().as_ref() != member.as_bytes() {
            continue;
        }
        let n_bytes = record.uncompressed_size_hint();
        if n_bytes > MAX_RATIO * bytes.len() as u64 {
            return Err(format!(
                "an array of {n_bytes} bytes in a file of {}",
                bytes.len()
            ));
        }
        let entry = archive.get_entry(record.wayfinder()).map_err(damaged)?;
        let mut array = Vec::new();
        let read = match record.compression_method() {
            CompressionMethod::STORE => entry.data().take(n_bytes).read_to_end(&mut array),
            CompressionMethod::DEFLATE => DeflateDecoder::new(entry.data())
                .take(n_bytes)
                .read_to_end(&mut array),
            other => return Err(format!("an array compressed by {other:?}")),
        };
        read.map_err(|e| format!("an array that can't be unpacked: {e}"))?;
        if array.len() as u64 != n_bytes || rawzip::crc32(&array) != record.crc32() {
            return Err("an array with another checksum than the archive's".into());
        }
        return Ok(array);
    }
    Err("none".into())
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use rawzip::{ZipArchiveWriter, ZipDataWriter};

    use super::*;

    /// As NumPy writes it, stored or compressed.
    fn archive(names: &[&str], method: CompressionMethod) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut archive = ZipArchiveWriter::new(&mut bytes);
        for name in names {
            let (mut entry, config) = archive
                .new_file(name)
                .compression_method(method)
                .start()
                .expect("starts");
            let values = name.repeat(500);
            if method == CompressionMethod::DEFLATE {
                let level = flate2::Compression::default();
                let mut writer = config.wrap(flate2::write::DeflateEncoder::new(&mut entry, level));
                writer.write_all(values.as_bytes()).expect("writes");
                let (encoder, output) = writer.finish().expect("finishes");
                encoder.finish().expect("flushes");
                entry.finish(output).expect("ends");
            } else {
                let mut writer: ZipDataWriter<_> = config.wrap(&mut entry);
                writer.write_all(values.as_bytes()).expect("writes");
                let (_, output) = writer.finish().expect("finishes");
                entry.finish(output).expect("ends");
            }
        }
        archive.finish().expect("ends");
        bytes
    }

    #[test]
    fn an_array_is_found_by_its_name() {
        for method in [CompressionMethod::STORE, CompressionMethod::DEFLATE] {
            let bytes = archive(&["other.npy", "data.npy"], method);
            let read = array(Path::new("a.npz"), &bytes, "data").expect("reads");
            assert_eq!(read, "data.npy".repeat(500).into_bytes(), "{method:?}");
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        let path = Path::new("a.npz");
        let refused = |bytes: &[u8], name: &str| {
            let error = array(path, bytes, name).expect_err("refuses");
            error.to_string()
        };
        let good = archive(&["data.npy"], CompressionMethod::STORE);
        let message = refused(&good, "dat");
        assert!(
            message.contains("a.npz") && message.contains("`dat`"),
            "{message}"
        );
        let mut flipped = good.clone();
        let middle = flipped.len() / 2;
        flipped[middle] ^= 1;
        assert!(refused(&flipped, "data").contains("checksum"));
        for end in 0..good.len() {
            refused(&good[..end], "data");
        }
    }
}
