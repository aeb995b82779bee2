//! PyTorch files as tests write them, byte for byte what `torch.save` makes of a dictionary of
//! tensors.

use std::io::Write;

use rawzip::{CompressionMethod, ZipArchiveWriter};

use super::stream::{MAGIC, VERSION};

/// A tensor to write: name, shape, values.
pub type Named<'a> = (&'a str, &'a [usize], &'a [f32]);

/// How a dictionary of tensors is pickled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Era {
    /// By Python 3 and a PyTorch of today.
    Today,
    /// By Python 2 and PyTorch 0.1.12: texts are byte strings, the dictionary is made of a list, and
    /// every tensor is wrapped in a parameter.
    Python2,
}

/// A file as PyTorch writes it since version 1.6.
pub fn archive(tensors: &[Named<'_>]) -> Vec<u8> {
    let pickle = state_dict(tensors, Era::Today);
    let mut entries: Vec<(String, Vec<u8>)> = vec![
        ("weights/data.pkl".into(), pickle),
        ("weights/byteorder".into(), b"little".to_vec()),
    ];
    for (index, (_, _, values)) in tensors.iter().enumerate() {
        entries.push((format!("weights/data/{index}"), little_endian(values)));
    }
    entries.push(("weights/version".into(), b"3\n".to_vec()));
    let entries: Vec<(&str, &[u8])> = entries
        .iter()
        .map(|(name, bytes)| (name.as_str(), bytes.as_slice()))
        .collect();
    zip(&entries, CompressionMethod::STORE)
}

/// A zip archive; what is said to be compressed is not.
pub fn zip(entries: &[(&str, &[u8])], method: CompressionMethod) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut archive = ZipArchiveWriter::new(&mut bytes);
    for (name, content) in entries {
        let (mut entry, config) = archive
            .new_file(name)
            .compression_method(method)
            .start()
            .expect("in memory");
        let mut writer = config.wrap(&mut entry);
        writer.write_all(content).expect("in memory");
        let (_, descriptor) = writer.finish().expect("in memory");
        entry.finish(descriptor).expect("in memory");
    }
    archive.finish().expect("in memory");
    bytes
}

/// A file as PyTorch wrote it before version 1.6.
pub fn stream(tensors: &[Named<'_>], era: Era) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    bytes.extend([0x80, 2]);
    int(&mut bytes, VERSION);
    bytes.extend(b".\x80\x02}q\x00(");
    text(&mut bytes, "protocol_version", era);
    int(&mut bytes, VERSION);
    text(&mut bytes, "little_endian", era);
    bytes.extend(b"\x88u.");
    bytes.extend(state_dict(tensors, era));
    bytes.extend(b"\x80\x02]q\x00(");
    for index in 0..tensors.len() {
        text(&mut bytes, &index.to_string(), era);
    }
    bytes.extend(b"e.");
    for (_, _, values) in tensors {
        bytes.extend((values.len() as u64).to_le_bytes());
        bytes.extend(little_endian(values));
    }
    bytes
}

/// The pickle of a dictionary of tensors, whose storages are named by their index.
pub fn state_dict(tensors: &[Named<'_>], era: Era) -> Vec<u8> {
    let mut bytes = b"\x80\x02ccollections\nOrderedDict\nq\x00".to_vec();
    bytes.extend(match era {
        Era::Today => b")Rq\x01(".as_slice(),
        Era::Python2 => b"]q\x01(",
    });
    for (index, (name, shape, values)) in tensors.iter().enumerate() {
        if era == Era::Python2 {
            bytes.push(b']');
            bytes.push(b'(');
        }
        text(&mut bytes, name, era);
        if era == Era::Python2 {
            bytes.extend(b"ctorch.nn.parameter\nParameter\n");
            bytes.extend(b"ctorch._utils\n_rebuild_tensor\n");
        } else {
            bytes.extend(b"ctorch._utils\n_rebuild_tensor_v2\n");
        }
        bytes.extend(b"((");
        text(&mut bytes, "storage", era);
        bytes.extend(b"ctorch\nFloatStorage\n");
        text(&mut bytes, &index.to_string(), era);
        text(&mut bytes, "cpu", era);
        int(&mut bytes, values.len() as i64);
        if era == Era::Python2 {
            bytes.push(b'N');
        }
        bytes.extend(b"tQK\x00");
        tuple(&mut bytes, shape);
        tuple(&mut bytes, &strides(shape));
        match era {
            // Whether gradients are wanted, and hooks.
            Era::Today => bytes.extend(b"\x89ccollections\nOrderedDict\n)RtR"),
            // The parameter of the tensor, and its state; then the pair is complete.
            Era::Python2 => bytes.extend(b"tR\x85R\x88\x89N\x87be"),
        }
    }
    bytes.extend(match era {
        // What a module's state has beside its tensors is set as an attribute.
        Era::Today => b"u}X\x09\x00\x00\x00_metadata}sb.".as_slice(),
        Era::Python2 => b"e\x85R.",
    });
    bytes
}

fn strides(shape: &[usize]) -> Vec<usize> {
    (0..shape.len())
        .map(|index| shape[index + 1..].iter().product())
        .collect()
}

fn tuple(bytes: &mut Vec<u8>, sizes: &[usize]) {
    bytes.push(b'(');
    for &size in sizes {
        int(bytes, size as i64);
    }
    bytes.push(b't');
}

fn int(bytes: &mut Vec<u8>, value: i64) {
    match (u8::try_from(value), u16::try_from(value)) {
        (Ok(small), _) => bytes.extend([b'K', small]),
        (_, Ok(medium)) => {
            bytes.push(b'M');
            bytes.extend(medium.to_le_bytes());
        }
        _ => {
            bytes.push(b'J');
            bytes.extend((value as i32).to_le_bytes());
        }
    }
}

fn text(bytes: &mut Vec<u8>, text: &str, era: Era) {
    match era {
        Era::Today => {
            bytes.push(b'X');
            bytes.extend((text.len() as u32).to_le_bytes());
        }
        Era::Python2 => bytes.extend([b'U', text.len() as u8]),
    }
    bytes.extend(text.as_bytes());
}

fn little_endian(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}
