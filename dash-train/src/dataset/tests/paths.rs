//! Links, and names in either Unicode form.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;

use serde_json::{Value, json};

use super::super::{Dataset, LoadOptions, Partition, load};
use super::blender::{dnerf, matrix, single, write_single};
use super::{colmap, llff, nerfies, rig, technicolor};
use crate::test_kit::{Fixture, H, W, assert_cameras_equal, camera, write_model};

/// A view's name, its camera's translation and its pixels.
type Seen = (String, Vec<f64>, Vec<f32>);

/// What tells datasets apart: their views and how many points they have.
fn seen(dataset: &Dataset) -> (Vec<Seen>, usize) {
    let views = dataset.views.iter().map(|view| {
        let pixels = view.rgb([0.0; 3]).expect("in memory").to_vec();
        (view.name.clone(), view.camera.translation.to_vec(), pixels)
    });
    (
        views.collect(),
        dataset.points.as_ref().map_or(0, |points| points.len()),
    )
}

/// Every file below a folder.
fn files(folder: &Path) -> Vec<std::path::PathBuf> {
    let entries = fs::read_dir(folder)
        .expect("lists")
        .map(|entry| entry.expect("an entry").path());
    let inner = |path: std::path::PathBuf| match path.is_dir() {
        true => files(&path),
        false => vec![path],
    };
    entries.flat_map(inner).collect()
}

fn captures() -> Vec<(&'static str, Fixture)> {
    vec![
        ("blender", dnerf()),
        ("colmap", colmap::capture("sparse/0")),
        ("llff", llff::capture(3)),
        ("nerfies", nerfies::capture()),
        ("rig", rig::with_model()),
        ("technicolor", technicolor::raw("Rugby", 3, 1..2)),
    ]
}

#[test]
fn a_link_to_a_dataset_is_the_dataset() {
    for (name, fixture) in captures() {
        let expected = seen(&fixture.load().expect(name));
        let elsewhere = Fixture::new();
        let absolute = elsewhere.root().join("absolute");
        symlink(fixture.root(), &absolute).expect("a link");
        symlink("absolute", elsewhere.root().join("relative")).expect("a link");
        for link in ["absolute", "relative"] {
            let dataset = load(&elsewhere.root().join(link), &LoadOptions::default()).expect(name);
            assert_eq!(seen(&dataset), expected, "{name} by a link that is {link}");
        }
    }
}

#[test]
fn links_to_files_and_folders_are_followed() {
    for (name, fixture) in captures() {
        let expected = seen(&fixture.load().expect(name));
        let store = Fixture::new();
        for relative in [false, true] {
            for (number, path) in files(fixture.root()).into_iter().enumerate() {
                if path.is_symlink() {
                    continue;
                }
                let moved = match relative {
                    // Beside the file itself, without a name that a layout would take for one of its own.
                    true => path.with_file_name(format!(".{number}")),
                    false => store.root().join(number.to_string()),
                };
                fs::copy(&path, &moved).expect("copies");
                fs::remove_file(&path).expect("removes");
                let target = match relative {
                    true => Path::new(moved.file_name().expect("a name")).to_path_buf(),
                    false => moved,
                };
                symlink(target, &path).expect("a link");
            }
            assert_eq!(
                seen(&fixture.load().expect(name)),
                expected,
                "{name}, relative: {relative}"
            );
        }
    }
    // The folder of the images.
    let fixture = colmap::capture("sparse/0");
    let expected = seen(&fixture.load().expect("loads"));
    let store = Fixture::new();
    fs::rename(
        fixture.root().join("images"),
        store.root().join("elsewhere"),
    )
    .expect("moves");
    symlink(
        store.root().join("elsewhere"),
        fixture.root().join("images"),
    )
    .expect("a link");
    assert_eq!(seen(&fixture.load().expect("loads")), expected);
}

#[test]
fn links_that_lead_nowhere_are_told() {
    let fixture = rig::with_model();
    symlink("nowhere.png", fixture.root().join("images/left/002.png")).expect("a link");
    fixture.refuses(&["images", "3"]);
    let fixture = single(2, json!({"fl_x": 9.0}));
    fixture.remove("images/1.png");
    symlink("nowhere.png", fixture.root().join("images/1.png")).expect("a link");
    fixture.refuses(&["images/1.png", "no such file"]);
}

const NFC: &str = "caf\u{e9}";
const NFD: &str = "cafe\u{301}";

#[test]
fn names_in_either_form_mean_one_file() {
    for [listed, there] in [[NFC, NFD], [NFD, NFC], [NFC, NFC], [NFD, NFD]] {
        for extension in [".png", ""] {
            let fixture = Fixture::new();
            let frames: Vec<Value> = (0..3)
                .map(|index| {
                    let name = |form: &str| format!("{form}/{form}_{index}");
                    fixture.image(&format!("{}.png", name(there)), W, H, [index as u8; 3]);
                    let path = format!("{}{extension}", name(listed));
                    json!({"file_path": path, "transform_matrix": matrix(&camera(index))})
                })
                .collect();
            let test = [format!("{listed}/{listed}_1.png")];
            write_single(
                &fixture,
                json!({"fl_x": 9.0, "test_filenames": test}),
                &frames,
            );
            let dataset = fixture.load().expect("loads");
            let held_out: Vec<bool> = dataset
                .views
                .iter()
                .map(|v| v.partition == Partition::Test)
                .collect();
            assert_eq!(held_out, [false, true, false], "{listed} {there}");
        }
        // A model of single images, and one of cameras.
        let fixture = Fixture::new();
        fixture.image(&format!("images/{there}.png"), W, H, [1; 3]);
        fixture.image("images/other.png", W, H, [2; 3]);
        let name = format!("{listed}.png");
        write_model(
            &fixture,
            "sparse/0",
            &[(name.as_str(), camera(0)), ("other.png", camera(1))],
        );
        assert_eq!(fixture.load().expect("loads").views.len(), 2);
        let fixture = Fixture::new();
        for (folder, frame) in [(there, 0), (there, 1), ("other", 0), ("other", 1)] {
            fixture.image(&format!("images/{folder}/{frame}.png"), W, H, [1; 3]);
        }
        write_model(
            &fixture,
            "sparse/0",
            &[("other.png", camera(1)), (name.as_str(), camera(0))],
        );
        let dataset = fixture.load().expect("loads");
        for view in &dataset.views {
            let index = usize::from(view.camera_name == "other");
            assert_cameras_equal(&view.camera, &camera(index));
        }
    }
}

#[test]
fn names_that_are_not_unicode_are_passed_over() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let fixture = rig::with_model();
    let expected = seen(&fixture.load().expect("loads"));
    for folder in ["", "images", "images/left", "sparse/0"] {
        let name = OsStr::from_bytes(b"\xff\xfe_0001.png");
        fs::write(fixture.root().join(folder).join(name), "").expect("writes");
    }
    assert_eq!(seen(&fixture.load().expect("loads")), expected);
    // A folder of such a name is a dataset like any other.
    let elsewhere = Fixture::new();
    let odd = elsewhere.root().join(OsStr::from_bytes(b"caf\xe9"));
    symlink(fixture.root(), &odd).expect("a link");
    assert_eq!(
        seen(&load(&odd, &LoadOptions::default()).expect("loads")),
        expected
    );
}
