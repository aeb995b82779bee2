//! Two cameras whose recordings are written by `ffmpeg`, and what dash makes of them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use dash_train::Error;
use dash_train::dataset::{Dataset, LoadOptions, load};
use dash_train::prepare::{PrepareConfig, PrepareSummary, prepare};
use dash_train::video::{ffmpeg_program, ffprobe_program};

/// Size of a frame.
pub const W: usize = 48;
pub const H: usize = 32;
/// Frames of a recording.
pub const N: usize = 12;
/// A frame's number in binary, the lowest digit first, as white and black columns.
const DIGITS: usize = 4;

pub const CAMERAS: [&str; 2] = ["cam00", "cam01"];

/// A folder with the recordings `videos/cam00.*` and `videos/cam01.*` and their poses.
pub struct Footage {
    folder: tempfile::TempDir,
}

/// A frame that was read.
pub struct Picture {
    pub width: usize,
    pub height: usize,
    /// `[H, W, 3]` in [0, 1].
    pub rgb: Vec<f32>,
}

impl Picture {
    /// The mean colour of the middle of a cell of a grid of `columns` x `rows`.
    pub fn cell(&self, [columns, rows]: [usize; 2], [column, row]: [usize; 2]) -> [f32; 3] {
        let middle = |place: usize, cells: usize, side: usize| {
            (4 * place + 1) * side / (4 * cells)..(4 * place + 3) * side / (4 * cells)
        };
        let xs = middle(column, columns, self.width);
        let ys = middle(row, rows, self.height);
        let n = (xs.len() * ys.len()) as f32;
        [0, 1, 2].map(|channel| {
            let line = |y: usize| xs.clone().map(move |x| 3 * (y * self.width + x) + channel);
            ys.clone()
                .flat_map(line)
                .map(|at| self.rgb[at])
                .sum::<f32>()
                / n
        })
    }

    /// The number that the columns show.
    pub fn number(&self) -> usize {
        let is_white = |digit: usize| self.cell([DIGITS, 1], [digit, 0])[1] > 0.5;
        (0..DIGITS)
            .map(|digit| usize::from(is_white(digit)) << digit)
            .sum()
    }
}

