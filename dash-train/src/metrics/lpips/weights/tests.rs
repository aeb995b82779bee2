//! Weight files: what is read from each format, and what is refused.

use std::fs;
use std::path::{Path, PathBuf};

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use rawzip::CompressionMethod;
use safetensors::tensor::{Dtype, TensorView};

use super::super::Network;
use super::super::tests::generated;
use super::file::WeightFile;
use super::pytorch::bytes::{Era, Named, archive, state_dict, stream, zip};
use super::read;
use crate::Error;

const LINEAR: [f32; 6] = [0.5, -1.5, 2.25, 0.0, 1e-20, 3.0];
const BIAS: [f32; 2] = [7.0, -8.0];
const SMALL: [Named<'static>; 3] = [
    ("lin0.model.1.weight", &[1, 6, 1, 1], &LINEAR),
    ("classifier.0.weight", &[2, 3], &LINEAR),
    ("features.0.bias", &[2], &BIAS),
];

/// A scratch folder of weight files.
struct Files(tempfile::TempDir);

impl Files {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a scratch folder"))
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        fs::write(&path, bytes).expect("written");
        path
    }

    /// What opening a file says that must not open.
    #[track_caller]
    fn refusal(&self, bytes: &[u8]) -> String {
        match WeightFile::open(&self.write("file", bytes)) {
            Ok(_) => panic!("the file was taken"),
            Err(error) => error.to_string(),
        }
    }
}

