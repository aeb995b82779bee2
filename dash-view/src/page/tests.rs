use std::sync::LazyLock;

use burn::tensor::Device;
use dash_model::{GaussianRows, Gaussians, SceneSettings};

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

/// Windows that share a room of nine Gaussians, in different orders and of different SH degrees, but for one that the second
/// lacks; each has two of its own, and the last a twin of one of the room's.
struct Three;

impl WindowSource for Three {
    fn times(&self) -> &TimeWindows {
        static TIMES: LazyLock<TimeWindows> =
            LazyLock::new(|| TimeWindows::new(vec![[0.0, 0.4], [0.3, 0.7], [0.6, 1.0]]));
        &TIMES
    }

    fn scene(&self, window: usize) -> Result<DynamicScene, ViewError> {
        let mut room = still(9).static_set.to_rows();
        for (k, logit) in room.opacity_logits.iter_mut().enumerate() {
            *logit = ((k * 5) % 9) as f32;
        }
        let kept: Vec<usize> = match window {
            0 => (0..9).collect(),
            1 => (1..9).rev().collect(),
            _ => (0..9).chain([4]).collect(),
        };
        let own = [[window as f32, 7.0, 1.0], [window as f32, 8.0, 1.0]];
        let mut rows = GaussianRows::from_points(&own, &[[0.5; 3]; 2], 0, 0.1);
        rows.append(&room.gather(&kept));
        let mut scene = still(0);
        scene.static_set = Gaussians::from_rows(&rows.with_sh_degree(window), &Device::flex());
        Ok(scene)
    }
}

/// What is seen of a scene: its static Gaussians in the order of where they are, without SH coefficients.
fn seen(scene: &DynamicScene) -> Vec<([u32; 3], u32)> {
    let rows = scene.static_set.to_rows();
    let of_row = |row: usize| {
        (
            rows.means[row].map(f32::to_bits),
            rows.opacity_logits[row].to_bits(),
        )
    };
    let mut seen: Vec<_> = (0..rows.len()).map(of_row).collect();
    seen.sort_unstable();
    seen
}

#[test]
fn windows_share_their_room_and_are_whole_again_when_their_parts_are_here() {
    let content = Content::new("long", Source::Windows(Box::new(Three)), 9);
    let page = Page::new(&content, PLAYER, b"poster").expect("sound");
    let files = page.folder();
    let about = unpacked(&files["about.json.gz"]);
    let about = About::read(std::str::from_utf8(&about).expect("text")).expect("JSON");
    assert_eq!(about.times, Three.times().clone());
    assert_eq!((about.room.parts, &about.parts), (1, &vec![1; 3]));
    let part = |name: PartName| {
        let [json, tensors] =
            ["json", "bin"].map(|kind| unpacked(&files[&format!("{name}.{kind}.gz")]));
        DynamicScene::from_bytes(&json, &tensors, &Device::flex()).expect("a scene")
    };
    let (mut arrived, mut names) = (Arrived::default(), Vec::new());
    for present in [vec![0], vec![1, 2]] {
        while let Some(name) = arrived.wanted(&about, &present) {
            arrived.add(name.owner, part(name));
            names.push(format!("{name} of {}", part(name).counts().0));
        }
        for window in present {
            let whole = arrived.scene(&about, window).expect("it is here");
            assert_eq!(seen(&whole), seen(&Three.scene(window).expect("made")));
        }
    }
    // The window that comes next is there before it is needed.
    let expected = [
        "room_part0 of 9",
        "part0 of 2",
        "window1_part0 of 2",
        "window2_part0 of 3",
    ];
    assert_eq!(names, expected);
    assert!(arrived.has(0));
}

#[test]
fn windows_that_share_nothing_have_no_room() {
    struct Apart;
    impl WindowSource for Apart {
        fn times(&self) -> &TimeWindows {
            Three.times()
        }

        fn scene(&self, window: usize) -> Result<DynamicScene, ViewError> {
            let mut scene = still(3);
            let mut rows = scene.static_set.to_rows();
            rows.opacity_logits = vec![window as f32; 3];
            scene.static_set = Gaussians::from_rows(&rows, &Device::flex());
            Ok(scene)
        }
    }
    let content = Content::new("apart", Source::Windows(Box::new(Apart)), 9);
    let files = Page::new(&content, PLAYER, b"poster")
        .expect("sound")
        .folder();
    assert!(!files.keys().any(|name| name.starts_with("room")));
    assert!(files.contains_key("window2_part0.bin.gz"));
}

#[test]
fn far_windows_are_dropped_and_needed_ones_are_not() {
    let content = Content::new("long", Source::Windows(Box::new(Three)), 9);
    let page = Page::new(&content, PLAYER, b"poster").expect("sound");
    let about = unpacked(&page.folder()["about.json.gz"]);
    let mut about = About::read(std::str::from_utf8(&about).expect("text")).expect("JSON");
    about.times = TimeWindows::new(
        (0..7)
            .map(|k| [k as f32 / 7.0, (k + 1) as f32 / 7.0])
            .collect(),
    );
    let mut arrived = Arrived::default();
    for window in 0..7 {
        arrived.add(Owner::Window(window), still(1));
        arrived.tidy(&about, &[window]);
    }
    let here: Vec<usize> = (0..7).filter(|&window| arrived.has(window)).collect();
    assert_eq!(here, [3, 4, 5, 6]);
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
