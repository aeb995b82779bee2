//! Which of a file's tracks is the video: no cover, no thumbnail, and of several the one marked as default.

use std::fs;
use std::path::Path;

use dash_train::prepare::PrepareConfig;
use rayon::prelude::*;

use super::footage::{CAMERAS, Footage, N, ffmpeg, pictures};

const H264: &[&str] = &[
    "-c:v",
    "libx264",
    "-preset",
    "ultrafast",
    "-pix_fmt",
    "yuv420p",
];

/// All frames are those of the numbered video.
#[track_caller]
fn assert_numbered(footage: &Footage, context: &str) {
    let dataset = footage
        .load(false)
        .unwrap_or_else(|e| panic!("{context}: {e}"));
    footage
        .prepare(PrepareConfig::default())
        .unwrap_or_else(|e| panic!("{context}: {e}"));
    for shown in [pictures(&dataset, CAMERAS[0]), footage.prepared(CAMERAS[1])] {
        let numbers: Vec<usize> = shown.iter().map(|picture| picture.number()).collect();
        assert!(numbers.iter().copied().eq(0..N), "{context}: {numbers:?}");
    }
}

/// A red picture as a JPEG file.
fn cover(footage: &Footage) -> String {
    let path = footage.path("cover.jpg");
    let red = image::RgbImage::from_pixel(80, 60, image::Rgb([255, 0, 0]));
    red.save(&path).expect("written");
    path.to_str().expect("UTF-8").into()
}

fn atom(name: &[u8; 4], content: &[u8]) -> Vec<u8> {
    let length = (content.len() as u32 + 8).to_be_bytes();
    [&length, &name[..], content].concat()
}

/// Puts a cover into an MP4 file, before its tracks.
fn cover_before_tracks(path: &Path, jpeg: &[u8]) {
    let handler = atom(b"hdlr", b"\0\0\0\0\0\0\0\0mdirappl\0\0\0\0\0\0\0\0\0");
    let kind = [0, 0, 0, 13, 0, 0, 0, 0];
    let picture = atom(b"covr", &atom(b"data", &[&kind, jpeg].concat()));
    let list = atom(b"ilst", &picture);
    let meta = atom(b"meta", &[&[0; 4], &handler[..], &list].concat());
    let user = atom(b"udta", &meta);
    let bytes = fs::read(path).expect("recorded");
    let position = |name: &[u8; 4]| {
        bytes
            .windows(4)
            .position(|four| four == name)
            .expect("there")
            - 4
    };
    // The tracks lie behind the pictures, whose places in the file don't change.
    let (movie, track) = (position(b"moov"), position(b"trak"));
    assert!(position(b"mdat") < movie);
    let old = u32::from_be_bytes(bytes[movie..movie + 4].try_into().expect("four bytes"));
    let length = old + user.len() as u32;
    let mut changed = bytes[..track].to_vec();
    changed[movie..movie + 4].copy_from_slice(&length.to_be_bytes());
    changed.extend(user);
    changed.extend(&bytes[track..]);
    fs::write(path, changed).expect("written");
}

#[test]
fn covers_are_no_videos() {
    let jpeg = |cover: &str| fs::read(cover).expect("written");
    // As an attached picture before or behind the video.
    let behind = [
        "-map",
        "1",
        "-c:v:1",
        "copy",
        "-disposition:v:1",
        "attached_pic",
    ];
    let before = [
        "-map",
        "1",
        "-map",
        "0",
        "-c",
        "copy",
        "-disposition:v:0",
        "attached_pic",
    ];
    let cases: [(&str, &[&str]); 5] = [
        ("mp4", &behind),
        ("mov", &behind),
        ("m4v", &behind),
        ("mp4", &before),
        ("mov", &before),
    ];
    cases.par_iter().for_each(|(extension, options)| {
        let footage = Footage::new();
        let cover = cover(&footage);
        footage.record("30", "mp4", H264);
        for camera in CAMERAS {
            let first = ["-map", "0"];
            let all: &[&str] = if options[1] == "1" && options.len() == 6 {
                &first
            } else {
                &[]
            };
            let copied = [&["-i", &cover], all, &["-c", "copy"], options].concat();
            let (old, new) = (footage.path("old.mp4"), footage.video(camera, extension));
            fs::rename(footage.video(camera, "mp4"), &old).expect("recorded");
            ffmpeg(&[], &old, &copied, &new);
        }
        assert_numbered(&footage, &format!("{extension} {options:?}"));
    });
    let footage = Footage::new();
    let cover = cover(&footage);
    footage.record("30", "mp4", H264);
    for camera in CAMERAS {
        cover_before_tracks(&footage.video(camera, "mp4"), &jpeg(&cover));
    }
    assert_numbered(&footage, "before the tracks");
    let attached = ["-attach", &cover, "-metadata:s:t", "mimetype=image/jpeg"];
    for camera in CAMERAS {
        footage.rewrite(camera, "mp4", "mkv", &[], &attached);
    }
    assert_numbered(&footage, "attached to Matroska");
}

#[test]
fn of_several_tracks_the_default_one_is_read() {
    let cases: [(&str, usize); 6] = [
        ("mp4", 0),
        ("mp4", 1),
        ("mov", 1),
        ("mkv", 0),
        ("mkv", 1),
        // No track of it is marked: the first.
        ("ts", 0),
    ];
    cases.par_iter().for_each(|(extension, place)| {
        let footage = Footage::new();
        footage.record("30", "mp4", H264);
        let other = footage.path("other.mp4");
        ffmpeg(
            &["-f", "lavfi"],
            Path::new("color=c=red:s=96x64:d=0.4:r=30"),
            H264,
            &other,
        );
        for camera in CAMERAS {
            let (old, new) = (footage.path("old.mp4"), footage.video(camera, extension));
            fs::rename(footage.video(camera, "mp4"), &old).expect("recorded");
            let other = other.to_str().expect("UTF-8");
            let order = if *place == 0 { ["0", "1"] } else { ["1", "0"] };
            let default = format!("-disposition:v:{place}");
            let none = format!("-disposition:v:{}", 1 - place);
            let options = [
                "-i", other, "-map", order[0], "-map", order[1], "-c", "copy",
            ];
            ffmpeg(
                &[],
                &old,
                &[&options[..], &[&default, "default", &none, "0"]].concat(),
                &new,
            );
        }
        assert_numbered(&footage, &format!("track {place} of {extension}"));
    });
}

#[test]
fn a_file_without_video_is_refused() {
    let footage = Footage::new();
    let cover = cover(&footage);
    for camera in CAMERAS {
        let sound = Path::new("sine=d=0.2");
        let maps = ["-map", "0", "-map", "1", "-c:v", "copy"];
        let options = [
            &["-i", &cover],
            &maps[..],
            &["-disposition:v", "attached_pic"],
        ]
        .concat();
        ffmpeg(
            &["-f", "lavfi"],
            sound,
            &options,
            &footage.video(camera, "mp4"),
        );
    }
    footage.is_refused(&[".mp4", "no video track"]);
}
