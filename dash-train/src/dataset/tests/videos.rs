//! Frames of videos, in memory and on demand.

use super::super::{Dataset, LoadOptions};
use super::n3dv::row;
use crate::test_kit::{Fixture, assert_cameras_equal, camera, ffmpeg, grey_frames, npy_f64, run};

/// Writes a short video of frames with rising brightness.
pub(super) fn write_video(fixture: &Fixture, name: &str, n_frames: usize, base: usize) {
    let shades = (0..n_frames).map(|frame| base + 30 * frame);
    write_video_with(fixture, name, shades, &["-c:v", "mpeg4", "-q:v", "1"]);
}

pub(super) fn write_video_with(
    fixture: &Fixture,
    name: &str,
    shades: impl Iterator<Item = usize>,
    encoding: &[&str],
) {
    let frames = grey_frames(fixture, &format!("frames_of_{name}"), [64, 48], shades);
    let mut command = ffmpeg();
    command.arg("-i").arg(frames).args(encoding);
    command.args(["-movflags", "+faststart"]);
    run(command.arg(fixture.path(name)));
}

#[test]
fn videos_are_decoded_frame_by_frame() {
    let fixture = Fixture::new();
    let large: Vec<_> = (0..2).map(|i| row(&camera(i).resized(64, 48))).collect();
    fixture.write("poses_bounds.npy", npy_f64(&large));
    write_video(&fixture, "cam01.mp4", 5, 20);
    write_video(&fixture, "cam00.mp4", 5, 60);
    let options = LoadOptions {
        downscale: 8.0,
        ..LoadOptions::default()
    };
    let dataset = fixture.load_with(&options).expect("loads");
    assert_eq!(
        (dataset.n_cameras, dataset.n_frames, dataset.views.len()),
        (2, 5, 10)
    );
    for (index, view) in dataset.views.iter().enumerate() {
        let (camera_index, frame) = (index / 5, index % 5);
        assert_eq!(view.name, format!("cam0{camera_index}/{frame:04}"));
        assert_eq!(view.time, frame as f32 / 4.0);
        assert_cameras_equal(&view.camera, &camera(camera_index));
        let expected = ([60, 20][camera_index] + 30 * frame) as f32 / 255.0;
        for got in view.rgb([0.0; 3]).expect("in memory") {
            assert!(
                (got - expected).abs() < 6.0 / 255.0,
                "view {index}: got {got}, expected {expected}"
            );
        }
    }
    let tiny = LoadOptions {
        downscale: 1000.0,
        ..LoadOptions::default()
    };
    let refused = fixture.load_with(&tiny).expect_err("nothing is left");
    assert!(refused.to_string().contains("leaves 1x1"), "{refused}");
    let some = LoadOptions {
        frame_stride: 2,
        max_frames: Some(2),
        ..options.clone()
    };
    let names: Vec<String> = fixture
        .load_with(&some)
        .expect("loads")
        .views
        .into_iter()
        .map(|v| v.name)
        .collect();
    assert_eq!(
        names,
        ["cam00/0000", "cam00/0002", "cam01/0000", "cam01/0002"]
    );
    let later = LoadOptions {
        frames: Some("2-9".parse().expect("a range")),
        max_frames: None,
        ..some.clone()
    };
    let views = fixture.load_with(&later).expect("loads").views;
    let found: Vec<_> = views
        .iter()
        .map(|v| (v.name.as_str(), v.frame, v.time))
        .collect();
    assert_eq!(
        found,
        [
            ("cam00/0002", 0, 0.0),
            ("cam00/0004", 1, 1.0),
            ("cam01/0002", 0, 0.0),
            ("cam01/0004", 1, 1.0)
        ]
    );
    let whole = std::fs::read(fixture.path("cam01.mp4")).expect("written above");
    for end in [0, 10, 300, whole.len() / 2, whole.len() - 40] {
        fixture.write("cam01.mp4", &whole[..end]);
        fixture.refuses(&["cam01"]);
    }
    write_video(&fixture, "cam01.mp4", 4, 20);
    fixture.refuses(&["cam01", "5 frames", "cam00", "found 4"]);
}

/// Groups of four pictures, some of which the file holds out of order.
#[test]
fn videos_on_demand_give_the_frames_of_videos_in_memory() {
    const N: usize = 23;
    let fixture = Fixture::new();
    let large: Vec<_> = (0..2).map(|i| row(&camera(i).resized(64, 48))).collect();
    fixture.write("poses_bounds.npy", npy_f64(&large));
    for (camera, base) in [("cam00", 20), ("cam01", 40)] {
        let step = 8;
        write_video_with(
            &fixture,
            &format!("{camera}.mp4"),
            (0..N).map(|frame| base + step * frame),
            &["-c:v", "mpeg4", "-q:v", "1", "-g", "4", "-bf", "2"],
        );
    }
    let in_memory = fixture.load().expect("loads");
    assert_eq!(in_memory.views.len(), 2 * N);
    let options = LoadOptions {
        memory: Some(in_memory.image_bytes() / 2),
        threads: Some(2),
        ..LoadOptions::default()
    };
    let on_demand = fixture.load_with(&options).expect("loads");
    assert!(on_demand.frame_statistics().is_some() && in_memory.frame_statistics().is_none());
    on_demand.announce([7, 40, 2, 9, 0].into_iter().map(|i| &on_demand.views[i]));
    for index in [7, 40, 2, 9, 0].into_iter().chain(0..2 * N) {
        let pixels = |dataset: &Dataset| dataset.views[index].rgb([0.0; 3]).expect("decodes");
        assert!(
            pixels(&on_demand) == pixels(&in_memory),
            "view {index} differs"
        );
    }
}
