//! Folders that are no dataset that can be read, and what is said of them.

use super::super::{Layout, LoadOptions, load};
use crate::test_kit::Fixture;

#[test]
fn unknown_folders_say_what_was_looked_for() {
    let empty = Fixture::new();
    empty.refuses(&["empty folder"]);
    empty.write("notes.txt", "nothing");
    empty.refuses(&[
        "poses_bounds.npy",
        "transforms_train.json",
        "sparse/0",
        "notes.txt",
        "--layout",
    ]);
    let missing = load(&empty.root().join("nowhere"), &LoadOptions::default());
    assert!(
        missing
            .expect_err("missing")
            .to_string()
            .contains("nowhere")
    );
}

#[test]
fn recordings_without_poses_are_told_from_folders_that_are_no_dataset() {
    let videos = Fixture::new();
    videos.write("left.mp4", "");
    videos.refuses(&["left.mp4", "--layout"]);
    videos.write("right.MOV", "");
    videos.refuses(&["2 videos, and no poses", "dash prepare"]);
    let inner = Fixture::new();
    inner.write("videos/left.mp4", "");
    inner.write("videos/right.mp4", "");
    inner.refuses(&["2 videos, and no poses", "dash prepare"]);
    let images = Fixture::new();
    images.write("left/0000.png", "");
    images.write("images_2/0000.png", "");
    images.refuses(&["--layout"]);
    images.write("right/0000.png", "");
    images.refuses(&["2 folders of images, and no poses", "dash prepare"]);
    let run = Fixture::new();
    run.write("config.toml", "");
    run.refuses(&["found a run", "dash info"]);
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
