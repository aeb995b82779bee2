//! Values of every kind in a file.

mod compressed;

use std::fs;
use std::path::PathBuf;

use tempfile::TempDir;

use super::*;

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
fn a_filter_beside_the_gaussians_is_applied() {
    let scratch = Scratch::new();
    let read = |width: Option<f32>| {
        let names = [&NAMES[..], &["filter_3D"]].concat();
        let names = &names[..NAMES.len() + usize::from(width.is_some())];
        let mut bytes = header("vertex", "float", names, 1, true).into_bytes();
        let values = (0..NAMES.len()).map(|column| 0.1 * column as f32 - 1.0);
        let values = values.chain(width);
        bytes.extend(values.flat_map(f32::to_le_bytes));
        read_splat_ply(&scratch.write(&bytes)).expect("reads").rows
    };
    let plain = read(None);
    assert_eq!(read(Some(0.0)), plain);
    let wider = read(Some(0.5));
    assert_eq!(wider.means, plain.means);
    assert!(wider.log_scales[0][0] > plain.log_scales[0][0]);
    assert!(wider.opacity_logits[0] < plain.opacity_logits[0]);
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
