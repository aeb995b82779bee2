//! Weight files: which tensors they hold and where, read without executing anything in them.
//!
//! # Map
//! - `file`: a weight file of any format as a directory of tensors.
//! - `names`: LPIPS's tensors by the names that published files use.
//! - `safetensors`, `pytorch`: the formats; `stored`: where they say that a tensor is.
//! - this file: the tensors that a network needs, out of several files.

mod file;
mod names;
pub(super) mod pytorch;
mod safetensors;
mod stored;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::PathBuf;

use dash_model::parameters::HostTensor;

use super::{ExpectedTensor, Network};
use crate::Error;
use file::WeightFile;

/// Reads every tensor that `network` needs, by the names of [`Network::expected_tensors`].
///
/// # Errors
/// When a file can't be read, or a tensor is missing, there twice, of another shape, not of 32-bit
/// floats or not finite.
pub(super) fn read(
    network: Network,
    paths: &[PathBuf],
) -> Result<BTreeMap<String, HostTensor>, Error> {
    let (mut files, places) = look_up(network, paths)?;
    let tensors = places.into_iter().map(|(expected, index)| {
        let values = files[index].values(&expected.name)?;
        let shape = expected.shape;
        Ok((expected.name, HostTensor { shape, values }))
    });
    tensors.collect()
}

/// Does all of [`read`] but for reading the values.
///
/// # Errors
/// As [`read`].
pub(super) fn check(network: Network, paths: &[PathBuf]) -> Result<(), Error> {
    look_up(network, paths).map(|_| ())
}

/// Every tensor that a network needs, with the index of the file that holds it.
type Places = Vec<(ExpectedTensor, usize)>;

/// Opens the files and compares what they hold with what `network` needs.
fn look_up(network: Network, paths: &[PathBuf]) -> Result<(Vec<WeightFile>, Places), Error> {
    let files = paths
        .iter()
        .map(|path| WeightFile::open(path))
        .collect::<Result<Vec<_>, _>>()?;
    let mut places = Vec::new();
    for expected in network.expected_tensors() {
        let index = find(network, &expected, &files)?;
        files[index].check(network, &expected)?;
        places.push((expected, index));
    }
    Ok((files, places))
}

/// Index of the one file that holds a tensor.
fn find(network: Network, expected: &ExpectedTensor, files: &[WeightFile]) -> Result<usize, Error> {
    let mut holding = (0..files.len()).filter(|&index| files[index].holds(&expected.name));
    let Some(first) = holding.next() else {
        let hint = match (network, expected.name.starts_with("features.")) {
            (Network::Vgg16, true) => "name torchvision's vgg16 weights, too",
            (Network::AlexNet, true) => "name torchvision's alexnet weights, too",
            (Network::Vgg16, false) => "name LPIPS's weights/v0.1/vgg.pth, too",
            (Network::AlexNet, false) => "name LPIPS's weights/v0.1/alex.pth, too",
        };
        return Err(Error::WeightMissing {
            network,
            name: expected.name.clone(),
            shape: expected.shape.clone(),
            files: files.iter().map(|file| file.path().to_path_buf()).collect(),
            hint,
        });
    };
    match holding.next() {
        None => Ok(first),
        Some(second) => Err(Error::WeightRepeated {
            name: expected.name.clone(),
            first: files[first].path().to_path_buf(),
            second: files[second].path().to_path_buf(),
        }),
    }
}
