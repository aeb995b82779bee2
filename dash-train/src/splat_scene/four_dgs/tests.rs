//! Clips against the scene that they were made of.

use std::path::Path;

use burn::tensor::Device;
use dash_model::{DynamicScene, GaussianRows, TimeWindows};
use glam::DVec3;
use rand::{Rng, SeedableRng};

use super::{ClipOptions, Motions, Written, fit, write_clip};
use crate::splat_scene::{SplatClip, at_rest};

const N_FRAMES: usize = 23;

/// So many Gaussians on curves, with sizes and rotations that change.
fn frames(n: usize) -> Vec<GaussianRows> {
    let frame = |frame: usize| {
        let t = frame as f32 / (N_FRAMES - 1) as f32;
        let path = |k: usize| {
            let k = k as f32;
            [
                (3.0 * t + k).sin(),
                k * 0.1,
                if t < 0.5 { t } else { 1.0 - t },
            ]
        };
        let points: Vec<[f32; 3]> = (0..n).map(path).collect();
        let mut rows = GaussianRows::from_points(&points, &vec![[0.5; 3]; n], 1, 0.1);
        rows.quats = vec![[t.cos(), 0.0, t.sin(), 0.0]; n];
        rows.log_scales = vec![[-2.0 + 0.5 * t, -3.0, -2.5]; n];
        // The last one rests.
        rows.means[n - 1] = [1.0, 2.0, 3.0];
        rows.quats[n - 1] = [0.5, 0.5, -0.5, 0.5];
        rows.log_scales[n - 1] = [-1.0; 3];
        rows
    };
    (0..N_FRAMES).map(frame).collect()
}

#[test]
fn pieces_cover_every_frame_once_and_stay_within_the_error() {
    let frames = frames(5);
    for max_error in [1e-1, 1e-2, 1e-3, 1e-9] {
        let pieces = fit(&frames, max_error);
        for row in 0..5 {
            let own: Vec<_> = pieces.iter().filter(|piece| piece.row == row).collect();
            let covered: Vec<usize> = own.iter().flat_map(|piece| piece.frames.clone()).collect();
            assert_eq!(covered, (0..N_FRAMES).collect::<Vec<_>>());
            for piece in &own {
                for frame in piece.frames.clone() {
                    let exact = DVec3::from(frames[frame].means[row].map(f64::from));
                    let off = piece.mean_at(frame as f64).distance(exact);
                    assert!(off <= max_error.max(1e-6), "{row} {frame}: {off}");
                }
            }
        }
        // What rests has one window, whatever the error.
        assert_eq!(pieces.iter().filter(|piece| piece.row == 4).count(), 1);
    }
    let count = |max_error| fit(&frames, max_error).len();
    assert!(count(1e-1) < count(1e-2) && count(1e-2) < count(1e-3));
    assert_eq!(count(1e-9), 4 * N_FRAMES + 1);
}

#[test]
fn opposite_quaternions_are_one_rotation() {
    let mut frames = frames(2);
    for (frame, rows) in frames.iter_mut().enumerate() {
        *rows = rows.gather(&[1]);
        if frame % 2 == 1 {
            rows.quats[0] = rows.quats[0].map(|value| -value);
        }
    }
    assert_eq!(fit(&frames, 1e-6).len(), 1);
}

#[test]
fn a_colour_that_changes_is_cut() {
    let mut frames = frames(2);
    for (frame, rows) in frames.iter_mut().enumerate() {
        *rows = rows.gather(&[1]);
        rows.opacity_logits[0] = if frame < 12 { -4.0 } else { 2.0 };
    }
    let pieces = fit(&frames, 1.0);
    assert!(pieces.len() > 1);
    for piece in pieces {
        let exact = frames[piece.frames.start].opacity_logits[0];
        assert!((piece.opacity_logit - exact).abs() < 0.02);
    }
}

fn write_one(
    path: &Path,
    scene: &DynamicScene,
    options: &ClipOptions,
) -> Result<Written, crate::Error> {
    write_clip(path, &TimeWindows::whole(), &|_| Ok(scene.clone()), options)
}

/// Of windows of time the file has each Gaussian while its window is shown, and one of two neighbours once.
#[test]
fn windows_follow_each_other() {
    let device = Device::flex();
    let scene = |places: &[f32], degree: usize| {
        let points: Vec<[f32; 3]> = places.iter().map(|&x| [x, 0.5 * x, 0.0]).collect();
        let mut rows = GaussianRows::from_points(&points, &vec![[0.5; 3]; points.len()], 0, 0.1);
        rows.log_scales = vec![[-2.0; 3]; points.len()];
        at_rest(
            &rows.with_sh_degree(degree),
            0.2 + f64::from(places[0]),
            &device,
        )
    };
    let scenes = [
        scene(&[0.0, 1.0, 2.0], 0),
        scene(&[1.0, 2.0, 3.0], 1),
        scene(&[2.0, 0.0, 4.0, 5.0], 0),
    ];
    // Frames 0 to 4, 3 to 7 and 6 to 10: the middles of what two show are frames 3.5 and 6.5.
    let windows = TimeWindows::new(vec![[0.0, 0.4], [0.3, 0.7], [0.6, 1.0]]);
    let options = ClipOptions {
        n_frames: 11,
        frame_rate: 10.0,
        max_error: 1e-3,
    };
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("a.4dgs");
    let of = |number: usize| Ok(scenes[number].clone());
    let written = write_clip(&path, &windows, &of, &options).expect("written");
    assert_eq!(written.n_static, 3 + 1 + 3);
    let motions = Motions::read(&path).expect("read");
    assert_eq!(motions.n_stored(), written.n_static);
    for frame in 0..11 {
        let rows = motions.rows_at(frame as f32 / 10.0);
        let mut found: Vec<f32> = rows.means.iter().map(|mean| mean[0].round()).collect();
        found.sort_by(f32::total_cmp);
        let expected: &[f32] = match frame {
            0..=3 => &[0.0, 1.0, 2.0],
            4..=6 => &[1.0, 2.0, 3.0],
            _ => &[0.0, 2.0, 4.0, 5.0],
        };
        assert_eq!(found, expected, "frame {frame}");
        assert_eq!(rows.sh_degree(), 1);
    }
    // The nearest of all near planes.
    let near_plane = motions.scene_at(0.0, &device).settings.near_plane;
    assert!((near_plane - 0.2).abs() < 1e-6, "{near_plane}");
}

