//! Videos that are cut off, have flipped bits, or are no videos at all, with and without `skip_broken`.

use std::fs;

use super::super::{Dataset, LoadOptions, load, load_decodable};
use super::n3dv::row;
use super::videos::write_video_with;
use crate::Error;
use crate::test_kit::{Fixture, camera, npy_f64};

/// Frames per video, in groups of four of which the file holds some out of order.
const N: usize = 15;
const GROUP: usize = 4;
const CAMERAS: usize = 3;
const ENCODING: [&str; 12] = [
    "-c:v",
    "mpeg4",
    "-q:v",
    "1",
    "-g",
    "4",
    "-bf",
    "2",
    "-flags",
    "+cgop",
    "-sc_threshold",
    "1000000000",
];

/// Three cameras with a video each.
fn rig() -> Fixture {
    let fixture = Fixture::new();
    let large: Vec<_> = (0..CAMERAS)
        .map(|i| row(&camera(i).resized(64, 48)))
        .collect();
    fixture.write("poses_bounds.npy", npy_f64(&large));
    for camera in 0..CAMERAS {
        write_video_with(
            &fixture,
            &format!("cam{camera:02}.mp4"),
            (0..N).map(|frame| 20 + 10 * camera + 8 * frame),
            &ENCODING,
        );
    }
    fixture
}

fn skipping(on_demand: bool) -> LoadOptions {
    LoadOptions {
        skip_broken: true,
        on_demand,
        threads: Some(2),
        ..LoadOptions::default()
    }
}

/// Where in the file the coded pictures begin; the index is before them.
fn coded_pictures(bytes: &[u8]) -> usize {
    let name = bytes.windows(4).position(|four| four == b"mdat");
    name.expect("an MP4 file") + 4
}

/// Frames of each camera, and that each is as in the undamaged dataset.
fn frames(dataset: &Dataset, whole: &Dataset) -> Vec<Vec<usize>> {
    let mut frames = vec![Vec::new(); CAMERAS];
    for view in &dataset.views {
        frames[view.camera_index].push(view.frame);
        let same = &whole.views[view.camera_index * N + view.frame];
        assert_eq!((&view.name, view.time), (&same.name, same.time));
        let pixels = view.rgb([0.0; 3]).expect("was decoded when it was loaded");
        assert!(
            pixels == same.rgb([0.0; 3]).expect("whole"),
            "{}",
            view.name
        );
    }
    frames
}

fn all() -> Vec<usize> {
    (0..N).collect()
}

/// Without `skip_broken` an error that names the file and the option.
#[track_caller]
fn is_refused(fixture: &Fixture, file: &str) {
    tells_of(&fixture.load().expect_err("damaged"), file);
}

#[track_caller]
fn tells_of(error: &Error, file: &str) {
    let message = error.to_string();
    assert!(
        message.contains(file) && message.contains("--skip-broken"),
        "{message}"
    );
}

#[test]
fn a_video_that_cannot_be_opened_leaves_its_camera_out() {
    let fixture = rig();
    let whole = fixture.load().expect("loads");
    let bytes = fs::read(fixture.path("cam01.mp4")).expect("written");
    for damaged in [b"no video".to_vec(), bytes[..200].to_vec()] {
        fixture.write("cam01.mp4", &damaged);
        is_refused(&fixture, "cam01.mp4");
        for on_demand in [false, true] {
            let dataset = fixture.load_with(&skipping(on_demand)).expect("loads");
            assert_eq!(frames(&dataset, &whole), [all(), Vec::new(), all()]);
        }
        let (_, broken) = load_decodable(fixture.root(), &LoadOptions::default()).expect("loads");
        assert_eq!(broken.len(), 1, "{broken:?}");
        assert!(broken[0].to_string().contains("cam01.mp4"), "{}", broken[0]);
    }
    // The first camera is the held-out one; its numbers stay those of the poses.
    for camera in 0..CAMERAS {
        fixture.write(&format!("cam{camera:02}.mp4"), "no video");
    }
    let error = fixture.load_with(&skipping(false)).expect_err("none left");
    assert!(error.to_string().contains("cam00.mp4"), "{error}");
}

