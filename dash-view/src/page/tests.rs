use std::sync::LazyLock;

use burn::tensor::Device;
use dash_model::{GaussianRows, Gaussians, SceneSettings};

use crate::WindowSource;

use super::*;

const PLAYER: PlayerCode = PlayerCode {
    script: "let wasm_bindgen;",
    module: b"\0asm",
};

/// So many Gaussians at rest.
fn still(n: usize) -> DynamicScene {
    let points: Vec<[f32; 3]> = (0..n).map(|k| [0.3 * k as f32, 0.0, 0.2]).collect();
    let rows = GaussianRows::from_points(&points, &vec![[0.9, 0.2, 0.1]; n], 0, 0.1);
    DynamicScene {
        static_set: Gaussians::from_rows(&rows, &Device::flex()),
        dynamic: None,
        settings: SceneSettings::default(),
    }
}

fn page(name: &str) -> Page {
    let scene = still(2);
    let mut content = Content::new(name, Source::Scene(Box::new(scene)), 1);
    content.cameras.push(NamedCamera {
        name: "left".into(),
        camera: Camera::new(40.0, 41.0, 15.0, 13.0, 32, 24).look_at(
            [0.0, 0.0, -3.0],
            [0.0; 3],
            [0.0, -1.0, 0.0],
        ),
        time: None,
        held_out: false,
    });
    Page::new(&content, PLAYER, b"poster").expect("two Gaussians")
}

fn unpacked(bytes: &[u8]) -> Vec<u8> {
    let mut text = Vec::new();
    let mut decoder = flate2::read::GzDecoder::new(bytes);
    std::io::Read::read_to_end(&mut decoder, &mut text).expect("gzip");
    text
}

#[test]
fn a_page_says_what_there_is_to_see() {
    let files = page("room").folder();
    let about = unpacked(&files["about.json.gz"]);
    let about = About::read(std::str::from_utf8(&about).expect("text")).expect("JSON");
    assert_eq!((about.parts, about.n_frames), (vec![1], 1));
    let camera = about.cameras[0].camera();
    assert_eq!((camera.fy, camera.cx, camera.height), (41.0, 15.0, 24));
    assert!((camera.position()[2] + 3.0).abs() < 1e-12);
    let part = [&files["part0.json.gz"], &files["part0.bin.gz"]].map(|file| unpacked(file));
    let scene = DynamicScene::from_bytes(&part[0], &part[1], &Device::flex());
    assert_eq!(scene.expect("a scene").counts(), (2, 0));
    for name in [
        "index.html",
        "player.js",
        "dash_view.js",
        "player.wasm.gz",
        "poster.png",
    ] {
        assert!(!files[name].is_empty(), "{name}");
    }
}

struct Two;

impl WindowSource for Two {
    fn times(&self) -> &TimeWindows {
        static TIMES: LazyLock<TimeWindows> =
            LazyLock::new(|| TimeWindows::new(vec![[0.0, 0.6], [0.4, 1.0]]));
        &TIMES
    }

    fn scene(&self, window: usize) -> Result<DynamicScene, ViewError> {
        Ok(still(2 + window))
    }
}

#[test]
fn windows_of_time_have_files_of_their_own() {
    let content = Content::new("long", Source::Windows(Box::new(Two)), 9);
    let files = Page::new(&content, PLAYER, b"poster")
        .expect("sound")
        .folder();
    let about = unpacked(&files["about.json.gz"]);
    let about = About::read(std::str::from_utf8(&about).expect("text")).expect("JSON");
    assert_eq!(
        (about.parts, about.times),
        (vec![1, 1], Two.times().clone())
    );
    for (prefix, n) in [("", 2), ("window1_", 3)] {
        let part =
            ["json", "bin"].map(|kind| unpacked(&files[&format!("{prefix}part0.{kind}.gz")]));
        let scene = DynamicScene::from_bytes(&part[0], &part[1], &Device::flex());
        assert_eq!(scene.expect("a scene").counts(), (n, 0));
    }
}

/// A name is text, whatever it holds, and stands for nothing else in the page.
#[test]
fn names_are_text() {
    let page = page(r#"</title><script>"&{{FILES}}"#);
    for html in [
        page.single_file(),
        index(&page.name, "const FILES = null;", ""),
    ] {
        let title = "<title>&lt;/title>&lt;script>&quot;&amp;{{FILES}}</title>";
        assert!(html.contains(title));
        assert_eq!(html.matches("const FILES = ").count(), 1);
    }
}

#[test]
fn one_file_has_all_files() {
    let page = page("room");
    let html = page.single_file();
    for (name, bytes) in &page.files {
        assert!(html.contains(&format!("\"{name}\":\"{}\"", STANDARD.encode(bytes))));
    }
    assert!(!html.contains("src=\"player.js\"") && html.contains("wasm_bindgen.Player.start"));
}

#[test]
fn another_description_is_refused() {
    let error = About::read("{\"name\": 3}").expect_err("no description");
    assert!(error.to_string().contains("the page's description"));
}
