//! Folders that are no dataset that can be read, and what is said of them.

use super::super::{Layout, LoadOptions, load};
use crate::test_kit::Fixture;

#[test]
fn unknown_folders_say_what_was_looked_for() {
    let empty = Fixture::new();
    empty.refuses(&[
        "poses_bounds.npy",
        "transforms_train.json",
        "sparse/0",
        "empty folder",
    ]);
    empty.write("notes.txt", "nothing");
    empty.refuses(&["notes.txt", "--layout"]);
    let missing = load(&empty.root().join("nowhere"), &LoadOptions::default());
    assert!(
        missing
            .expect_err("missing")
            .to_string()
            .contains("nowhere")
    );
}

#[test]
fn datasets_in_a_folder_are_named() {
    let fixture = Fixture::new();
    fixture.write("a/notes.txt", "");
    // A model without its images is none.
    fixture.write("b/sparse/0/cameras.txt", "");
    let message = fixture.refuses(&["a, b; check the path"]);
    assert!(!message.contains("datasets among them"), "{message}");
    for name in ["c", "d", "e", "f"] {
        fixture.write(&format!("{name}/transforms.json"), "{}");
    }
    fixture.refuses(&[
        "(datasets among them: c, d, e)",
        "name the folder of one dataset",
    ]);
}

#[test]
fn captures_that_are_known_and_not_read_are_told_with_the_reason() {
    for (name, words) in [
        ("models.json", ["fisheye", "make perspective videos"]),
        ("annots.npy", ["pickled", "transforms.json (rig)"]),
    ] {
        let fixture = Fixture::new();
        fixture.write(name, "[]");
        fixture.write("camera_0001/000000.txt", "");
        fixture.refuses(&[name, words[0], words[1]]);
    }
}

#[test]
fn a_file_in_place_of_a_folder_is_told() {
    let fixture = Fixture::new();
    fixture.write("x.zip", "PK");
    for layout in [None, Some(Layout::N3dv), Some(Layout::Colmap)] {
        let options = LoadOptions {
            layout,
            ..LoadOptions::default()
        };
        let error = load(&fixture.path("x.zip"), &options).expect_err("a file");
        let message = error.to_string();
        let words = "x.zip: expected a folder, found a file";
        assert!(message.contains(words), "{message}");
    }
}
