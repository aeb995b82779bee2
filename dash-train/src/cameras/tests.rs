use super::*;

fn entry(id: u64) -> CameraEntry {
    let camera = Camera::new(500.0, 510.0, 301.5, 198.25, 640, 400).look_at(
        [1.0 + id as f64, -2.0, 0.5],
        [0.2, 0.1, 3.0],
        [0.0, 1.0, 0.0],
    );
    CameraEntry {
        id,
        img_name: format!("cam{id:02}"),
        camera,
        time: (id > 0).then_some(0.25),
    }
}

fn read(text: &str) -> Result<Vec<CameraEntry>, Error> {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("cameras.json");
    std::fs::write(&path, text).expect("a scratch file");
    read_cameras(&path)
}

/// An entry as 3DGS writes it, with `replacement` for one of its lines.
fn json(replace: &str, replacement: &str) -> String {
    const CAMERA: &str = r#"[{"id": 7, "img_name": "a_0001", "width": 80, "height": 60,
        "position": [1.0, 2.0, 3.0],
        "rotation": [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        "fy": 90.0, "fx": 95.0}]"#;
    assert!(CAMERA.contains(replace), "{replace}");
    CAMERA.replace(replace, replacement)
}

fn complaint(replace: &str, replacement: &str) -> String {
    read(&json(replace, replacement))
        .expect_err("must be refused")
        .to_string()
}

#[test]
fn an_entry_of_3dgs_by_hand() {
    let cameras = read(&json("a_0001", "a_0001")).expect("a valid file");
    let [entry] = &cameras[..] else {
        panic!("one camera");
    };
    assert_eq!(
        (entry.id, entry.img_name.as_str(), entry.time),
        (7, "a_0001", None)
    );
    let camera = &entry.camera;
    assert_eq!(
        (camera.fx, camera.fy, camera.cx, camera.cy),
        (95.0, 90.0, 40.0, 30.0)
    );
    assert_eq!((camera.width, camera.height), (80, 60));
    assert_eq!(camera.position(), [1.0, 2.0, 3.0]);
    // The columns are the axes in the world: right is +y, down is +z, forward is +x.
    assert_eq!(camera.forward(), [1.0, 0.0, 0.0]);
    assert_eq!(camera.transform([5.0, 2.5, 3.25]), [0.5, 0.25, 4.0]);
}

#[test]
fn names_and_numbers_may_be_missing_and_sizes_may_be_written_as_fractions() {
    let text = json("\"id\": 7, \"img_name\": \"a_0001\", ", "");
    let text = text.replace("\"width\": 80", "\"width\": 80.0");
    let two = text.replace("}]", "}, {\"id\": 9, ") + &text[2..];
    let cameras = read(&two).expect("a valid file");
    let found: Vec<(u64, &str, usize)> = cameras
        .iter()
        .map(|entry| (entry.id, entry.img_name.as_str(), entry.camera.width))
        .collect();
    assert_eq!(found, [(0, "camera00", 80), (9, "camera01", 80)]);
}

#[test]
fn what_is_written_is_read_back() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("cameras.json");
    let written = [entry(0), entry(1), entry(2)];
    write_cameras(&path, &written).expect("writable");
    let read = read_cameras(&path).expect("readable");
    assert_eq!(read.len(), written.len());
    for (got, expected) in read.iter().zip(&written) {
        assert_eq!(
            (got.id, &got.img_name, got.time),
            (expected.id, &expected.img_name, expected.time)
        );
        // serde_json reads numbers to the last bit but one.
        let rotations = got.camera.rotation.iter().zip(&expected.camera.rotation);
        for (got, expected) in rotations.flat_map(|(a, b)| a.iter().zip(b)) {
            assert!((got - expected).abs() < 1e-15);
        }
        assert_eq!(got.camera.cx, expected.camera.cx);
        for (got, expected) in got
            .camera
            .translation
            .iter()
            .zip(expected.camera.translation)
        {
            assert!((got - expected).abs() < 1e-12);
        }
    }
    let files = std::fs::read_dir(folder.path()).expect("a folder").count();
    assert_eq!(files, 1, "no scratch file is left");
}

#[test]
fn bad_files_are_refused_with_the_reason() {
    for (text, expected) in [
        ("", "not JSON"),
        ("3", "another kind of JSON value"),
        ("{\"cameras\": []}", "an object without `frames`"),
        ("{\"frames\": []}", "at least one frame"),
        ("[]", "an empty list"),
        ("[3]", "camera 0: "),
        ("[{}]", "missing field"),
    ] {
        let error = read(text).expect_err(text).to_string();
        assert!(
            error.contains("cameras.json") && error.contains(expected),
            "{error}"
        );
    }
    let other = read("{}").expect_err("of neither kind").to_string();
    for kind in ["`cameras.json` of 3DGS", "`transforms.json` of NeRF"] {
        assert!(other.contains(kind), "{other}");
    }
    let missing = read_cameras(Path::new("/nowhere/cameras.json")).expect_err("no such file");
    assert!(
        missing
            .to_string()
            .contains("/nowhere/cameras.json: cannot read it")
    );
}

#[test]
fn bad_entries_are_refused_with_the_reason() {
    for (replace, replacement, expected) in [
        (
            "\"width\": 80",
            "\"width\": 0",
            "`width` from 1 to 16384 pixels, found 0",
        ),
        (
            "\"height\": 60",
            "\"height\": 99999",
            "`height` from 1 to 16384",
        ),
        ("\"width\": 80", "\"width\": 80.5", "80.5"),
        ("\"width\": 80, ", "", "missing field `width`"),
        ("95.0", "-95.0", "positive focal length `fx`"),
        ("90.0", "0", "positive focal length `fy`"),
        ("90.0", "1e999", "not JSON"),
        ("90.0", "NaN", "not JSON"),
        ("95.0}", "95.0, \"time\": 3}", "`time` from 0 to 1"),
        ("[1.0, 2.0, 3.0]", "[1.0, 2.0]", "length 2"),
        ("[0.0, 0.0, 1.0]", "[0.0, 0.0, 2.0]", "not orthonormal"),
        ("[0.0, 0.0, 1.0]", "[0.0, 0.1, 1.0]", "not orthonormal"),
        ("[0.0, 0.0, 1.0]", "[0.0, 0.0, 0.0]", "not orthonormal"),
        ("[0.0, 0.0, 1.0]", "[0.0, 0.0, -1.0]", "a reflection"),
    ] {
        let error = complaint(replace, replacement);
        assert!(error.contains(expected), "{replacement}: {error}");
    }
    let named = complaint("95.0", "-95.0");
    assert!(named.contains("camera 0 (a_0001): "), "{named}");
}

#[test]
fn cameras_that_could_not_be_read_are_not_written() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("cameras.json");
    let mut bad = entry(1);
    bad.camera.translation[1] = f64::NAN;
    let error = write_cameras(&path, &[entry(0), bad]).expect_err("must be refused");
    assert!(
        error
            .to_string()
            .contains("camera 1 (cam01): expected a finite `position`")
    );
    assert!(!path.exists());
}
