//! Dialects of PLY, colours, and hostile headers.

use super::*;

fn read_text(text: &str) -> Result<Parsed, Error> {
    parse(Path::new("cloud.ply"), text.as_bytes().to_vec())
}

fn cloud() -> PointCloud {
    PointCloud {
        positions: vec![[1.0, -2.5, 3.0], [0.1, 0.2, 0.3]],
        colors: vec![[255, 0, 7], [1, 2, 3]],
    }
}

#[test]
fn written_points_read_back_exactly_and_every_truncation_is_an_error() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("points.ply");
    write_points(&path, &cloud()).expect("writes");
    assert_eq!(read_points(&path).expect("reads"), cloud());

    let bytes = fs::read(&path).expect("written above");
    for end in 0..bytes.len() {
        let error = parse(&path, bytes[..end].to_vec()).expect_err("truncated");
        assert!(error.to_string().contains("points.ply"), "{error}");
    }
}

#[test]
fn ascii_with_doubles_extra_columns_earlier_elements_and_real_colors() {
    let Parsed {
        points,
        n_dropped,
        lacks_colors,
    } = read_text(
        "ply\nformat ascii 1.0\ncomment made by hand\nelement camera 1\nproperty list uchar int a\n\
         element vertex 4\nproperty double z\nproperty float extra\nproperty double y\n\
         property double x\nproperty float red\nproperty float green\nproperty float blue\n\
         element face 0\nproperty list uchar int vertex_indices\nend_header\n3 7 8 9\n\
         3 0 2 1 1.0 0.5 0\nnan 0 2 1 1 1 1\n1 0 1e39 1 1 1 1\n6 0 5 4 0 0 1",
    )
    .expect("valid");
    assert_eq!(points.positions, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    assert_eq!(points.colors, [[255, 128, 0], [0, 0, 255]]);
    assert_eq!(n_dropped, 2, "NaN and what overflows f32");
    assert_eq!(lacks_colors, None);
}

#[test]
fn points_without_colors_of_the_usual_names_are_gray_and_told() {
    for (colors, found) in [
        ("", "nothing but positions"),
        ("nx ny nz", "nothing but positions"),
        (
            "diffuse_red diffuse_green diffuse_blue",
            "diffuse_red, diffuse_green, diffuse_blue",
        ),
        ("r g b", "r, g, b"),
        ("Red Green Blue", "Red, Green, Blue"),
        ("f_dc_0 f_dc_1 f_dc_2", "f_dc_0, f_dc_1, f_dc_2"),
        ("red green", "red, green"),
        ("scalar_R scalar_G scalar_B", "scalar_R"),
    ] {
        let names: Vec<&str> = "x y z"
            .split(' ')
            .chain(colors.split_ascii_whitespace())
            .collect();
        let properties = names.iter().map(|name| format!("property float {name}\n"));
        let properties: String = properties.collect();
        let numbers: Vec<String> = (0..names.len()).map(|n| n.to_string()).collect();
        let header = format!("ply\nformat ascii 1.0\nelement vertex 1\n{properties}end_header\n");
        let parsed = read_text(&(header + &numbers.join(" "))).expect("valid");
        assert_eq!(parsed.points.colors, [[NEUTRAL_GRAY; 3]], "{colors}");
        let told = parsed.lacks_colors.expect(colors);
        assert!(told.contains(&format!("found {found}")), "{told}");
    }
}

#[test]
fn big_endian_is_read() {
    let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty float x\n\
        property float y\nproperty float z\nproperty uchar red\nproperty uchar green\n\
        property uchar blue\nend_header\n"
        .to_vec();
    for v in [1.0f32, 2.0, 3.0] {
        bytes.extend(v.to_be_bytes());
    }
    bytes.extend([9, 8, 7]);
    let points = parse(Path::new("cloud.ply"), bytes).expect("valid").points;
    assert_eq!(
        (points.positions[0], points.colors[0]),
        ([1.0, 2.0, 3.0], [9, 8, 7])
    );
}

#[test]
fn hostile_headers_are_errors() {
    let cases = [
        // A count without a row to hold it: endless or huge if it were believed.
        "ply\nformat ascii 1.0\nelement a 18446744073709551615\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex 9999999999\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n",
        "ply\nformat binary_little_endian 1.0\nelement f 1\nproperty list uint float a\nend_header\n\u{7f}\u{7f}\u{7f}\u{7f}",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n1 2\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar float x\nproperty float y\nproperty float z\nend_header\n1 1 2 3\n",
        "ply\nformat ascii 1.0\nelement vertex -1\nproperty float x\nend_header\n",
        "ply\nelement vertex 0\nproperty float x\nend_header\n",
        "ply\nformat ascii 1.0\nend_header\n",
        "solid cube\n",
        "",
    ];
    for text in cases {
        assert!(read_text(text).is_err(), "{text}");
    }
}

#[test]
fn a_highlight_or_a_hole_does_not_change_what_white_is() {
    let colors = |rows: &[&str], kind: &str| {
        let head = format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             property {kind} red\nproperty {kind} green\nproperty {kind} blue\nend_header\n",
            rows.len()
        );
        let rows: Vec<String> = rows.iter().map(|row| format!("0 0 0 {row}\n")).collect();
        read_text(&(head + &rows.concat()))
            .expect("valid")
            .points
            .colors
    };
    let mut real = vec!["1 0.5 0"; 100];
    assert_eq!(colors(&real, "float")[0], [255, 128, 0]);
    real.extend(["1.8 0.5 0", "nan 0.5 0"]);
    let found = colors(&real, "float");
    assert_eq!(found[0], [255, 128, 0]);
    assert_eq!(found[100..], [[255, 128, 0], [128, 128, 0]]);
    assert_eq!(colors(&["1 2 0", "200 100 3"], "float")[1], [200, 100, 3]);
    assert_eq!(colors(&["1 2 0", "255 100 3"], "ushort")[1], [255, 100, 3]);
    assert_eq!(colors(&["65535 32896 0"], "ushort"), [[255, 128, 0]]);
}
