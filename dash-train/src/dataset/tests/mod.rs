//! Readers on fixtures that the tests write themselves, and on real captures where they are present.

mod blender;
mod colmap;
mod damaged_videos;
mod folders;
mod frame_numbers;
mod listed;
mod llff;
mod masks;
mod n3dv;
mod nerfies;
mod partition;
mod real;
mod rig;
mod sizes;
mod technicolor;
mod video_times;

use std::fs;
use std::path::{Path, PathBuf};

use dash_kernels::Camera;
use tempfile::TempDir;

use super::{Dataset, DatasetError, LoadOptions, load};

/// Size of the fixtures' images.
const W: usize = 8;
const H: usize = 6;

/// A folder that is removed at the end of the test.
struct Fixture(TempDir);

impl Fixture {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("temporary folder"))
    }

    fn root(&self) -> &Path {
        self.0.path()
    }

    fn path(&self, name: &str) -> PathBuf {
        let path = self.root().join(name);
        fs::create_dir_all(path.parent().expect("below the root")).expect("folders");
        path
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        fs::write(self.path(name), bytes).expect("fixture file");
    }

    fn remove(&self, name: &str) {
        fs::remove_file(self.root().join(name)).expect("fixture file");
    }

    /// An RGB image of one shade.
    fn image(&self, name: &str, width: usize, height: usize, shade: [u8; 3]) {
        image::RgbImage::from_pixel(width as u32, height as u32, image::Rgb(shade))
            .save(self.path(name))
            .expect("fixture image");
    }

    fn load(&self) -> Result<Dataset, DatasetError> {
        self.load_with(&LoadOptions::default())
    }

    fn load_with(&self, options: &LoadOptions) -> Result<Dataset, DatasetError> {
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

#[track_caller]
fn assert_cameras_equal(got: &Camera, expected: &Camera) {
    assert_eq!((got.width, got.height), (expected.width, expected.height));
    let numbers = |c: &Camera| {
        let mut all: Vec<f64> = c.rotation.iter().flatten().copied().collect();
        all.extend(c.translation);
        all.extend([c.fx, c.fy, c.cx, c.cy]);
        all
    };
    for (index, (g, e)) in numbers(got).into_iter().zip(numbers(expected)).enumerate() {
        assert!(
            (g - e).abs() < 1e-9,
            "number {index}: got {g}, expected {e}"
        );
    }
}

/// A camera in general position, looking at the origin.
fn camera(index: usize) -> Camera {
    let angle = 0.7 * index as f64;
    let eye = [
        3.0 * angle.cos(),
        0.5 + 0.2 * index as f64,
        3.0 * angle.sin(),
    ];
    Camera::new(9.0, 9.0, W as f64 / 2.0, H as f64 / 2.0, W, H).look_at(
        eye,
        [0.0; 3],
        [0.0, 1.0, 0.0],
    )
}

/// The rotation as a quaternion (w, x, y, z).
fn quaternion(camera: &Camera) -> [f64; 4] {
    let rows = glam::DMat3::from_cols_array_2d(&camera.rotation);
    let q = glam::DQuat::from_mat3(&rows.transpose());
    [q.w, q.x, q.y, q.z]
}

/// Writes a COLMAP text model of these images and one point.
fn write_model(fixture: &Fixture, folder: &str, images: &[(&str, Camera)]) {
    let (mut cameras, mut poses) = (String::from("# Cameras\n"), String::from("# Images\n"));
    for (index, (name, camera)) in images.iter().enumerate() {
        let id = index + 1;
        let Camera {
            fx,
            fy,
            cx,
            cy,
            width,
            height,
            ..
        } = camera;
        cameras += &format!("{id} PINHOLE {width} {height} {fx} {fy} {cx} {cy}\n");
        let numbers = quaternion(camera).into_iter().chain(camera.translation);
        let pose: Vec<String> = numbers.map(|v| v.to_string()).collect();
        poses += &format!("{id} {} {id} {name}\n\n", pose.join(" "));
    }
    fixture.write(&format!("{folder}/cameras.txt"), cameras);
    fixture.write(&format!("{folder}/images.txt"), poses);
    fixture.write(&format!("{folder}/points3D.txt"), "1 1 2 3 4 5 6 0.5\n");
}

/// The camera's axis (right, down, forward: 0, 1, 2) in the world.
fn axis(camera: &Camera, index: usize) -> [f64; 3] {
    camera.rotation[index]
}

fn negated(v: [f64; 3]) -> [f64; 3] {
    v.map(|c| -c)
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
    fixture.write("poses.npy", super::npy::tests::npy_f64(&[[0.25; 17]; 2]));
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
                Some("npy") => drop(super::npy::parse_poses(&path, &bytes)),
                _ => drop(super::decode::decode(&path)),
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
