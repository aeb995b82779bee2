//! Which times frames of videos have: evenly spaced ones, those of the stamps, and of videos whose stamps
//! differ.

use super::super::{Dataset, LoadOptions, load_decodable};
use super::n3dv::row;
use crate::Error;
use crate::test_kit::{Fixture, camera, ffmpeg, grey_frames, npy_f64, output, run};

const ENCODING: [&str; 8] = ["-c:v", "mpeg4", "-q:v", "1", "-g", "4", "-bf", "2"];
/// Brightness of a video's instants, from one to the next.
const STEP: usize = 8;
/// Stamps are listed to a microsecond, of clips of half a second and more.
const ROUNDING: f32 = 1e-5;

/// A frame's time stamp in 600ths of a second, and which instant it shows.
type Stamped = (u32, usize);

/// Frames at 30 a second of these instants.
fn at_30(instants: impl IntoIterator<Item = usize>) -> Vec<Stamped> {
    let stamped = |instant: usize| (20 * instant as u32, instant);
    instants.into_iter().map(stamped).collect()
}

fn shade(instant: usize) -> usize {
    20 + STEP * instant
}

/// Poses of cameras whose videos are written by the caller.
fn posed(n_cameras: usize) -> Fixture {
    let fixture = Fixture::new();
    let rows: Vec<_> = (0..n_cameras)
        .map(|i| row(&camera(i).resized(64, 48)))
        .collect();
    fixture.write("poses_bounds.npy", npy_f64(&rows));
    fixture
}

/// Cameras with a video each.
fn rig(videos: &[Vec<Stamped>]) -> Fixture {
    let fixture = posed(videos.len());
    for (index, frames) in videos.iter().enumerate() {
        write_stamped(&fixture, &format!("cam{index:02}.mp4"), frames);
    }
    fixture
}

/// Writes a video of frames with these time stamps.
fn write_stamped(fixture: &Fixture, name: &str, frames: &[Stamped]) {
    let terms: Vec<String> = frames
        .iter()
        .enumerate()
        .map(|(place, (stamp, _))| format!("eq(N\\,{place})*{stamp}"))
        .collect();
    let instants = frames.iter().map(|(_, instant)| *instant);
    write_video_at(fixture, name, instants, "600", &terms.join("+"));
}

/// Writes a video of these instants, stamped by an expression of `ffmpeg`'s filter `setpts`.
fn write_video_at(
    fixture: &Fixture,
    name: &str,
    instants: impl Iterator<Item = usize>,
    rate: &str,
    stamps: &str,
) {
    let folder = format!("frames_of_{name}");
    let frames = grey_frames(fixture, &folder, [64, 48], instants.map(shade));
    let filter = format!("setpts={stamps}");
    // The name of the option before ffmpeg 5.1 is the second.
    let written = ["-fps_mode", "-vsync"].into_iter().any(|passthrough| {
        let mut command = ffmpeg();
        command.args(["-framerate", rate, "-i"]).arg(&frames);
        command.args(["-vf", &filter, passthrough, "passthrough"]);
        command.args(ENCODING).arg(fixture.path(name));
        output(&mut command).status.success()
    });
    assert!(written, "ffmpeg could not write {name}");
}

/// `ffmpeg OPTIONS -i FROM -c copy MORE TO`.
#[track_caller]
fn copy(fixture: &Fixture, from: &str, to: &str, options: &[&str], more: &[&str]) {
    let mut command = ffmpeg();
    command.args(options).arg("-i").arg(fixture.path(from));
    command.args(["-c", "copy"]).args(more);
    run(command.arg(fixture.path(to)));
}

fn skipping() -> LoadOptions {
    LoadOptions {
        skip_broken: true,
        ..LoadOptions::default()
    }
}

/// The frame of each view, and which instant it shows, by camera.
fn shown(dataset: &Dataset) -> Vec<Vec<(usize, usize)>> {
    let mut shown = vec![Vec::new(); dataset.n_cameras];
    for view in &dataset.views {
        let value = 255.0 * view.rgb([0.0; 3]).expect("decodes")[0];
        let instant = ((value - shade(0) as f32) / STEP as f32).round();
        let off = value - (shade(0) as f32 + STEP as f32 * instant);
        assert!(off.abs() < 3.5, "{}: {value}", view.name);
        shown[view.camera_index].push((view.frame, instant as usize));
    }
    shown
}

/// Frame k shows instant k, but for those that are missing.
fn all_but(n_frames: usize, missing: &[usize]) -> Vec<(usize, usize)> {
    let frames = (0..n_frames).filter(|frame| !missing.contains(frame));
    frames.map(|frame| (frame, frame)).collect()
}

