//! Values of every kind in a file, and SuperSplat's compressed files.

use std::fs;
use std::path::PathBuf;

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use tempfile::TempDir;

use super::*;
use crate::gaussians::SH_C0;

const NAMES: [&str; 23] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "f_rest_0", "f_rest_1", "f_rest_2", "f_rest_3",
    "f_rest_4", "f_rest_5", "f_rest_6", "f_rest_7", "f_rest_8", "opacity", "scale_0", "scale_1",
    "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
];

struct Scratch(TempDir);

impl Scratch {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a scratch folder"))
    }

    fn write(&self, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join("splats.ply");
        fs::write(&path, bytes).expect("writes");
        path
    }

    /// Two ordinary Gaussians, the second with another value of a property.
    fn with(&self, property: &str, value: f32) -> Result<SplatFile, String> {
        let changed = NAMES
            .iter()
            .position(|name| *name == property)
            .expect("a property");
        let mut bytes = header("vertex", "float", &NAMES, 2, true).into_bytes();
        for row in 0..2 {
            for (column, name) in NAMES.iter().enumerate() {
                let ordinary = match *name {
                    "rot_0" => 1.0,
                    _ if name.starts_with("rot") => 0.0,
                    _ => 0.25 * column as f32 - 2.0,
                };
                let value = if row == 1 && column == changed {
                    value
                } else {
                    ordinary
                };
                bytes.extend(value.to_le_bytes());
            }
        }
        read_splat_ply(&self.write(&bytes)).map_err(|error| error.to_string())
    }
}

fn header(element: &str, kind: &str, names: &[&str], count: usize, whole: bool) -> String {
    let properties: String = names
        .iter()
        .map(|name| format!("property {kind} {name}\n"))
        .collect();
    let body = format!("element {element} {count}\n{properties}");
    match whole {
        true => format!("ply\nformat binary_little_endian 1.0\n{body}end_header\n"),
        false => body,
    }
}

#[test]
fn values_without_a_limit_are_refused_with_their_row_and_property() {
    let scratch = Scratch::new();
    for property in NAMES {
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let has_limit = property == "opacity" || property.starts_with("scale_");
            let read = scratch.with(property, value);
            if has_limit && !value.is_nan() {
                read.expect("drawn as its limit");
                continue;
            }
            let message = read.expect_err(property);
            let words = format!("`{property}` {value} at vertex 1");
            assert!(
                message.contains("splats.ply") && message.contains(&words),
                "{message}"
            );
        }
    }
}

#[test]
fn finite_values_are_kept_or_brought_to_their_limit() {
    let scratch = Scratch::new();
    let mut values = vec![
        0.0,
        1e-40,
        f32::MIN_POSITIVE,
        1e-6,
        1.0,
        1e3,
        1e10,
        1e19,
        1e38,
        f32::MAX,
    ];
    values.extend(values.clone().iter().map(|value| -value));
    for property in NAMES {
        for &value in &values {
            let file = scratch.with(property, value).expect(property);
            let n_kept = 2 - usize::from(property == "rot_0" && value == 0.0);
            assert_eq!(
                (file.rows.len(), file.left_out.count()),
                (n_kept, 2 - n_kept),
                "{property} {value}"
            );
            let rows = file.rows;
            let squares = |v: &[f32]| v.iter().map(|v| v * v).sum::<f32>();
            assert!(
                rows.means.iter().all(|mean| squares(mean).is_finite()),
                "{property} {value}"
            );
            let lengths = rows.quats.iter().map(|quat| squares(quat));
            assert!(
                lengths.clone().all(|l| (1e-12..1e31).contains(&l)),
                "{property} {value}"
            );
            let scales = rows.log_scales.as_flattened();
            assert!(
                scales.iter().all(|s| (-50.0..13.0).contains(s)),
                "{property} {value}"
            );
            assert!(
                rows.opacity_logits.iter().all(|v| v.abs() <= 50.0),
                "{property} {value}"
            );
        }
    }
}

