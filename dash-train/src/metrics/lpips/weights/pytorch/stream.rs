//! The stream that PyTorch wrote from version 0.1.10 up to 1.5: pickles of a magic number, a
//! version, the machine's number formats, the dictionary and the storages' names; then, in the
//! order of those names, each storage as its number of elements and its bytes.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use super::super::stored::{READ_WEIGHTS, StoredTensor};
use super::pickle::Pickle;
use super::tensors::{Span, locate};
use super::value::{Storage, Value};
use super::{EXPECTED, MAX_PICKLE_BYTES};
use crate::Error;

/// The pickle of the magic number 0x1950a86a20f9469cfc6c.
pub(super) const MAGIC: [u8; 15] = [
    0x80, 2, 0x8a, 10, 0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19, b'.',
];
/// The version of the stream, the only one there has been.
pub(super) const VERSION: i64 = 1001;
/// Bytes of a storage's number of elements.
const COUNT_BYTES: u64 = 8;

/// What a stream holds, by its name.
pub(in super::super) fn directory(
    path: &Path,
    file: &mut File,
    n_bytes: u64,
) -> Result<BTreeMap<String, StoredTensor>, Error> {
    let wrong = |found: String| Error::weight_file(path, EXPECTED, found);
    let io = |e| Error::io(path, READ_WEIGHTS, e);
    let mut start = Vec::new();
    file.seek(SeekFrom::Start(0)).map_err(io)?;
    file.by_ref()
        .take(MAX_PICKLE_BYTES)
        .read_to_end(&mut start)
        .map_err(io)?;
    let mut rest = start
        .strip_prefix(&MAGIC)
        .ok_or_else(|| wrong("a pickle that is no weight file of PyTorch".into()))?;
    let mut next = || -> Result<Pickle, Error> {
        let pickle = Pickle::load(rest).map_err(&wrong)?;
        rest = &rest[pickle.n_bytes..];
        Ok(pickle)
    };
    let version = next()?;
    if *version.root() != Value::Int(VERSION) {
        return Err(wrong("a stream of another version".into()));
    }
    if !is_little_endian(&next()?) {
        return Err(wrong("numbers in big-endian order".into()));
    }
    let tensors = next()?;
    let names = next()?;
    let data_start = (start.len() - rest.len()) as u64;
    let mut storages = Storages {
        file,
        n_bytes,
        declared: declared(&tensors),
    };
    let spans = storages.walk(&names, data_start).map_err(wrong)?;
    locate(&tensors, |key| {
        spans
            .get(key)
            .copied()
            .ok_or_else(|| format!("a tensor whose storage `{key}` is not there"))
    })
    .map_err(wrong)
}

fn is_little_endian(system: &Pickle) -> bool {
    let Value::Dict(entries) = system.root() else {
        return false;
    };
    entries.iter().any(|&(key, value)| {
        matches!(&system.values[key], Value::Text(key) if key == "little_endian")
            && system.values[value] == Value::Bool(true)
    })
}

/// The storages that a pickle mentions, by their names.
fn declared(pickle: &Pickle) -> HashMap<&str, Storage> {
    let storages = pickle.values.iter().filter_map(|value| match value {
        Value::Storage(storage) => match &pickle.values[storage.key] {
            Value::Text(name) => Some((name.as_str(), *storage)),
            _ => None,
        },
        _ => None,
    });
    storages.collect()
}

struct Storages<'a> {
    file: &'a mut File,
    n_bytes: u64,
    declared: HashMap<&'a str, Storage>,
}

impl Storages<'_> {
    /// Where each storage is, from their names in the order of the file.
    fn walk(&mut self, names: &Pickle, start: u64) -> Result<HashMap<String, Span>, String> {
        let Value::List(ids) = names.root() else {
            return Err(format!(
                "{} instead of the storages' names",
                names.root().kind()
            ));
        };
        let mut spans = HashMap::with_capacity(ids.len());
        let mut offset = start;
        for &id in ids {
            let Value::Text(name) = &names.values[id] else {
                return Err(format!("{} as a storage's name", names.values[id].kind()));
            };
            let storage = self
                .declared
                .get(name.as_str())
                .ok_or_else(|| format!("a storage `{name}` that no tensor has"))?;
            let bytes = storage.n_elements.checked_mul(storage.element.bytes);
            let first = offset + COUNT_BYTES;
            let end = bytes.and_then(|bytes| first.checked_add(bytes));
            let end = end.filter(|&end| end <= self.n_bytes).ok_or_else(|| {
                format!(
                    "its end in the middle of storage `{name}`, at {} bytes",
                    self.n_bytes
                )
            })?;
            let mut count = [0; COUNT_BYTES as usize];
            self.file
                .seek(SeekFrom::Start(offset))
                .and_then(|_| self.file.read_exact(&mut count))
                .map_err(|e| format!("storage `{name}`, which can't be read: {e}"))?;
            let count = u64::from_le_bytes(count);
            if count != storage.n_elements {
                return Err(format!(
                    "{count} elements in storage `{name}` of {}",
                    storage.n_elements
                ));
            }
            let span = Span {
                offset: first,
                n_bytes: end - first,
                crc32: None,
            };
            spans.insert(name.clone(), span);
            offset = end;
        }
        Ok(spans)
    }
}
