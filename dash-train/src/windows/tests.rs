use super::*;
use crate::dataset::View;
use crate::synth;
use crate::train::Preset;

#[test]
fn windows_cover_every_frame_and_share_enough_of_them() {
    for (n, length, overlap) in [
        (9, 5, 2),
        (10, 9, 4),
        (300, 60, 8),
        (1200, 60, 8),
        (61, 60, 1),
        (7, 4, 1),
    ] {
        let windows = divide(n, length, overlap);
        assert_eq!((windows[0].0, windows[windows.len() - 1].1), (0, n - 1));
        for pair in windows.windows(2) {
            let shared = pair[0].1 + 1 - pair[1].0;
            assert!(shared >= overlap && pair[0].0 < pair[1].0, "{n}: {pair:?}");
        }
        // No more of them than it takes.
        let most = n.div_ceil(length - overlap) + 1;
        assert!(windows.len() <= most, "{n}: {}", windows.len());
    }
}

fn windows() -> Windows {
    let window = |first: usize, last: usize| Window {
        first,
        last,
        from: first as f32 / 8.0,
        to: last as f32 / 8.0,
    };
    Windows {
        name: "made".into(),
        n_frames: 9,
        windows: vec![window(0, 4), window(2, 6), window(5, 8)],
        room: None,
        data: DataConfig {
            dataset: "made".into(),
            layout: None,
            downscale: 1.0,
            test_cameras: None,
            drop_cameras: Vec::new(),
            frames: Some(FrameRange::All),
            invert_masks: false,
            skip_broken: false,
            backdrop: None,
            device: "flex".into(),
        },
        train: TrainConfig::preset(Preset::Quick),
    }
}

#[test]
fn long_clips_of_rigs_are_cut_and_windows_share_their_steps() {
    let mut dataset = synth::loaded(6, 9, [32, 24]);
    let plan = |dataset: &Dataset, set: &[&str]| {
        let mut train = TrainConfig::preset(Preset::Quick);
        train.visits = Some(2).filter(|_| set.is_empty());
        set.iter()
            .for_each(|key| train.set(key).expect("a known key"));
        let windows = Windows::new(dataset, windows().data, train, [5, 2], None);
        let windows = windows.expect("nine frames are enough");
        (windows.windows.len(), windows.train.iterations)
    };
    assert_eq!(plan(&dataset, &[]), (3, 2_000));
    assert_eq!(plan(&dataset, &["iterations=40"]), (3, 40));
    assert!(!Windows::suit(&dataset));
    dataset.n_frames = 301;
    assert!(Windows::suit(&dataset));
    let whole = dataset.clone();
    dataset
        .views
        .retain(|view| view.partition == Partition::Train);
    assert!(!Windows::suit(&dataset), "nothing to score them by");
    let mut dataset = whole;
    let is_first = |view: &View| view.camera_index == view.frame % 6;
    dataset.views.retain(is_first);
    assert!(!Windows::suit(&dataset), "one camera at a time");
}

#[test]
fn windows_survive_their_file() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let windows = windows();
    assert!(!Windows::are_in(folder.path()));
    windows.claim(folder.path()).expect("empty");
    assert!(Windows::are_in(folder.path()));
    assert_eq!(Windows::read(folder.path()).expect("whole"), windows);
    let mut others = windows.clone();
    others.windows.pop();
    assert!(others.claim(folder.path()).is_err());
    let path = folder.path().join(FILE);
    let text = std::fs::read_to_string(&path).expect("written");
    std::fs::write(&path, text.replace("last = 8", "last = 9")).expect("writable");
    assert!(Windows::read(folder.path()).is_err());
}

#[test]
fn clips_that_need_no_windows_have_none() {
    let dataset = crate::synth::loaded(3, 9, [16, 16]);
    let of = |length: usize, overlap: usize| {
        let Windows { data, train, .. } = windows();
        Windows::new(&dataset, data, train, [length, overlap], Some(true))
    };
    let found = of(5, 2).expect("sound");
    assert_eq!((found.n_frames, found.windows.len()), (9, 3));
    assert_eq!((found.windows[2].from, found.windows[2].to), (0.5, 1.0));
    let names: Vec<String> = found.runs().map(ClipRun::run_name).collect();
    assert_eq!(names, ["room", "window-000", "window-001", "window-002"]);
    let frames = |run| found.data_of(run, "flex").frames.expect("some").to_string();
    // No more frames than a window has.
    assert_eq!(frames(ClipRun::Room), "all/2");
    assert_eq!(frames(ClipRun::Window(2)), "#4-8");
    for (length, overlap, option) in [
        (9, 2, "--window"),
        (3, 1, "--window"),
        (5, 0, "--overlap"),
        (6, 3, "--overlap"),
    ] {
        let refused = of(length, overlap).expect_err("refused").to_string();
        assert!(refused.contains(option), "{refused}");
    }
}
