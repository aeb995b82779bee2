//! Files of Gaussians with values of every kind, and points whose colours have other names, from the command line.

use crate::common::{Scratch, TINY, text};

const NAMES: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
    "rot_0", "rot_1", "rot_2", "rot_3",
];
const CAMERA: &str = r#"[{"id": 0, "img_name": "a", "width": 32, "height": 24, "position": [0, 0, -3],
 "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 30, "fy": 30}]"#;

/// A Gaussian in front of the camera.
const ORDINARY: [&str; 14] = [
    "0", "0", "0", "1", "-1", "0.5", "1", "-1", "-1", "-1", "1", "0", "0", "0",
];

/// The text of a file with these Gaussians.
fn ply(names: &[&str], rows: &[Vec<&str>]) -> String {
    let properties: String = names
        .iter()
        .map(|name| format!("property float {name}\n"))
        .collect();
    let rows: Vec<String> = rows.iter().map(|row| row.join(" ")).collect();
    format!(
        "ply\nformat ascii 1.0\nelement vertex {}\n{properties}end_header\n{}\n",
        rows.len(),
        rows.join("\n")
    )
}

/// The ordinary Gaussian with other values of properties whose name starts so.
fn with(property: &str, value: &'static str) -> Vec<&'static str> {
    let columns = NAMES.iter().zip(ORDINARY);
    columns
        .map(|(name, ordinary)| {
            if name.starts_with(property) {
                value
            } else {
                ordinary
            }
        })
        .collect()
}

const RENDER: [&str; 8] = [
    "render",
    "s.ply",
    "--cameras",
    "c.json",
    "--out",
    "out",
    "--device",
    "flex",
];

/// The only picture of a file with these Gaussians, and what was said.
fn picture(scratch: &Scratch, rows: &[Vec<&str>]) -> (Vec<u8>, String) {
    scratch.write("s.ply", ply(&NAMES, rows));
    let output = scratch
        .command(&RENDER)
        .output()
        .expect("the binary starts");
    let said = text(&output.stderr);
    assert!(output.status.success(), "{said}");
    let folder = scratch.path("out/full");
    let mut files = std::fs::read_dir(&folder).expect("a folder of pictures");
    let file = files.next().expect("a picture").expect("an entry").path();
    let picture = std::fs::read(file).expect("a picture");
    std::fs::remove_dir_all(scratch.path("out")).expect("removes");
    (picture, said)
}

#[test]
fn extreme_values_are_drawn_as_their_limit_and_what_is_left_out_is_counted() {
    let scratch = Scratch::new();
    scratch.write("c.json", CAMERA);
    let drawn = |property, value| picture(&scratch, &[with(property, value)]).0;
    let empty = drawn("opacity", "-30");
    for (property, value, limit) in [
        ("opacity", "inf", "30"),
        ("opacity", "3e38", "30"),
        ("opacity", "-3e38", "-30"),
        ("scale_0", "-inf", "-30"),
        ("scale_", "-3e38", "-30"),
        // As wide as the picture and wider looks alike.
        ("scale_", "18", "8"),
        ("scale_", "25", "8"),
        ("scale_", "44", "8"),
        ("scale_", "3e38", "8"),
        ("scale_", "inf", "8"),
        ("scale_1", "60", "8"),
        ("rot_0", "1e-20", "1"),
        ("rot_0", "3e38", "1"),
        ("rot_0", "-7", "1"),
        ("f_dc_0", "3e38", "1e5"),
        ("f_dc_", "-3e38", "-1e5"),
        ("z", "3e38", "1e9"),
    ] {
        let expected = drawn(property, limit);
        assert_eq!(drawn(property, value), expected, "{property} {value}");
        let is_seen = !value.contains("-3e38") || property.starts_with("scale");
        assert_eq!(expected != empty, is_seen, "{property} {limit}");
    }
    let rows = [
        with("opacity", "-inf"),
        with("x", "0"),
        with("rot_", "0"),
        with("opacity", "-inf"),
    ];
    let (seen, said) = picture(&scratch, &rows);
    let (alone, silence) = picture(&scratch, &[with("x", "0")]);
    assert_eq!(seen, alone);
    assert!(!silence.contains("left out"), "{silence}");
    let count =
        "left out Gaussians: 2 with opacity 0 (a logit of -inf), 1 with a rotation of zeros";
    assert!(said.contains("s.ply") && said.contains(count), "{said}");
    scratch.write("s.ply", ply(&NAMES, &rows));
    let told = scratch.ok(&["info", "s.ply"]);
    assert!(
        told.contains("2 with opacity 0") && !told.contains("points"),
        "{told}"
    );
}

#[test]
fn values_without_a_limit_and_damaged_files_are_refused_and_no_points() {
    let scratch = Scratch::new();
    scratch.write("c.json", CAMERA);
    for name in NAMES {
        scratch.write("s.ply", ply(&NAMES, &[with("x", "0"), with(name, "nan")]));
        scratch.fails(&RENDER, &format!("`{name}` NaN at vertex 1"));
        scratch.fails(&["info", "s.ply"], &format!("`{name}` NaN at vertex 1"));
        let columns = NAMES.iter().filter(|other| **other != name);
        let fewer: Vec<&str> = columns.copied().collect();
        scratch.write("s.ply", ply(&fewer, &[vec!["0"; fewer.len()]]));
        scratch.fails(&["info", "s.ply"], &format!("`{name}`"));
    }
}

#[test]
fn training_tells_of_points_whose_colours_have_other_names() {
    let scratch = Scratch::with_room("n3dv");
    let names = [
        "x",
        "y",
        "z",
        "diffuse_red",
        "diffuse_green",
        "diffuse_blue",
    ];
    let rows = vec![vec!["0", "0.1", "0.2", "1", "0", "0"]; 50];
    scratch.write("room/points3D_downsample2.ply", ply(&names, &rows));
    let mut args = vec![
        "train",
        "room",
        "--out",
        "run",
        "--iterations",
        "10",
        "--preset",
        "quick",
    ];
    args.extend(TINY);
    let output = scratch.command(&args).output().expect("the binary starts");
    let said = text(&output.stderr);
    assert!(output.status.success(), "{said}");
    let words = [
        "points3D_downsample2.ply",
        "found diffuse_red, diffuse_green, diffuse_blue",
        "gray",
    ];
    for word in words {
        assert!(said.contains(word), "`{word}` is not in: {said}");
    }
}
