//! How pictures are to be shown: turned and mirrored, with square pixels; also where a damaged picture makes another way
//! of decoding necessary.

use std::fs;
use std::path::Path;

use dash_train::prepare::{FrameSize, PrepareConfig};
use image::ImageEncoder;
use image::codecs::jpeg::JpegEncoder;
use rayon::prelude::*;

use super::footage::{CAMERAS, Footage, H, N, Picture, W, damage, pictures};

/// Top left, top right, bottom left, bottom right.
const QUADRANTS: [[u8; 3]; 4] = [[220, 40, 40], [40, 200, 40], [40, 40, 220], [210, 210, 210]];

/// What becomes of (x, y), y pointing down: (a x + c y, b x + d y); and the EXIF orientation that says so.
const TURNS: [([i32; 4], u8); 7] = [
    ([0, 1, -1, 0], 6),
    ([-1, 0, 0, -1], 3),
    ([0, -1, 1, 0], 8),
    ([-1, 0, 0, 1], 2),
    ([1, 0, 0, -1], 4),
    ([0, 1, 1, 0], 5),
    ([0, -1, -1, 0], 7),
];

const H264: &[&str] = &[
    "-c:v",
    "libx264",
    "-preset",
    "ultrafast",
    "-qp",
    "4",
    "-pix_fmt",
    "yuv444p",
    "-g",
    "4",
];

/// Frames of [`QUADRANTS`] with noise, so that each picture is coded in many bytes.
fn noisy(n: usize) -> Vec<Vec<u8>> {
    let mut state = 1_u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 27) as u8
    };
    let mut frame = |_| {
        let pixels = (0..W * H).map(|at| QUADRANTS[2 * (at / W * 2 / H) + at % W * 2 / W]);
        pixels
            .flat_map(|colour| colour.map(|v| v - 16 + noise()))
            .collect()
    };
    (0..n).map(&mut frame).collect()
}

fn shown_size(turn: [i32; 4]) -> [usize; 2] {
    if turn[0] == 0 { [H, W] } else { [W, H] }
}

/// The picture must be [`QUADRANTS`] after a turn.
#[track_caller]
fn assert_turned(picture: &Picture, [a, b, c, d]: [i32; 4], context: &str) {
    for (index, colour) in QUADRANTS.iter().enumerate() {
        let (x, y) = (2 * (index as i32 % 2) - 1, 2 * (index as i32 / 2) - 1);
        let place = [a * x + c * y, b * x + d * y].map(|v| usize::from(v > 0));
        let found = picture.cell([2, 2], place);
        let off = found
            .iter()
            .zip(colour)
            .map(|(f, c)| (f - f32::from(*c) / 255.0).abs());
        assert!(
            off.fold(0.0, f32::max) < 0.08,
            "{context}: {found:?} at {place:?}, not {colour:?}"
        );
    }
}

/// Writes the matrix of the first track of an MP4 or MOV file.
fn set_matrix(path: &Path, [a, b, c, d]: [i32; 4]) {
    let mut bytes = fs::read(path).expect("recorded");
    let header = bytes
        .windows(4)
        .position(|four| four == b"tkhd")
        .expect("a track");
    let one = 1 << 16;
    let matrix = [a * one, b * one, 0, c * one, d * one, 0, 0, 0, 1 << 30];
    let at = header + 44;
    bytes[at..at + 36].copy_from_slice(&matrix.map(i32::to_be_bytes).concat());
    fs::write(path, bytes).expect("written");
}

/// Footage whose display matrix is this one.
fn turned(turn: [i32; 4], extension: &str, codec: &[&str]) -> Footage {
    let footage = Footage::posed(shown_size(turn));
    footage.record_rgb(&noisy(N), extension, codec);
    for camera in CAMERAS {
        set_matrix(&footage.video(camera, extension), turn);
    }
    footage
}

#[test]
fn videos_are_turned_and_mirrored_as_their_matrix_says() {
    let codecs: [(&str, &[&str]); 2] = [("mp4", H264), ("mov", &["-c:v", "prores_ks"])];
    let cases: Vec<_> = TURNS
        .iter()
        .flat_map(|turn| codecs.map(|codec| (turn.0, codec)))
        .collect();
    cases.par_iter().for_each(|&(turn, (extension, codec))| {
        let footage = turned(turn, extension, codec);
        let context = format!("{turn:?} in {extension}");
        let dataset = footage.load(false).expect("loads");
        let [width, height] = shown_size(turn);
        for shown in pictures(&dataset, CAMERAS[1]) {
            assert_eq!([shown.width, shown.height], [width, height], "{context}");
            assert_turned(&shown, turn, &context);
        }
        for (size, divisor) in [(FrameSize::Recorded, 1), (FrameSize::Downscale(2.0), 2)] {
            let config = PrepareConfig {
                size,
                ..PrepareConfig::default()
            };
            footage.prepare(config).expect("prepares");
            for shown in footage.prepared(CAMERAS[0]) {
                assert_eq!(
                    [shown.width, shown.height],
                    [width / divisor, height / divisor]
                );
                assert_turned(&shown, turn, &context);
            }
        }
    });
    let askew = Footage::new();
    askew.record_rgb(&noisy(2), "mp4", H264);
    for camera in CAMERAS {
        set_matrix(&askew.video(camera, "mp4"), [1, 1, -1, 1]);
    }
    askew.is_refused(&[".mp4", "turned by 45 degrees"]);
}