#[test]
fn limits_are_those_of_what_is_drawn() {
    let scratch = Scratch::new();
    let last = |property, value| {
        let rows = scratch.with(property, value).expect(property).rows;
        rows.gather(&[rows.len() - 1])
    };
    // Opaque, invisible, flat, as wide as can be.
    assert_eq!(last("opacity", f32::INFINITY), last("opacity", 50.0));
    assert_eq!(last("scale_1", f32::NEG_INFINITY), last("scale_1", -50.0));
    assert_eq!(last("scale_1", f32::INFINITY), last("scale_1", 1e3));
    let file = scratch.with("opacity", f32::NEG_INFINITY).expect("reads");
    let expected = LeftOut {
        invisible: 1,
        without_rotation: 0,
    };
    assert_eq!((file.rows.len(), file.left_out), (1, expected));
    let file = scratch.with("rot_0", 0.0).expect("reads");
    let expected = LeftOut {
        invisible: 0,
        without_rotation: 1,
    };
    assert_eq!((file.rows.len(), file.left_out), (1, expected));
    // The same direction and the same rotation.
    assert_eq!(last("rot_0", -1e-30).quats[0], [-1.0, 0.0, 0.0, 0.0]);
    let [x, y, z] = last("z", -3e38).means[0];
    assert_eq!(z, -1e15);
    assert!(x.abs() < 1e-20 && y.abs() < 1e-20, "{x} {y}");
    // Ordinary values stay as they are, bit for bit.
    assert_eq!(last("scale_2", 9.5).log_scales[0][2], 9.5);
    assert_eq!(last("rot_2", 1e-3).quats[0], [1.0, 0.0, 1e-3, 0.0]);
}

#[test]
fn files_of_gaussians_are_told_from_points_even_where_they_are_damaged() {
    let scratch = Scratch::new();
    let is_splat = |names: &[&str]| {
        let path = scratch.write(header("vertex", "float", names, 0, true).as_bytes());
        is_splat_ply(&path)
    };
    for left_out in NAMES {
        let names = NAMES.iter().filter(|name| **name != left_out);
        let names: Vec<&str> = names.copied().collect();
        assert!(is_splat(&names), "without {left_out}");
    }
    // Flat Gaussians have two scales.
    assert!(is_splat(&["x", "y", "z", "opacity", "scale_0", "scale_1"]));
    assert!(is_splat(&["packed_position"]));
    for points in [
        &["x", "y", "z"][..],
        &["x", "y", "z", "red", "green", "blue", "opacity"],
        &["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2"],
        &["x", "y", "z", "scalar_intensity"],
    ] {
        assert!(!is_splat(points), "{points:?}");
    }
    assert!(!is_splat_ply(&scratch.write(b"no header")));
}

/// As SuperSplat packs Gaussians, with its ranges by chunk.
fn compress(rows: &GaussianRows, with_colors: bool) -> Vec<u8> {
    let rgb: Vec<[f32; 3]> = rows
        .sh_dc
        .iter()
        .map(|dc| dc.map(|v| v * SH_C0 + 0.5))
        .collect();
    let mut columns = vec![&rows.means, &rows.log_scales];
    if with_colors {
        columns.push(&rgb);
    }
    let n_chunks = rows.len().div_ceil(256);
    let mut ranges =
        vec![vec![[[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]]; columns.len()]; n_chunks];
    for row in 0..rows.len() {
        for (column, [low, high]) in columns.iter().zip(&mut ranges[row / 256]) {
            for k in 0..3 {
                low[k] = low[k].min(column[row][k]);
                high[k] = high[k].max(column[row][k]);
            }
        }
    }
    let unit = |v: f64, bits: u32| (v.clamp(0.0, 1.0) * ((1u64 << bits) - 1) as f64).round() as u32;
    let mut bytes = compressed_header(rows, n_chunks, with_colors).into_bytes();
    bytes.extend(
        ranges
            .iter()
            .flatten()
            .flatten()
            .flatten()
            .flat_map(|v| v.to_le_bytes()),
    );
    for row in 0..rows.len() {
        let fraction = |column: usize, k: usize| {
            let [low, high] = ranges[row / 256][column];
            let span = f64::from(high[k] - low[k]);
            if span < 1e-5 {
                0.0
            } else {
                f64::from(columns[column][row][k] - low[k]) / span
            }
        };
        let three = |column| {
            unit(fraction(column, 0), 11) << 21
                | unit(fraction(column, 1), 10) << 11
                | unit(fraction(column, 2), 11)
        };
        let color = (0..3).fold(0, |packed, k| {
            let value = if with_colors {
                fraction(2, k)
            } else {
                f64::from(rgb[row][k])
            };
            packed << 8 | unit(value, 8)
        });
        let alpha = 1.0 / (1.0 + (-f64::from(rows.opacity_logits[row])).exp());
        for word in [
            three(0),
            packed_rotation(rows.quats[row], unit),
            three(1),
            color << 8 | unit(alpha, 8),
        ] {
            bytes.extend(word.to_le_bytes());
        }
    }
    let width = rows.sh_rest_width;
    for row in rows.sh_rest.chunks_exact(width.max(1)) {
        let per_channel = width / 3;
        for k in 0..width {
            let value = row[3 * (k % per_channel) + k / per_channel];
            bytes.push(((value / 8.0 + 0.5) * 256.0).clamp(0.0, 255.0) as u8);
        }
    }
    bytes
}