/// The times of the first camera's views, which are also those of all others.
fn times(dataset: &Dataset) -> Vec<f32> {
    let times: Vec<f32> = dataset.views[..dataset.n_frames]
        .iter()
        .map(|view| view.time)
        .collect();
    for view in &dataset.views {
        let first = times[view.frame];
        assert_eq!(view.time.to_bits(), first.to_bits(), "{}", view.name);
    }
    times
}

/// Bit for bit.
#[track_caller]
fn assert_even(dataset: &Dataset, n_frames: usize) {
    assert_eq!(dataset.n_frames, n_frames);
    let last = (n_frames - 1) as f64;
    for (frame, time) in times(dataset).into_iter().enumerate() {
        let expected = (frame as f64 / last) as f32;
        assert_eq!(time.to_bits(), expected.to_bits(), "frame {frame}");
    }
}

#[track_caller]
fn assert_times(dataset: &Dataset, ticks: &[f32]) {
    let times = times(dataset);
    assert_eq!(times.len(), ticks.len());
    for (time, tick) in times.iter().zip(ticks) {
        let expected = (tick - ticks[0]) / (ticks[ticks.len() - 1] - ticks[0]);
        assert!((time - expected).abs() < ROUNDING, "{times:?} of {ticks:?}");
    }
}

#[test]
fn the_rate_of_frames_is_that_of_the_stamps() {
    let fixture = rig(&[at_30(0..7), at_30(0..7)]);
    let rate = |options: &LoadOptions| {
        let dataset = fixture.load_with(options).expect("loads");
        (dataset.frame_rate, dataset.frame_rate_of(4))
    };
    let every = |frame_stride: usize, max_frames: usize| LoadOptions {
        frame_stride,
        max_frames: Some(max_frames),
        ..LoadOptions::default()
    };
    let near = |(found, of_four): (Option<f64>, Option<f64>), wanted: [f64; 2]| {
        let found = [found.expect("known"), of_four.expect("known")];
        let is_near = |(a, b): (f64, f64)| (a / b - 1.0).abs() < 1e-4;
        assert!(found.into_iter().zip(wanted).all(is_near), "{found:?}");
    };
    near(rate(&LoadOptions::default()), [30.0, 15.0]);
    near(rate(&every(2, 4)), [15.0, 15.0]);
    assert_eq!(rate(&every(1, 1)), (None, None));
}

#[test]
fn frames_that_are_not_evenly_spaced_have_the_times_of_their_stamps() {
    let ticks = [0, 20, 60, 80, 220, 300, 320, 460, 480];
    let clip = |start: u32| -> Vec<Stamped> {
        let stamped = |(instant, tick): (usize, &u32)| (start + tick, instant);
        ticks.iter().enumerate().map(stamped).collect()
    };
    // Stamps count from the first frame, wherever that is.
    let fixture = rig(&[clip(0), clip(840)]);
    let ticks = ticks.map(|tick| tick as f32);
    for on_demand in [false, true] {
        let options = LoadOptions {
            on_demand,
            ..LoadOptions::default()
        };
        let dataset = fixture.load_with(&options).expect("loads");
        assert_times(&dataset, &ticks);
        assert_eq!(shown(&dataset), [all_but(9, &[]), all_but(9, &[])]);
    }
    let part = LoadOptions {
        frames: Some("2-5".parse().expect("a range")),
        ..LoadOptions::default()
    };
    let dataset = fixture.load_with(&part).expect("loads");
    assert_times(&dataset, &ticks[2..6]);
    let own = [(0, 2), (1, 3), (2, 4), (3, 5)];
    assert_eq!(shown(&dataset), [own.to_vec(), own.to_vec()]);
}

#[test]
fn evenly_spaced_frames_have_the_times_of_their_numbers() {
    const N: usize = 23;
    for rate in ["24", "25", "30000/1001", "30", "60000/1001"] {
        let fixture = posed(2);
        write_video_at(&fixture, "cam00.mp4", 0..N, rate, "PTS");
        for (start, extension) in [("0", "mp4"), ("1.4", "mp4"), ("0.7", "mkv")] {
            let other = format!("cam01.{extension}");
            let options = ["-output_ts_offset", start];
            copy(&fixture, "cam00.mp4", &other, &[], &options);
            let dataset = fixture.load().expect("loads");
            assert_even(&dataset, N);
            assert_eq!(shown(&dataset), [all_but(N, &[]), all_but(N, &[])]);
            fixture.remove(&other);
        }
    }
}