impl Footage {
    /// A folder whose poses are those of frames of this size.
    pub fn posed([width, height]: [usize; 2]) -> Self {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let footage = Self { folder };
        fs::create_dir(footage.path("videos")).expect("made");
        let frames: Vec<_> = CAMERAS
            .iter()
            .enumerate()
            .map(|(index, name)| {
                let x = index as f64 * 0.5;
                serde_json::json!({
                    "file_path": name, "w": width, "h": height, "fl_x": 50.0, "fl_y": 50.0,
                    "cx": width as f64 / 2.0, "cy": height as f64 / 2.0,
                    "transform_matrix": [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]],
                })
            })
            .collect();
        let poses = serde_json::json!({ "frames": frames }).to_string();
        fs::write(footage.path("transforms.json"), poses).expect("written");
        footage
    }

    pub fn new() -> Self {
        Self::posed([W, H])
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A camera's video.
    pub fn video(&self, camera: &str, extension: &str) -> PathBuf {
        self.path(&format!("videos/{camera}.{extension}"))
    }

    /// Writes raw frames that show their numbers.
    pub fn numbered(&self, n: usize) -> PathBuf {
        let path = self.path("numbered.gray");
        let digit = |x: usize| x * DIGITS / W;
        let row = |frame: usize| (0..W).map(move |x| 255 * (frame >> digit(x) & 1) as u8);
        let bytes: Vec<u8> = (0..n)
            .flat_map(|frame| (0..H).flat_map(move |_| row(frame)))
            .collect();
        fs::write(&path, bytes).expect("written");
        path
    }

    /// Records numbered frames at a rate with both cameras. Lists options for the output.
    pub fn record(&self, rate: &str, extension: &str, output: &[&str]) {
        self.record_one(CAMERAS[0], rate, extension, output);
        let [first, second] = CAMERAS.map(|camera| self.video(camera, extension));
        fs::copy(first, second).expect("copied");
    }

    /// The same with one camera.
    pub fn record_one(&self, camera: &str, rate: &str, extension: &str, output: &[&str]) {
        let input = ["-f", "rawvideo", "-pix_fmt", "gray", "-s", "48x32"];
        let input = [&input[..], &["-framerate", rate]].concat();
        let to = self.video(camera, extension);
        ffmpeg(&input, &self.numbered(N), output, &to);
    }

    /// Records raw RGB frames of [`W`] x [`H`] pixels with both cameras at 30 frames a second.
    pub fn record_rgb(&self, frames: &[Vec<u8>], extension: &str, output: &[&str]) {
        let path = self.path("frames.rgb");
        fs::write(&path, frames.concat()).expect("written");
        let first = self.video(CAMERAS[0], extension);
        ffmpeg(
            &[
                "-f",
                "rawvideo",
                "-pix_fmt",
                "rgb24",
                "-s",
                "48x32",
                "-framerate",
                "30",
            ],
            &path,
            output,
            &first,
        );
        fs::copy(&first, self.video(CAMERAS[1], extension)).expect("copied");
    }

    /// Copies a camera's video through `ffmpeg` with more options before and behind the input.
    pub fn rewrite(&self, camera: &str, from: &str, to: &str, input: &[&str], output: &[&str]) {
        let (old, new) = (self.path(&format!("old.{from}")), self.video(camera, to));
        fs::rename(self.video(camera, from), &old).expect("recorded");
        let options = [&["-map", "0", "-c", "copy"], output].concat();
        ffmpeg(input, &old, &options, &new);
        fs::remove_file(old).expect("removed");
    }

    /// What training would read.
    pub fn load(&self, skip_broken: bool) -> Result<Dataset, Error> {
        let options = LoadOptions {
            skip_broken,
            ..LoadOptions::default()
        };
        load(self.folder.path(), &options)
    }

    /// What `dash prepare` makes of the recordings, in the folder `out`.
    pub fn prepare(&self, more: PrepareConfig) -> Result<PrepareSummary, Error> {
        drop(fs::remove_dir_all(self.path("out")));
        let config = PrepareConfig {
            poses: Some(self.path("transforms.json")),
            random_points: Some(10),
            ..more
        };
        prepare(&self.path("videos"), &self.path("out"), &config)
    }

    /// The prepared frames of a camera, in order.
    pub fn prepared(&self, camera: &str) -> Vec<Picture> {
        let folder = self.path(&format!("out/{camera}/images"));
        let listed = fs::read_dir(folder).expect("prepared");
        let mut files: Vec<PathBuf> = listed.map(|file| file.expect("listed").path()).collect();
        files.sort();
        let pictures = files.iter().map(|file| {
            let image = image::open(file).expect("an image").into_rgb8();
            Picture {
                width: image.width() as usize,
                height: image.height() as usize,
                rgb: image
                    .into_raw()
                    .iter()
                    .map(|&v| f32::from(v) / 255.0)
                    .collect(),
            }
        });
        pictures.collect()
    }

    /// The seconds of a camera's prepared frames.
    pub fn prepared_seconds(&self, camera: &str) -> Vec<f64> {
        let texts = ["transforms_train.json", "transforms_test.json"]
            .map(|name| fs::read_to_string(self.path(&format!("out/{name}"))).expect("written"));
        let frames = texts.iter().flat_map(|text| {
            let json: serde_json::Value = serde_json::from_str(text).expect("JSON");
            json["frames"].as_array().expect("frames").clone()
        });
        let own = frames.filter(|frame| frame["camera_name"] == camera);
        own.map(|frame| frame["seconds"].as_f64().expect("a number"))
            .collect()
    }

    /// The words must be in the error with which both the readers and `prepare` refuse the recordings.
    #[track_caller]
    pub fn is_refused(&self, words: &[&str]) {
        let errors = [
            self.load(false).expect_err("must not load").to_string(),
            self.prepare(PrepareConfig::default())
                .expect_err("must not be prepared")
                .to_string(),
        ];
        for error in errors {
            for word in words {
                assert!(error.contains(word), "`{word}` is not in: {error}");
            }
        }
    }
}

/// The frames of a camera that a dataset has.
pub fn pictures(dataset: &Dataset, camera: &str) -> Vec<Picture> {
    let views = dataset
        .views
        .iter()
        .filter(|view| view.camera_name == camera);
    let picture = |view: &dash_train::dataset::View| Picture {
        width: view.camera.width,
        height: view.camera.height,
        rgb: view.rgb([0.0; 3]).expect("decodes"),
    };
    views.map(picture).collect()
}

/// `ffmpeg INPUT -i FROM OUTPUT TO`, which must succeed.
#[track_caller]
pub fn ffmpeg(input: &[&str], from: &Path, output: &[&str], to: &Path) {
    let mut command = Command::new(ffmpeg_program());
    command
        .args(["-nostdin", "-loglevel", "error", "-y", "-threads", "1"])
        .args(input)
        .arg("-i")
        .arg(from)
        .args(output)
        .args(["-threads", "1"])
        .arg(to);
    let done = command.output();
    let done = done.expect("these tests need ffmpeg: apt install ffmpeg");
    let complaint = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{command:?}: {complaint}");
}

/// Flips bytes in the middle of a coded picture of the file.
pub fn damage(path: &Path, packet: usize) {
    let mut command = Command::new(ffprobe_program());
    command
        .args(["-v", "error", "-select_streams", "v"])
        .args(["-show_entries", "packet=pos,size", "-of", "csv=p=0"])
        .arg(path);
    let listing = command.output().expect("ffprobe comes with ffmpeg").stdout;
    let listing = String::from_utf8(listing).expect("UTF-8");
    let line = listing.lines().nth(packet).expect("so many pictures");
    let field = |place: usize| -> usize {
        let text = line.split(',').nth(place).expect("a field");
        text.parse().expect("a number")
    };
    let (size, start) = (field(0), field(1));
    let mut bytes = fs::read(path).expect("recorded");
    for byte in &mut bytes[start + size / 3..start + size / 3 + size.min(40) / 2] {
        *byte ^= 0x5a;
    }
    fs::write(path, bytes).expect("written");
}
