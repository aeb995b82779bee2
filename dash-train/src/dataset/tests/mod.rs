//! Readers on fixtures that the tests write themselves, and on real captures where they are present.

mod blender;
mod colmap;
mod colmap_exports;
mod damaged_videos;
mod folders;
mod frame_numbers;
mod keys;
mod listed;
mod llff;
mod masks;
mod mistakes;
mod multipleview;
mod n3dv;
mod nerfies;
mod panoptic;
mod partition;
mod paths;
mod real;
mod rig;
mod sizes;
mod technicolor;
mod video_times;
mod videos;

use std::fs;
use std::path::Path;

use super::{Dataset, LoadOptions, load};
use crate::Error;
use crate::test_kit::{Fixture, H, W, camera, npy_f64};

impl Fixture {
    fn load(&self) -> Result<Dataset, Error> {
        self.load_with(&LoadOptions::default())
    }

    fn load_with(&self, options: &LoadOptions) -> Result<Dataset, Error> {
        load(self.root(), options)
    }

    /// The message with which loading fails; every word must be in it.
    #[track_caller]
    fn refuses(&self, words: &[&str]) -> String {
        let message = self.load().expect_err("must not load").to_string();
        for word in words {
            assert!(message.contains(word), "`{word}` is not in: {message}");
        }
        message
    }

    /// Loads with a file cut at every `step`-th byte: it must fail, naming the file, or, where a
    /// cut leaves a valid file, load.
    #[track_caller]
    fn survives_truncation(&self, name: &str, step: usize) {
        let bytes = fs::read(self.root().join(name)).expect("fixture file");
        let mut failures = 0;
        let cuts = (0..bytes.len()).step_by(step);
        let n_cuts = cuts.len();
        for end in cuts {
            self.write(name, &bytes[..end]);
            if let Err(error) = self.load() {
                let message = error.to_string();
                let file = Path::new(name)
                    .file_name()
                    .expect("a file")
                    .to_string_lossy();
                assert!(message.contains(&*file), "cut at {end}: {message}");
                failures += 1;
            }
        }
        self.write(name, &bytes);
        assert!(
            failures * 10 >= n_cuts * 9,
            "only {failures} of {n_cuts} cuts were noticed"
        );
        self.load().expect("whole again");
    }
}

/// Loads each fixture with bytes of one of its files changed at random: nothing may panic or hang.
#[test]
fn damaged_files_of_every_layout_never_panic() {
    use rand::{Rng, SeedableRng};
    let mut random = rand_pcg::Pcg32::seed_from_u64(11);
    for (fixture, names) in [
        (
            technicolor::raw("Rugby", 3, 1..2),
            &["cameras_parameters.txt"][..],
        ),
        (
            nerfies::capture(),
            &[
                "dataset.json",
                "metadata.json",
                "scene.json",
                "points.npy",
                "camera/000000.json",
            ],
        ),
        (rig::with_transforms(), &["transforms.json"]),
        (
            rig::with_model(),
            &["sparse/0/cameras.txt", "sparse/0/images.txt"],
        ),
        (llff::capture(3), &["poses_bounds.npy"]),
    ] {
        for name in names {
            let whole = fs::read(fixture.root().join(name)).expect("fixture file");
            for _ in 0..200 {
                let mut bytes = whole.clone();
                for _ in 0..random.random_range(1..4) {
                    let at = random.random_range(0..bytes.len());
                    // Digits and signs keep text parsable, so that values are tried too.
                    bytes[at] = match random.random_range(0..3) {
                        0 => random.random(),
                        1 => b"0123456789-e."[random.random_range(0..13)],
                        _ => whole[random.random_range(0..whole.len())],
                    };
                }
                fixture.write(name, &bytes);
                let skip_broken = random.random();
                drop(fixture.load_with(&LoadOptions {
                    skip_broken,
                    ..LoadOptions::default()
                }));
            }
            fixture.write(name, &whole);
            fixture.load().expect("whole again");
        }
    }
}