fn compressed_header(rows: &GaussianRows, n_chunks: usize, with_colors: bool) -> String {
    let mut values = vec![["x", "y", "z"], ["scale_x", "scale_y", "scale_z"]];
    if with_colors {
        values.push(["r", "g", "b"]);
    }
    let bounds = values.iter().flat_map(|names| {
        ["min_", "max_"]
            .iter()
            .flat_map(|bound| names.map(|name| format!("{bound}{name}")))
    });
    let bounds: Vec<String> = bounds.collect();
    let names = |names: &[String]| -> Vec<String> { names.to_vec() };
    let element = |element: &str, kind: &str, names: &[String], count| {
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        header(element, kind, &names, count, false)
    };
    let packed = ["position", "rotation", "scale", "color"].map(|name| format!("packed_{name}"));
    let mut text =
        "ply\nformat binary_little_endian 1.0\ncomment Generated by an encoder\n".to_string();
    text += &element("chunk", "float", &names(&bounds), n_chunks);
    text += &element("vertex", "uint", &packed, rows.len());
    if rows.sh_rest_width > 0 {
        let rest: Vec<String> = (0..rows.sh_rest_width)
            .map(|k| format!("f_rest_{k}"))
            .collect();
        text += &element("sh", "uchar", &rest, rows.len());
    }
    text + "end_header\n"
}

fn packed_rotation(quat: [f32; 4], unit: impl Fn(f64, u32) -> u32) -> u32 {
    let length = quat
        .iter()
        .map(|&q| f64::from(q).powi(2))
        .sum::<f64>()
        .sqrt();
    let quat = quat.map(|q| f64::from(q) / length);
    let largest = (0..4).fold(0, |best, k| {
        if quat[k].abs() > quat[best].abs() {
            k
        } else {
            best
        }
    });
    let sign = quat[largest].signum();
    let others = (0..4).filter(|&k| k != largest);
    others.fold(largest as u32, |packed, k| {
        packed << 10 | unit(sign * quat[k] * 0.5 * 2.0f64.sqrt() + 0.5, 10)
    })
}

/// Gaussians whose values lie in the ranges that the format holds.
fn random(n: usize, sh_degree: usize) -> GaussianRows {
    let mut rng = Pcg64::seed_from_u64(n as u64);
    let mut triples = |low: f32, high: f32| -> Vec<[f32; 3]> {
        (0..n)
            .map(|_| std::array::from_fn(|_| rng.random_range(low..high)))
            .collect()
    };
    let mut rows =
        GaussianRows::from_points(&triples(-3.0, 5.0), &triples(0.0, 1.0), sh_degree, 0.1);
    rows.log_scales = triples(-7.0, 1.0);
    for quat in &mut rows.quats {
        *quat = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
    }
    rows.opacity_logits
        .fill_with(|| rng.random_range(-4.0..4.0));
    rows.sh_rest.fill_with(|| rng.random_range(-2.0..2.0));
    rows
}

/// Asserts that values agree to half a step of their bits, or a whole one where they are cut off.
#[track_caller]
fn assert_close(what: &str, got: &[f32], expected: &[f32], tolerance: f32) {
    assert_eq!(got.len(), expected.len(), "{what}");
    for (index, (g, e)) in got.iter().zip(expected).enumerate() {
        assert!(
            (g - e).abs() <= tolerance,
            "{what} {index}: got {g}, expected {e}"
        );
    }
}

