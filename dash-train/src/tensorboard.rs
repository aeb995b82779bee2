//! Curves in the event files that TensorBoard reads.
//!
//! A file is a row of records: length, its checksum, an `Event` of protocol buffers, its checksum (`tensorflow/core/lib/io/record_writer.h`,
//! `tensorflow/core/util/event.proto`). Of these messages a curve needs few fields, and those are written here.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use crate::Error;

/// What the first event says.
const VERSION: &str = "brain.Event:2";

/// An event file that grows.
///
/// # Example
/// ```
/// use dash_train::tensorboard::EventFile;
///
/// let folder = std::env::temp_dir().join("dash-events");
/// let mut events = EventFile::create(&folder)?;
/// events.scalars(100, &[("loss", 0.02), ("psnr/training", 27.5)])?;
/// assert!(events.path().starts_with(&folder));
/// # Ok::<(), dash_train::Error>(())
/// ```
#[derive(Debug)]
pub struct EventFile {
    file: File,
    path: PathBuf,
}

impl EventFile {
    /// Begins a new file in a folder, which is made where it is missing.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn create(folder: &Path) -> Result<Self, Error> {
        fs::create_dir_all(folder).map_err(|e| Error::io(folder, "create", e))?;
        let id = std::process::id();
        let name = format!("events.out.tfevents.{:010}.dash.{id}", now() as u64);
        let path = folder.join(name);
        let file = File::options().append(true).create(true).open(&path);
        let file = file.map_err(|e| Error::io(&path, "write", e))?;
        let mut events = Self { file, path };
        let mut event = wall_time();
        put_bytes(&mut event, 3, VERSION.as_bytes());
        events.put(&event)?;
        Ok(events)
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Adds a point to each of these curves.
    ///
    /// # Errors
    /// When it can't be written.
    pub fn scalars(&mut self, step: usize, values: &[(&str, f64)]) -> Result<(), Error> {
        let mut summary = Vec::new();
        for (tag, value) in values {
            let mut one = Vec::new();
            put_bytes(&mut one, 1, tag.as_bytes());
            put_key(&mut one, 2, FIXED_32);
            one.extend((*value as f32).to_le_bytes());
            put_bytes(&mut summary, 1, &one);
        }
        let mut event = wall_time();
        put_key(&mut event, 2, VARINT);
        put_varint(&mut event, step as u64);
        put_bytes(&mut event, 5, &summary);
        self.put(&event)
    }

    fn put(&mut self, event: &[u8]) -> Result<(), Error> {
        // In one write: a reader never meets half a record.
        let written = self.file.write_all(&record(event));
        written.map_err(|e| Error::io(&self.path, "write", e))
    }
}

/// Kinds of values in protocol buffers.
const VARINT: u8 = 0;
const FIXED_64: u8 = 1;
const LENGTH: u8 = 2;
const FIXED_32: u8 = 5;

fn put_key(out: &mut Vec<u8>, field: u8, kind: u8) {
    out.push((field << 3) | kind);
}

fn put_varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn put_bytes(out: &mut Vec<u8>, field: u8, bytes: &[u8]) {
    put_key(out, field, LENGTH);
    put_varint(out, bytes.len() as u64);
    out.extend(bytes);
}

/// Seconds since 1970.
fn now() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0.0, |since| since.as_secs_f64())
}

/// The beginning of an event: when it is.
fn wall_time() -> Vec<u8> {
    let mut event = Vec::new();
    put_key(&mut event, 1, FIXED_64);
    event.extend(now().to_le_bytes());
    event
}

fn record(data: &[u8]) -> Vec<u8> {
    let length = (data.len() as u64).to_le_bytes();
    [
        &length[..],
        &masked(crc32c(&length)).to_le_bytes(),
        data,
        &masked(crc32c(data)).to_le_bytes(),
    ]
    .concat()
}

/// A checksum of data that may hold checksums.
fn masked(crc: u32) -> u32 {
    crc.rotate_right(15).wrapping_add(0xa282_ead8)
}

/// The Castagnoli checksum.
fn crc32c(data: &[u8]) -> u32 {
    const POLYNOMIAL: u32 = 0x82f6_3b78;
    let step = |crc: u32, &byte: &u8| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            (crc >> 1) ^ (POLYNOMIAL & (crc & 1).wrapping_neg())
        })
    };
    !data.iter().fold(u32::MAX, step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_are_those_of_the_standard() {
        // RFC 3720, B.4, and the usual check value.
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&[0xff; 32]), 0x62a8_ab43);
    }

    #[test]
    fn numbers_of_several_bytes() {
        let mut out = Vec::new();
        put_varint(&mut out, 300);
        assert_eq!(out, [0xac, 0x02]);
    }

    #[test]
    fn records_hold_what_was_put() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let mut events = EventFile::create(folder.path()).expect("created");
        events.scalars(7, &[("loss", 0.5)]).expect("written");
        let bytes = fs::read(events.path()).expect("readable");
        let mut rest = &bytes[..];
        let mut found = Vec::new();
        while !rest.is_empty() {
            let length = u64::from_le_bytes(rest[..8].try_into().expect("8 bytes")) as usize;
            assert_eq!(rest[8..12], masked(crc32c(&rest[..8])).to_le_bytes());
            let data = &rest[12..12 + length];
            let sum = &rest[12 + length..16 + length];
            assert_eq!(sum, masked(crc32c(data)).to_le_bytes());
            found.push(data.to_vec());
            rest = &rest[16 + length..];
        }
        assert_eq!(found.len(), 2);
        assert!(found[0].ends_with(b"brain.Event:2"));
        // After the time: step 7, then a summary with one value.
        let value = [&b"\x0a\x04loss\x15"[..], &0.5f32.to_le_bytes()].concat();
        let summary = [&[0x0a, value.len() as u8], &value[..]].concat();
        let event = [&[0x10, 7, 0x2a, summary.len() as u8], &summary[..]].concat();
        assert_eq!(found[1][9..], event);
    }
}
