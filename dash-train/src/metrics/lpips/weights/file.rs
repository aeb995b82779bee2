//! A weight file of any format as a directory of tensors.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::super::{ExpectedTensor, Network};
use super::names::expected_name;
use super::stored::{Place, READ_WEIGHTS, StoredTensor};
use super::{pytorch, safetensors};
use crate::Error;

/// What a zip archive begins with.
const ZIP_MAGIC: &[u8] = b"PK\x03\x04";
/// What a stream of pickles begins with: the second version of pickles.
const PICKLE_MAGIC: &[u8] = &[0x80, 2];
/// Bytes by which a format is told.
const N_MAGIC: u64 = 16;

/// A weight file whose directory has been read, and none of its values.
pub(super) struct WeightFile {
    path: PathBuf,
    file: File,
    /// By the name that LPIPS gives it: the name in the file, and the tensor.
    tensors: BTreeMap<String, (String, StoredTensor)>,
}

impl WeightFile {
    /// Reads the directory of a file; its content tells the format.
    ///
    /// # Errors
    /// When it can't be read, or is damaged or of no known format.
    pub(super) fn open(path: &Path) -> Result<Self, Error> {
        let mut file = File::open(path).map_err(|e| Error::io(path, READ_WEIGHTS, e))?;
        let n_bytes = file
            .metadata()
            .map_err(|e| Error::io(path, READ_WEIGHTS, e))?
            .len();
        let mut start = Vec::new();
        file.by_ref()
            .take(N_MAGIC)
            .read_to_end(&mut start)
            .map_err(|e| Error::io(path, READ_WEIGHTS, e))?;
        let found = if start.starts_with(ZIP_MAGIC) {
            pytorch::archive::directory(path, &file, n_bytes)?
        } else if start.starts_with(PICKLE_MAGIC) {
            pytorch::stream::directory(path, &mut file, n_bytes)?
        } else if safetensors::is_one(&start) {
            safetensors::directory(path, &mut file, n_bytes)?
        } else {
            return Err(Error::weight_file(
                path,
                "LPIPS weights",
                "a file of another format",
            ));
        };
        // Of a tensor with two names, as a saved LPIPS has them, the first is as good.
        let mut tensors = BTreeMap::new();
        for (key, tensor) in found {
            if let Some(name) = expected_name(&key) {
                tensors.entry(name).or_insert((key, tensor));
            }
        }
        Ok(Self {
            path: path.to_path_buf(),
            file,
            tensors,
        })
    }

    /// The file's path.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Whether it has the tensor that LPIPS gives this name.
    pub(super) fn holds(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }

    /// Compares a tensor that the file holds with what a network needs.
    ///
    /// # Errors
    /// When its shape is another one, or its values can't be used.
    pub(super) fn check(&self, network: Network, expected: &ExpectedTensor) -> Result<(), Error> {
        let (key, tensor) = &self.tensors[&expected.name];
        if tensor.shape != expected.shape {
            return Err(Error::WeightShape {
                path: self.path.clone(),
                key: key.clone(),
                network,
                expected: expected.shape.clone(),
                found: tensor.shape.clone(),
            });
        }
        match &tensor.place {
            Place::Floats { .. } => Ok(()),
            Place::Other(found) => {
                Err(self.unusable(key, "contiguous 32-bit floats", found.clone()))
            }
        }
    }

    /// Reads the values of a tensor that [`WeightFile::check`] has found right.
    ///
    /// # Errors
    /// When the file ends before they do, their checksum is wrong, or one is not finite.
    pub(super) fn values(&mut self, name: &str) -> Result<Vec<f32>, Error> {
        let (key, tensor) = self.tensors[name].clone();
        let Place::Floats { offset, crc32 } = tensor.place else {
            unreachable!("lpips: `{key}` was checked to be floats");
        };
        let n_values: usize = tensor.shape.iter().product();
        let mut bytes = vec![0; n_values * size_of::<f32>()];
        self.file
            .seek(SeekFrom::Start(offset))
            .and_then(|_| self.file.read_exact(&mut bytes))
            .map_err(|e| Error::io(&self.path, READ_WEIGHTS, e))?;
        if crc32.is_some_and(|expected| expected != rawzip::crc32(&bytes)) {
            return Err(self.unusable(
                &key,
                "values with the checksum of the archive",
                "others".into(),
            ));
        }
        let values: Vec<f32> = bytes
            .chunks_exact(size_of::<f32>())
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect();
        match values.iter().position(|v| !v.is_finite()) {
            None => Ok(values),
            Some(index) => {
                let found = format!("{} at index {index}", values[index]);
                Err(self.unusable(&key, "finite values", found))
            }
        }
    }

    fn unusable(&self, key: &str, expected: &'static str, found: String) -> Error {
        Error::WeightValues {
            path: self.path.clone(),
            key: key.to_string(),
            expected,
            found,
        }
    }
}