/// A file of many static Gaussians is the scene, but for what its format rounds.
#[test]
fn a_static_scene_comes_back() {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
    let n = 3000;
    let points: Vec<[f32; 3]> = (0..n)
        .map(|_| std::array::from_fn(|_| rng.random_range(-4.0..4.0)))
        .collect();
    let colors: Vec<[f32; 3]> = (0..n)
        .map(|_| std::array::from_fn(|_| rng.random_range(0.0..1.0)))
        .collect();
    let mut rows = GaussianRows::from_points(&points, &colors, 2, 0.1);
    for value in &mut rows.sh_rest {
        *value = rng.random_range(-0.5..0.5);
    }
    let device = Device::flex();
    let scene = at_rest(&rows, 0.37, &device);
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("a.4dgs");
    let options = ClipOptions {
        n_frames: 12,
        frame_rate: 24.0,
        max_error: 1e-3,
    };
    let written = write_one(&path, &scene, &options).expect("written");
    assert_eq!((written.n_static, written.n_pieces), (n, 0));
    let motions = Motions::read(&path).expect("read");
    assert_eq!((motions.n_frames(), motions.n_stored()), (12, n));
    let clip = SplatClip::open(&path, &device).expect("read");
    assert_eq!((clip.n_frames(), clip.frame_rate()), (12, Some(24.0)));
    for time in [0.0, 0.31, 1.0] {
        let back = clip.scene_at(time).expect("a scene");
        assert!((back.settings.near_plane - 0.37).abs() < 1e-12);
        let back = back.static_set.to_rows();
        assert_eq!((back.len(), back.sh_degree()), (n, 2));
        // The file has an order of its own.
        let tree: kiddo::ImmutableKdTree<f32, 3> =
            kiddo::ImmutableKdTree::new_from_slice(&back.means);
        for row in 0..n {
            let found = tree.nearest_one::<kiddo::SquaredEuclidean>(&rows.means[row]);
            let at = found.item as usize;
            assert!(found.distance.sqrt() < 0.02);
            let near = |a: &[f32], b: &[f32], most: f32| {
                a.iter().zip(b).all(|(a, b)| (a - b).abs() <= most)
            };
            assert!(near(&back.sh_dc[at], &rows.sh_dc[row], 0.01));
            assert!(near(&back.log_scales[at], &rows.log_scales[row], 0.01));
            let width = rows.sh_rest_width;
            let of =
                |rows: &GaussianRows, row: usize| rows.sh_rest[row * width..][..width].to_vec();
            assert!(near(&of(&back, at), &of(&rows, row), 0.017));
        }
    }
    // Where nothing is drawn over black, the background is what was asked for.
    let mut clip = clip;
    clip.set_background([0.2, 0.4, 0.6]);
    let shown = clip.frame(3).expect("a scene");
    assert_eq!(shown.settings.background, [0.2, 0.4, 0.6]);
}

#[test]
fn what_is_no_clip_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let rows = GaussianRows::from_points(&[[0.0; 3], [1.0; 3]], &[[0.5; 3]; 2], 0, 0.1);
    let scene = at_rest(&rows, 0.2, &Device::flex());
    let whole = folder.path().join("whole.4dgs");
    let options = ClipOptions {
        n_frames: 2,
        frame_rate: 30.0,
        max_error: 1e-3,
    };
    write_one(&whole, &scene, &options).expect("written");
    let bytes = std::fs::read(&whole).expect("a file");
    let path = folder.path().join("a.4dgs");
    for bad in [
        &b""[..],
        b"ply\n",
        &bytes[..bytes.len() / 2],
        &bytes[..bytes.len() - 1],
    ] {
        std::fs::write(&path, bad).expect("writable");
        let error = Motions::read(&path).expect_err("refused").to_string();
        assert!(error.contains("a.4dgs"), "{error}");
    }
}

/// Rounding to single precision does not make a file that its own writer refuses.
#[test]
fn gaussians_far_from_the_origin_are_written() {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(4);
    let points: Vec<[f32; 3]> = (0..4000)
        .map(|_| std::array::from_fn(|_| 300.0 + rng.random_range(-4.0..4.0)))
        .collect();
    let rows = GaussianRows::from_points(&points, &vec![[0.5; 3]; 4000], 0, 0.1);
    let scene = at_rest(&rows, 0.2, &Device::flex());
    let folder = tempfile::tempdir().expect("a scratch folder");
    let options = ClipOptions {
        n_frames: 1,
        frame_rate: 30.0,
        max_error: 1e-3,
    };
    let path = folder.path().join("a.4dgs");
    write_one(&path, &scene, &options).expect("written");
    let back = Motions::read(&path).expect("read").rows_at(0.0);
    assert_eq!(back.len(), 4000);
}
