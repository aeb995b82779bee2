use super::clip::thinned;
use super::*;

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
        data: DataConfig {
            dataset: "made".into(),
            layout: None,
            downscale: 1.0,
            test_cameras: None,
            drop_cameras: Vec::new(),
            frames: Some(FrameRange::All),
            invert_masks: false,
            skip_broken: false,
            device: "flex".into(),
        },
        train: TrainConfig::preset(crate::train::Preset::Quick),
    }
}

#[test]
fn one_window_fades_into_the_next() {
    let windows = windows();
    let at = |frame: f32| windows.shares(frame / 8.0);
    assert_eq!(at(0.0), [(0, 1.0)]);
    assert_eq!(at(1.5), [(0, 1.0)]);
    assert_eq!(at(3.0), [(0, 0.5), (1, 0.5)]);
    assert_eq!(at(4.0), [(1, 1.0)]);
    assert_eq!(at(5.25), [(1, 0.75), (2, 0.25)]);
    assert_eq!(at(8.0), [(2, 1.0)]);
    let mut before = 0.0;
    for step in 0..=800 {
        let shares = at(step as f32 / 100.0);
        let sum: f32 = shares.iter().map(|(_, share)| share).sum();
        assert!((sum - 1.0).abs() < 1e-6, "{shares:?}");
        let middle: f32 = shares.iter().map(|(k, share)| *k as f32 * share).sum();
        assert!((0.0..0.02).contains(&(middle - before)), "a jump at {step}");
        before = middle;
    }
    assert_eq!(windows.windows[1].local(0.25), 0.0);
    assert_eq!(windows.windows[1].local(0.5), 0.5);
}

#[test]
fn two_thin_layers_let_through_what_one_does() {
    let through = |logit: f32| 1.0 / (1.0 + f64::from(logit).exp());
    for logit in [-6.0, -1.0, 0.0, 2.5, 9.0] {
        for share in [0.1, 0.5, 0.83] {
            let both = through(thinned(logit, share)) * through(thinned(logit, 1.0 - share));
            assert!(
                (both / through(logit) - 1.0).abs() < 1e-3,
                "{logit} {share}: {both}"
            );
        }
    }
    assert!(thinned(40.0, 0.5).is_finite());
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
        Windows::new(&dataset, data, train, [length, overlap])
    };
    let found = of(5, 2).expect("sound");
    assert_eq!((found.n_frames, found.windows.len()), (9, 3));
    assert_eq!((found.windows[2].from, found.windows[2].to), (0.5, 1.0));
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