/// Between key frames: the file keeps earlier ones, which its edit list says are not shown.
#[test]
fn a_trimmed_video_has_the_times_of_its_numbers() {
    let whole = at_30(0..23);
    let fixture = rig(&[whole.clone(), whole]);
    for name in ["cam00.mp4", "cam01.mp4"] {
        std::fs::rename(fixture.path(name), fixture.path("whole.mp4")).expect("written");
        copy(&fixture, "whole.mp4", name, &["-ss", "0.22"], &[]);
    }
    fixture.remove("whole.mp4");
    let dataset = fixture.load().expect("loads");
    assert!(dataset.n_frames < 20, "{}", dataset.n_frames);
    assert_even(&dataset, dataset.n_frames);
    let shown = shown(&dataset);
    assert_eq!(shown[0], shown[1]);
    let first = shown[0][0].1;
    assert!(first > 3, "{shown:?}");
    let in_order = (0..dataset.n_frames).map(|frame| (frame, first + frame));
    assert!(shown[0].iter().copied().eq(in_order), "{shown:?}");
}

#[test]
fn a_lost_frame_moves_no_other() {
    const N: usize = 23;
    let whole = || at_30(0..N);
    let lost = || at_30((0..=N).filter(|instant| *instant != 5));
    let fixture = rig(&[whole(), lost(), whole()]);
    fixture.refuses(&[
        "cam01.mp4",
        "frame 5 at 0.167 s",
        "as cam00 has",
        "0.200 s",
        "--skip-broken",
        "dash prepare",
    ]);
    let dataset = fixture.load_with(&skipping()).expect("loads");
    assert_even(&dataset, N);
    let all = all_but(N, &[]);
    assert_eq!(
        shown(&dataset),
        [all.clone(), all_but(N, &[5]), all.clone()]
    );
    let (_, broken) = load_decodable(fixture.root(), &LoadOptions::default()).expect("loads");
    let told: Vec<String> = broken.iter().map(Error::to_string).collect();
    assert!(told.len() == 1 && told[0].contains("cam01.mp4"), "{told:?}");

    // Most cameras say which frames there are.
    write_stamped(&fixture, "cam00.mp4", &lost());
    write_stamped(&fixture, "cam01.mp4", &whole());
    fixture.refuses(&["cam00.mp4", "as cam01 has"]);
    let dataset = fixture.load_with(&skipping()).expect("loads");
    assert_eq!(dataset.n_frames, N);
    assert_eq!(shown(&dataset), [all_but(N, &[5]), all.clone(), all]);
}

#[test]
fn another_rate_is_refused_and_can_be_mended() {
    const N: usize = 23;
    let twice = || -> Vec<Stamped> {
        (0..N)
            .map(|instant| (10 * instant as u32, instant))
            .collect()
    };
    let whole = || at_30(0..N);
    let all = all_but(N, &[]);
    for odd in [1, 0] {
        let mut videos = [whole(), whole(), whole()];
        videos[odd] = twice();
        let fixture = rig(&videos);
        let name = format!("cam{odd:02}.mp4");
        fixture.refuses(&[
            name.as_str(),
            "30 frames per second",
            &format!("as cam{:02} has", 1 - odd),
            "found 60",
            "dash prepare",
            "-itsscale 2 ",
        ]);
        let dataset = fixture.load_with(&skipping()).expect("the others");
        let mut expected = vec![all.clone(); 3];
        expected[odd].clear();
        assert_eq!(shown(&dataset), expected);

        std::fs::rename(fixture.path(&name), fixture.path("old.mp4")).expect("written");
        copy(&fixture, "old.mp4", &name, &["-itsscale", "2"], &[]);
        fixture.remove("old.mp4");
        let dataset = fixture.load().expect("mended");
        assert_even(&dataset, N);
        assert_eq!(shown(&dataset), [all.clone(), all.clone(), all.clone()]);
    }
}

/// Frames half-way between those of the others belong to neither.
#[test]
fn a_video_whose_frames_fit_no_others_is_refused() {
    let fits = || at_30(0..12);
    let mut odd = fits();
    for (stamp, _) in &mut odd[6..] {
        *stamp += 11;
    }
    let fixture = rig(&[fits(), odd, fits()]);
    let message = fixture.refuses(&["cam01.mp4", "frame 6 at 0.200 s", "0.218 s", "dash prepare"]);
    assert!(!message.contains("frames per second"), "{message}");
    let dataset = fixture.load_with(&skipping()).expect("the others");
    let all = all_but(12, &[]);
    assert_eq!(shown(&dataset), [all.clone(), Vec::new(), all]);
}
