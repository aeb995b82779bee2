//! The zip archive that PyTorch writes since version 1.6: `NAME/data.pkl` describes the tensors,
//! `NAME/data/KEY` are their storages, as they are in memory.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use rawzip::{CompressionMethod, RECOMMENDED_BUFFER_SIZE, ZipArchive};

use super::super::stored::{READ_WEIGHTS, StoredTensor};
use super::pickle::Pickle;
use super::tensors::{Span, locate};
use super::{EXPECTED, MAX_PICKLE_BYTES};
use crate::Error;

/// Most entries: a network has a few dozen tensors.
const MAX_ENTRIES: usize = 1 << 16;
/// The pickle within its folder.
const PICKLE_NAME: &str = "data.pkl";
/// The entry that says in what order numbers have their bytes, if there is one.
const BYTE_ORDER_NAME: &str = "byteorder";
/// Longest of its values in bytes.
const MAX_BYTE_ORDER_BYTES: u64 = 16;

/// What an archive holds, by its name.
pub(in super::super) fn directory(
    path: &Path,
    file: &File,
    n_bytes: u64,
) -> Result<BTreeMap<String, StoredTensor>, Error> {
    let wrong = |found: String| Error::weight_file(path, EXPECTED, found);
    let duplicate = file
        .try_clone()
        .map_err(|e| Error::io(path, READ_WEIGHTS, e))?;
    let entries = entries(duplicate, n_bytes).map_err(&wrong)?;
    let root = entries
        .keys()
        .filter_map(|name| name.strip_suffix(PICKLE_NAME))
        .find(|root| root.is_empty() || root.ends_with('/'))
        .ok_or_else(|| wrong(format!("a zip archive without {PICKLE_NAME}")))?
        .to_string();
    let read = |name: &str, limit: u64| -> Result<Option<Vec<u8>>, Error> {
        let Some(entry) = entries.get(&format!("{root}{name}")) else {
            return Ok(None);
        };
        let span = entry.as_ref().map_err(|found| wrong(found.clone()))?;
        if span.n_bytes > limit {
            return Err(wrong(format!("`{name}` of {} bytes", span.n_bytes)));
        }
        let mut bytes = vec![0; span.n_bytes as usize];
        let mut file = file;
        file.seek(SeekFrom::Start(span.offset))
            .and_then(|_| file.read_exact(&mut bytes))
            .map_err(|e| Error::io(path, READ_WEIGHTS, e))?;
        if span
            .crc32
            .is_some_and(|crc32| crc32 != rawzip::crc32(&bytes))
        {
            return Err(wrong(format!(
                "`{name}` with another checksum than the archive's"
            )));
        }
        Ok(Some(bytes))
    };
    if let Some(order) = read(BYTE_ORDER_NAME, MAX_BYTE_ORDER_BYTES)?
        && order.trim_ascii() != b"little"
    {
        return Err(wrong("numbers in big-endian order".into()));
    }
    let pickle = read(PICKLE_NAME, MAX_PICKLE_BYTES)?.unwrap_or_default();
    let pickle = Pickle::load(&pickle).map_err(&wrong)?;
    locate(&pickle, |key| {
        match entries.get(&format!("{root}data/{key}")) {
            Some(span) => span.clone(),
            None => Err(format!("a tensor whose storage `{key}` is not there")),
        }
    })
    .map_err(wrong)
}

/// Every entry of an archive by its name: where its bytes are, or why they can't be read.
fn entries(file: File, n_bytes: u64) -> Result<HashMap<String, Result<Span, String>>, String> {
    let damaged = |e: rawzip::Error| format!("a damaged zip archive: {e}");
    let mut buffer = vec![0; RECOMMENDED_BUFFER_SIZE];
    let archive = ZipArchive::from_file(file, &mut buffer).map_err(damaged)?;
    let mut found = Vec::new();
    let mut records = archive.entries(&mut buffer);
    while let Some(record) = records.next_entry().map_err(damaged)? {
        if found.len() == MAX_ENTRIES {
            return Err(format!("a zip archive of more than {MAX_ENTRIES} entries"));
        }
        let name = String::from_utf8_lossy(record.file_path().as_ref()).into_owned();
        let is_stored = record.compression_method() == CompressionMethod::STORE
            && record.compressed_size_hint() == record.uncompressed_size_hint();
        found.push((name, record.wayfinder(), record.crc32(), is_stored));
    }
    let mut entries = HashMap::with_capacity(found.len());
    for (name, wayfinder, crc32, is_stored) in found {
        let (start, end) = archive
            .get_entry(wayfinder)
            .map_err(damaged)?
            .compressed_data_range();
        let span = if !is_stored {
            Err(format!("`{name}` compressed, which torch.save never does"))
        } else if start > end || end > n_bytes {
            Err(format!("`{name}` beyond the end of the file"))
        } else {
            Ok(Span {
                offset: start,
                n_bytes: end - start,
                // Zero is written by those who leave checksums out.
                crc32: Some(crc32).filter(|&crc32| crc32 != 0),
            })
        };
        if entries.insert(name.clone(), span).is_some() {
            return Err(format!("a zip archive with `{name}` twice"));
        }
    }
    Ok(entries)
}