#[test]
fn compressed_files_are_read_to_the_precision_of_their_bits() {
    let scratch = Scratch::new();
    for (n, sh_degree, with_colors) in [
        (1, 0, true),
        (255, 1, true),
        (256, 2, true),
        (257, 3, true),
        (600, 3, true),
        (300, 0, false),
    ] {
        let rows = random(n, sh_degree);
        let path = scratch.write(&compress(&rows, with_colors));
        assert!(is_splat_ply(&path));
        let read = read_splat_ply(&path).expect("reads").rows;
        let name = format!("{n} of degree {sh_degree}:");
        let flat = |rows: &Vec<[f32; 3]>| rows.as_flattened().to_vec();
        // A range of 8, halves of 1 / 1023.
        let step = 0.5 / 1023.0 * 1.001;
        assert_close(
            &format!("{name} means"),
            &flat(&read.means),
            &flat(&rows.means),
            8.0 * step,
        );
        assert_close(
            &format!("{name} scales"),
            &flat(&read.log_scales),
            &flat(&rows.log_scales),
            8.0 * step,
        );
        let dc_step = 0.5 / 255.0 / SH_C0 * 1.001;
        assert_close(
            &format!("{name} colours"),
            &flat(&read.sh_dc),
            &flat(&rows.sh_dc),
            dc_step,
        );
        assert_close(
            &format!("{name} rest"),
            &read.sh_rest,
            &rows.sh_rest,
            4.0 / 256.0 * 1.001,
        );
        let sigmoid = |logits: &[f32]| -> Vec<f32> {
            logits.iter().map(|l| 1.0 / (1.0 + (-l).exp())).collect()
        };
        let (got, expected) = (sigmoid(&read.opacity_logits), sigmoid(&rows.opacity_logits));
        assert_close(
            &format!("{name} opacities"),
            &got,
            &expected,
            0.5 / 255.0 * 1.001,
        );
        for (got, expected) in read.quats.iter().zip(&rows.quats) {
            let length = |q: &[f32; 4]| q.iter().map(|v| v * v).sum::<f32>().sqrt();
            let dot: f32 = got.iter().zip(expected).map(|(a, b)| a * b).sum();
            let cosine = dot.abs() / (length(got) * length(expected));
            // Three components are off by 7e-4 at most, which turns by half an angle of 2.5e-3.
            assert!(cosine > 1.0 - 4e-6, "{name} {got:?} {expected:?}");
        }
    }
}

#[test]
fn damaged_compressed_files_are_errors_that_name_the_file() {
    let scratch = Scratch::new();
    let whole = compress(&random(300, 1), true);
    let refused = |bytes: &[u8]| {
        let error = read_splat_ply(&scratch.write(bytes))
            .expect_err("damaged")
            .to_string();
        assert!(error.contains("splats.ply"), "{error}");
        error
    };
    for length in (0..whole.len()).step_by(7) {
        refused(&whole[..length]);
    }
    let text = String::from_utf8_lossy(&whole).into_owned();
    let body = text.find("end_header\n").expect("a header") + "end_header\n".len();
    let with = |old: &str, new: &str| {
        let header = text[..body].replace(old, new);
        assert_ne!(header, text[..body], "{old}");
        refused(&[header.as_bytes(), &whole[body..]].concat())
    };
    for (old, new, word) in [
        (
            "element chunk 2",
            "element chunk 1",
            "a chunk for every 256",
        ),
        ("min_scale_y", "least_scale_y", "min_scale_y"),
        ("packed_color", "packed_colour", "packed_color"),
        ("f_rest_8", "f_rest_9", "f_rest"),
        ("element sh 300", "element sh 299", "299 rows"),
        ("element vertex 300", "element vertex 99999999", "chunk"),
    ] {
        let error = with(old, new);
        assert!(error.contains(word), "{error}");
    }
    // A bound of the second chunk that is not finite.
    let mut bytes = whole.clone();
    bytes[body + 18 * 4..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    let error = refused(&bytes);
    assert!(error.contains("`x` NaN at vertex"), "{error}");
}