/// One picture of the first camera is damaged: what is left must be as without damage.
#[track_caller]
fn assert_same_with_damage(footage: &Footage, extension: &str, packet: usize, context: &str) {
    let whole = footage
        .load(false)
        .unwrap_or_else(|e| panic!("{context}: {e}"));
    damage(&footage.video(CAMERAS[0], extension), packet);
    let error = footage
        .load(false)
        .err()
        .unwrap_or_else(|| panic!("{context}: not noticed"));
    assert!(
        error.to_string().contains("--skip-broken"),
        "{context}: {error}"
    );
    let dataset = footage
        .load(true)
        .unwrap_or_else(|e| panic!("{context}: {e}"));
    let left = dataset
        .views
        .iter()
        .filter(|view| view.camera_index == 0)
        .count();
    assert!(
        (N / 2..N).contains(&left),
        "{context}: {left} frames are left"
    );
    for view in &dataset.views {
        let same = &whole.views[view.camera_index * N + view.frame];
        assert_eq!(
            (&view.name, view.time),
            (&same.name, same.time),
            "{context}"
        );
        let [found, expected] = [view, same].map(|view| view.rgb([0.0; 3]).expect("decodes"));
        assert!(found == expected, "{context}: {} differs", view.name);
    }
}

#[test]
fn damage_leaves_the_other_pictures_as_they_are_shown() {
    TURNS.par_iter().for_each(|(turn, _)| {
        let footage = turned(*turn, "mp4", H264);
        assert_same_with_damage(&footage, "mp4", 5, &format!("{turn:?}"));
    });
    let tags = ["-colorspace", "bt709", "-color_range", "pc"];
    let limited = [
        "-colorspace",
        "bt709",
        "-color_range",
        "tv",
        "-vf",
        "setsar=3/2",
    ];
    let mpeg4 = ["-c:v", "mpeg4", "-q:v", "1", "-g", "4"];
    let cases: [(&str, &[&str], usize, [usize; 2]); 3] = [
        ("mkv", &mpeg4, 5, [W, H]),
        ("mov", H264, 6, [W * 3 / 2, H]),
        ("mkv", H264, 6, [W * 3 / 2, H]),
    ];
    cases
        .par_iter()
        .for_each(|(extension, codec, packet, size)| {
            let footage = Footage::posed(*size);
            let tags: &[&str] = if size[0] == W { &tags } else { &limited };
            footage.record_rgb(&noisy(N), extension, &[*codec, tags].concat());
            assert_same_with_damage(
                &footage,
                extension,
                *packet,
                &format!("{extension} {codec:?}"),
            );
        });
}

/// EXIF data that state an orientation.
fn exif(orientation: u8) -> Vec<u8> {
    let mut bytes = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".to_vec();
    bytes.extend([orientation, 0, 0, 0, 0, 0, 0]);
    bytes
}

#[test]
fn images_are_turned_and_mirrored_as_their_exif_data_say() {
    for (turn, orientation) in TURNS {
        let [width, height] = shown_size(turn);
        let footage = Footage::posed([width, height]);
        for camera in CAMERAS {
            fs::create_dir(footage.path(&format!("videos/{camera}"))).expect("made");
            for (frame, rgb) in noisy(2).iter().enumerate() {
                let path = footage.path(&format!("videos/{camera}/{frame:04}.jpg"));
                let file = fs::File::create(path).expect("made");
                let mut encoder = JpegEncoder::new_with_quality(file, 95);
                encoder
                    .set_exif_metadata(exif(orientation))
                    .expect("supported");
                encoder
                    .write_image(rgb, W as u32, H as u32, image::ExtendedColorType::Rgb8)
                    .expect("written");
            }
        }
        for (size, divisor) in [(FrameSize::Recorded, 1), (FrameSize::Downscale(2.0), 2)] {
            let config = PrepareConfig {
                size,
                ..PrepareConfig::default()
            };
            let summary = footage.prepare(config).expect("prepares");
            let told = summary
                .remarks
                .iter()
                .any(|said| said.contains("EXIF") && said.contains("cam01"));
            assert!(told, "{summary}");
            for shown in footage.prepared(CAMERAS[1]) {
                assert_eq!(
                    [shown.width, shown.height],
                    [width / divisor, height / divisor]
                );
                assert_turned(&shown, turn, &format!("EXIF orientation {orientation}"));
            }
        }
    }
}

#[test]
fn pixels_come_out_square() {
    let cases: [(&str, &[&str], &str, [usize; 2]); 7] = [
        ("mp4", H264, "2/1", [96, 32]),
        ("mov", H264, "4/3", [64, 32]),
        ("mkv", &["-c:v", "ffv1"], "1/2", [24, 32]),
        ("avi", &["-c:v", "mpeg4"], "16/11", [70, 32]),
        ("webm", &["-c:v", "libvpx"], "3/2", [72, 32]),
        ("ts", H264, "10/11", [44, 32]),
        // Less than half a pixel.
        ("mp4", H264, "100/101", [48, 32]),
    ];
    cases
        .par_iter()
        .for_each(|(extension, codec, shape, size)| {
            let footage = Footage::posed(*size);
            let shape = format!("setsar={shape}");
            footage.record("30", extension, &[*codec, &["-vf", &shape]].concat());
            let dataset = footage
                .load(false)
                .unwrap_or_else(|e| panic!("{extension}, {shape}: {e}"));
            footage.prepare(PrepareConfig::default()).expect("prepares");
            for shown in [pictures(&dataset, CAMERAS[0]), footage.prepared(CAMERAS[1])] {
                for (number, picture) in shown.iter().enumerate() {
                    let context = format!("{extension}, {shape}");
                    assert_eq!([picture.width, picture.height], *size, "{context}");
                    assert_eq!(picture.number(), number, "{context}");
                }
            }
        });
}