#[test]
fn of_a_video_that_is_cut_off_the_beginning_is_kept() {
    let fixture = rig();
    let whole = fixture.load().expect("loads");
    let bytes = fs::read(fixture.path("cam00.mp4")).expect("written");
    let start = coded_pictures(&bytes);
    let mut lengths = Vec::new();
    for share in [0.0, 0.5, 0.99] {
        let end = start + ((bytes.len() - start) as f64 * share) as usize;
        fixture.write("cam00.mp4", &bytes[..end]);
        is_refused(&fixture, "cam00");
        let kept = |on_demand| {
            let dataset = fixture.load_with(&skipping(on_demand)).expect("loads");
            frames(&dataset, &whole)
        };
        let found = kept(false);
        assert_eq!(found, kept(true));
        assert_eq!(found[1..], [all(), all()]);
        let n = found[0].len();
        assert_eq!(found[0], all()[..n], "{share}");
        lengths.push(n);
    }
    assert!(lengths.is_sorted(), "{lengths:?}");
    assert_eq!(lengths[0], 0);
    assert!((1..N).contains(&lengths[1]), "{lengths:?}");
    assert!(lengths[2] + 4 >= N && lengths[2] < N, "{lengths:?}");
}

#[test]
fn damage_costs_frames_up_to_the_next_key_frame() {
    let fixture = rig();
    let whole = fixture.load().expect("loads");
    let bytes = fs::read(fixture.path("cam02.mp4")).expect("written");
    let start = coded_pictures(&bytes);
    let length = bytes.len() - start;
    let mut n_damaged = 0;
    for eighth in [1, 4, 7] {
        // A few bytes each time, so that the decoder notices.
        let mut damaged = bytes.clone();
        let at = start + length * eighth / 8;
        for (place, byte) in damaged[at..at + 8].iter_mut().enumerate() {
            *byte ^= [0xff, 0x5a, 0x3c][place % 3];
        }
        fixture.write("cam02.mp4", &damaged);
        let Err(error) = fixture.load() else {
            continue;
        };
        n_damaged += 1;
        tells_of(&error, "cam02.mp4");
        let dataset = fixture.load_with(&skipping(false)).expect("loads");
        let found = frames(&dataset, &whole);
        assert_eq!(found[..2], [all(), all()]);
        let lost: Vec<usize> = all()
            .into_iter()
            .filter(|frame| !found[2].contains(frame))
            .collect();
        assert!((1..=2 * GROUP).contains(&lost.len()), "{eighth}: {lost:?}");
        for next in lost.iter().map(|frame| frame + 1) {
            let ends = next.is_multiple_of(GROUP) || next == N;
            assert!(ends || lost.contains(&next), "{eighth}: {lost:?}");
        }

        let on_demand = fixture.load_with(&skipping(true)).expect("loads");
        assert!(on_demand.frame_statistics().is_some());
        assert_eq!(frames(&on_demand, &whole), found);
        let (_, broken) = load_decodable(fixture.root(), &LoadOptions::default()).expect("loads");
        let told: Vec<String> = broken.iter().map(Error::to_string).collect();
        assert_eq!(told.len(), 1, "{told:?}");
        assert!(
            told[0].contains(&format!(
                "frame{} {}",
                if lost.len() == 1 { "" } else { "s" },
                lost[0]
            )),
            "{told:?}"
        );
    }
    assert!(n_damaged >= 2, "only {n_damaged} noticed");
}

/// Nothing but what `load` refuses too: the same file twice gives the same frames.
#[test]
fn flipped_bits_are_an_error_or_give_frames() {
    use rand::{Rng, SeedableRng};
    let fixture = rig();
    let bytes = fs::read(fixture.path("cam01.mp4")).expect("written");
    let mut rng = rand_pcg::Pcg32::seed_from_u64(3);
    for _ in 0..3 {
        let mut damaged = bytes.clone();
        for _ in 0..40 {
            let at = rng.random_range(0..damaged.len());
            damaged[at] ^= 1 << rng.random_range(0..8);
        }
        fixture.write("cam01.mp4", &damaged);
        let names = || {
            let loaded = load(fixture.root(), &skipping(false));
            loaded.map(|dataset| {
                dataset
                    .views
                    .iter()
                    .map(|view| view.name.clone())
                    .collect::<Vec<_>>()
            })
        };
        match (names(), names()) {
            (Ok(first), Ok(second)) => assert_eq!(first, second),
            (Err(first), Err(second)) => assert_eq!(first.to_string(), second.to_string()),
            other => panic!("{other:?}"),
        }
    }
}