fn safetensors_of(tensors: &[Named<'_>]) -> Vec<u8> {
    let bytes: Vec<Vec<u8>> = tensors
        .iter()
        .map(|(_, _, values)| bytemuck::cast_slice(values).to_vec())
        .collect();
    let views = tensors.iter().zip(&bytes).map(|((name, shape, _), bytes)| {
        let view = TensorView::new(Dtype::F32, shape.to_vec(), bytes).expect("it fits");
        (*name, view)
    });
    safetensors::serialize(views, None).expect("in memory")
}

/// The same tensors in every format that is read.
fn every_format(tensors: &[Named<'_>]) -> [(&'static str, Vec<u8>); 4] {
    [
        ("safetensors", safetensors_of(tensors)),
        ("archive", archive(tensors)),
        ("stream of today", stream(tensors, Era::Today)),
        ("stream of 2017", stream(tensors, Era::Python2)),
    ]
}

#[test]
fn every_format_gives_the_values_back() {
    let files = Files::new();
    for (format, bytes) in every_format(&SMALL) {
        let mut file = WeightFile::open(&files.write("file", &bytes))
            .unwrap_or_else(|e| panic!("{format}: {e}"));
        assert!(!file.holds("classifier.0.weight"), "{format}");
        let values = file.values("lin0.model.1.weight");
        assert_eq!(values.expect("read"), LINEAR, "{format}");
        assert_eq!(file.values("features.0.bias").expect("read"), BIAS);
    }
}

#[test]
fn a_whole_network_is_read_from_one_file_or_two_and_by_either_names() {
    let network = Network::AlexNet;
    let tensors = generated(network, 11);
    let named = |rename: fn(&str) -> String| -> Vec<(String, &[usize], &[f32])> {
        let tensors = tensors.iter();
        tensors
            .map(|(name, t)| (rename(name), t.shape.as_slice(), t.values.as_slice()))
            .collect()
    };
    let files = Files::new();
    // As torchvision and LPIPS publish them.
    let published = named(str::to_string);
    let of = |prefix: &str| -> Vec<Named<'_>> {
        let of_prefix = published.iter().filter(|t| t.0.starts_with(prefix));
        of_prefix.map(|t| (t.0.as_str(), t.1, t.2)).collect()
    };
    let features = files.write("features", &stream(&of("features."), Era::Python2));
    let linear = files.write("linear", &archive(&of("lin")));
    assert_eq!(
        read(network, &[linear.clone(), features.clone()]).expect("both"),
        tensors
    );
    // As a saved LPIPS has them.
    let saved = named(|name| match name.strip_prefix("features.") {
        Some(rest) => format!("net.slice1.{rest}"),
        None => name.replacen("lin", "lins.", 1),
    });
    let saved: Vec<Named<'_>> = saved.iter().map(|t| (t.0.as_str(), t.1, t.2)).collect();
    let whole = files.write("whole", &safetensors_of(&saved));
    assert_eq!(
        read(network, std::slice::from_ref(&whole)).expect("one"),
        tensors
    );

    let missing = read(network, std::slice::from_ref(&features)).expect_err("no linear weights");
    let message = missing.to_string();
    assert!(
        message.contains("lin0.model.1.weight") && message.contains("alex.pth"),
        "{message}"
    );
    let missing = read(network, &[linear]).expect_err("no features");
    assert!(
        missing.to_string().contains("torchvision's alexnet"),
        "{missing}"
    );
    let twice = read(network, &[features.clone(), whole]).expect_err("twice");
    assert!(matches!(twice, Error::WeightRepeated { .. }), "{twice}");
    let other = read(Network::Vgg16, &[features]).expect_err("of another network");
    let message = other.to_string();
    for part in [
        "features.0.weight",
        "[64, 3, 3, 3]",
        "[64, 3, 11, 11]",
        "VGG16",
    ] {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn a_file_cut_off_anywhere_is_an_error() {
    let files = Files::new();
    for (format, bytes) in every_format(&SMALL) {
        for length in 0..bytes.len() {
            let path = files.write("file", &bytes[..length]);
            assert!(WeightFile::open(&path).is_err(), "{format}, {length} bytes");
        }
    }
}

/// Opens a file and reads what it has; whether it is refused does not matter, only that it ends.
fn exercise(path: &Path) {
    if let Ok(mut file) = WeightFile::open(path) {
        for (name, shape, _) in SMALL {
            let expected = super::ExpectedTensor {
                name: name.into(),
                shape: shape.to_vec(),
            };
            if file.holds(name) && file.check(Network::AlexNet, &expected).is_ok() {
                drop(file.values(name));
            }
        }
    }
}

#[test]
fn damaged_bytes_never_panic() {
    let files = Files::new();
    let mut rng = Pcg64::seed_from_u64(77);
    for (_, bytes) in every_format(&SMALL) {
        for position in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[position] = rng.random();
            // Every other time more than one, and some bytes gone.
            if position % 2 == 0 {
                let other = rng.random_range(0..damaged.len());
                damaged[other] ^= 1 << rng.random_range(0..8);
                damaged.remove(rng.random_range(0..bytes.len()));
            }
            exercise(&files.write("file", &damaged));
        }
    }
}

#[test]
fn an_archive_finds_changed_values_by_their_checksum() {
    let files = Files::new();
    let mut bytes = archive(&SMALL);
    let value = 2.25_f32.to_le_bytes();
    let at = bytes.windows(4).position(|b| b == value).expect("stored");
    bytes[at] ^= 1;
    let mut file = WeightFile::open(&files.write("file", &bytes)).expect("its directory is whole");
    let error = file.values("lin0.model.1.weight").expect_err("changed");
    assert!(error.to_string().contains("checksum"), "{error}");
}

/// A pickle in an archive with one storage, `0`, of six floats.
fn archived(pickle: &[u8]) -> Vec<u8> {
    let values: &[u8] = bytemuck::cast_slice(&LINEAR);
    zip(
        &[("w/data.pkl", pickle), ("w/data/0", values)],
        CompressionMethod::STORE,
    )
}

/// The pickle of [`SMALL`]'s first tensor with some bytes of it replaced.
fn changed(from: &[u8], to: &[u8]) -> Vec<u8> {
    let pickle = state_dict(&SMALL[..1], Era::Today);
    let at = pickle
        .windows(from.len())
        .position(|bytes| bytes == from)
        .expect("part of the pickle");
    [&pickle[..at], to, &pickle[at + from.len()..]].concat()
}

#[test]
fn a_pickle_that_calls_something_is_refused_by_its_name() {
    let files = Files::new();
    let message = files.refusal(&archived(b"\x80\x02cos\nsystem\nX\x02\x00\x00\x00ls\x85R."));
    assert!(
        message.contains("os.system") && message.contains("nothing is executed"),
        "{message}"
    );
    for pickle in [
        b"\x80\x02ctorch\nload\n.".as_slice(),
        b"\x80\x02cbuiltins\neval\n.",
        b"\x80\x02ccollections\nOrderedDict\n)\x81.",
        b"\x80\x04\x8c\x02os\x8c\x06system\x93.",
    ] {
        files.refusal(&archived(pickle));
    }
}

#[test]
fn tensors_beyond_their_storage_or_of_another_kind_are_refused() {
    let files = Files::new();
    files.refusal(&archived(&changed(b"K\x06tQ", b"K\x07tQ")));
    files.refusal(&archived(&changed(b"tQK\x00", b"tQK\x01")));
    files.refusal(&archived(&changed(b"(K\x01K\x06", b"(K\x02K\x06")));
    files.refusal(&archived(&changed(
        b"(K\x01K\x06",
        b"(J\xff\xff\xff\xffK\x06",
    )));
    let huge = b"(\x8a\x08\xff\xff\xff\xff\xff\xff\xff\x7fK\x06";
    files.refusal(&archived(&changed(b"(K\x01K\x06", huge)));
    let expected = super::ExpectedTensor {
        name: SMALL[0].0.into(),
        shape: SMALL[0].1.to_vec(),
    };
    for (from, to, part) in [
        (
            b"(K\x06K\x01K\x01K\x01t".as_slice(),
            b"(K\x06K\x02K\x01K\x01t".as_slice(),
            "strides",
        ),
        (b"FloatStorage", b"IntStorage", "IntStorage"),
    ] {
        let path = files.write("file", &archived(&changed(from, to)));
        let file = WeightFile::open(&path).expect("its directory is right");
        let error = file
            .check(Network::AlexNet, &expected)
            .expect_err("unusable");
        assert!(error.to_string().contains(part), "{error}");
    }
}

#[test]
fn files_of_other_kinds_are_refused() {
    let files = Files::new();
    for bytes in [
        b"".as_slice(),
        b"PNG or whatever it may be",
        b"\x80\x02}q\x00.",
        &[0; 64],
    ] {
        files.refusal(bytes);
    }
    let message = files.refusal(&zip(&[("picture.txt", b"hello")], CompressionMethod::STORE));
    assert!(message.contains("without data.pkl"), "{message}");
    let compressed = zip(&[("w/data.pkl", b"}.")], CompressionMethod::DEFLATE);
    let message = files.refusal(&compressed);
    assert!(message.contains("compressed"), "{message}");
    let mut big = stream(&SMALL, Era::Today);
    let flag = big
        .iter()
        .position(|&b| b == 0x88)
        .expect("little_endian is true");
    big[flag] = 0x89;
    let message = files.refusal(&big);
    assert!(message.contains("big-endian"), "{message}");
    let absent = files.0.path().join("absent.pth");
    assert!(matches!(WeightFile::open(&absent), Err(Error::Io { .. })));
    assert!(WeightFile::open(files.0.path()).is_err(), "a folder");
}

#[test]
fn values_that_are_not_finite_are_refused() {
    let files = Files::new();
    let values = [1.0, f32::NAN];
    let bytes = safetensors_of(&[("features.0.bias", &[2], &values)]);
    let mut file = WeightFile::open(&files.write("file", &bytes)).expect("its directory is right");
    let error = file.values("features.0.bias").expect_err("NaN");
    assert!(error.to_string().contains("index 1"), "{error}");
}

#[test]
fn references_that_multiply_are_refused_in_time() {
    // A long list, then a dictionary of it again and again.
    let mut pickle = b"\x80\x02]q\x01(".to_vec();
    for _ in 0..20_000 {
        pickle.extend(b"]");
    }
    pickle.extend(b"eccollections\nOrderedDict\nq\x02");
    for _ in 0..20_000 {
        pickle.extend(b"h\x02h\x01\x85R");
    }
    pickle.push(b'.');
    Files::new().refusal(&archived(&pickle));
}