#[test]
fn options_out_of_range_are_refused() {
    let fixture = Fixture::new();
    let default = LoadOptions::default;
    for (options, word) in [
        (
            LoadOptions {
                downscale: 0.5,
                ..default()
            },
            "--downscale",
        ),
        (
            LoadOptions {
                downscale: f64::NAN,
                ..default()
            },
            "--downscale",
        ),
        (
            LoadOptions {
                frame_stride: 0,
                ..default()
            },
            "stride",
        ),
        (
            LoadOptions {
                max_frames: Some(0),
                ..default()
            },
            "frames",
        ),
        (
            LoadOptions {
                threads: Some(0),
                ..default()
            },
            "--threads",
        ),
    ] {
        let message = fixture.load_with(&options).expect_err(word).to_string();
        assert!(message.contains(word), "{message}");
    }
}

#[test]
fn layouts_have_one_name_everywhere() {
    use super::Layout;
    use clap::ValueEnum;
    for layout in Layout::value_variants() {
        let name = layout.to_string();
        assert_eq!(name.parse::<Layout>().expect("its own name"), *layout);
        assert_eq!(
            layout.to_possible_value().expect("not hidden").get_name(),
            name
        );
        assert_eq!(
            serde_json::to_string(layout).expect("serialises"),
            format!("\"{name}\"")
        );
    }
    assert!(
        "llff"
            .parse::<Layout>()
            .expect_err("unknown")
            .to_string()
            .contains("`llff`")
    );
}

/// Files with a few bytes changed at random load or fail, and never panic, hang or allocate much.
#[test]
fn damaged_bytes_never_panic() {
    use rand::{Rng, SeedableRng};
    let fixture = Fixture::new();
    fixture.image("a.png", W, H, [9; 3]);
    fixture.image("a.jpg", W, H, [9; 3]);
    let cloud = crate::ply::PointCloud {
        positions: vec![[1.0; 3]; 3],
        colors: vec![[1; 3]; 3],
    };
    crate::ply::write_points(&fixture.path("binary.ply"), &cloud).expect("writes");
    let header = "element vertex 2\nproperty float x\nproperty list uchar int l\nproperty double y\n\
                  property float z\nend_header\n";
    fixture.write(
        "ascii.ply",
        format!("ply\nformat ascii 1.0\n{header}1 2 7 7 2 3\n4 0 5 6\n"),
    );
    fixture.write("poses.npy", npy_f64(&[[0.25; 17]; 2]));
    let mut random = rand_pcg::Pcg32::seed_from_u64(7);
    for name in ["a.png", "a.jpg", "binary.ply", "ascii.ply", "poses.npy"] {
        let path = fixture.path(name);
        let whole = fs::read(&path).expect("fixture file");
        for _ in 0..1500 {
            let mut bytes = whole.clone();
            for _ in 0..random.random_range(1..5) {
                let at = random.random_range(0..bytes.len());
                bytes[at] = random.random();
            }
            fs::write(&path, &bytes).expect("fixture file");
            match name.rsplit('.').next() {
                Some("ply") => drop(crate::ply::read_points_counting(&path)),
                Some("npy") => drop(super::poses::npy::parse_poses(&path, &bytes)),
                _ => drop(super::pixels::decode::decode(&path)),
            }
        }
    }
}

#[test]
fn views_can_be_made_without_a_folder() {
    let mut view = super::View::from_rgb8("made", camera(0), 0.5, vec![51; W * H * 3]);
    view.partition = super::Partition::Test;
    assert_eq!(view.rgb([1.0; 3]).expect("in memory"), vec![0.2; W * H * 3]);
    assert!(
        view.alpha().expect("in memory").is_none()
            && view.motion_mask().expect("reads").is_none()
            && view.partition.to_string() == "test"
    );
}

const POINTER: &str = "version https://git-lfs.github.com/spec/v1\noid sha256:0a\nsize 17\n";

#[test]
fn pointers_in_place_of_images_videos_arrays_and_points_are_told() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("pointer");
    std::fs::write(&path, POINTER).expect("writes");
    let bytes = POINTER.as_bytes();
    for error in [
        super::pixels::decode::dimensions(&path).expect_err("no image"),
        super::pixels::decode::decode(&path).expect_err("no image"),
        crate::video::frame_size(&path, false).expect_err("no video"),
        crate::video::VideoIndex::read(&path, true).expect_err("no video"),
        super::poses::npy::parse_poses(&path, bytes).expect_err("no array"),
        crate::ply::read_points(&path).expect_err("no points"),
    ] {
        let message = error.to_string();
        let expected = "found a Git LFS pointer, not the file itself; run `git lfs pull`";
        assert!(message.contains(expected), "{message}");
    }
}
