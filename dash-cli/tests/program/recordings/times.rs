//! Times: every frame once, at its time, whatever the container, codec and rate.

use std::fs;

use dash_train::prepare::PrepareConfig;
use rayon::prelude::*;

use super::footage::{CAMERAS, Footage, N, pictures};

/// The page of the book with the table of this test.
const PAGE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../docs/src/reference/videos.md"
);
/// What writes that table anew.
const WRITE: &str = "DASH_WRITE_TABLES";

/// Numbers in JSON are parsed to about the last digit.
const PARSED: f64 = 1e-12;

/// A container and a codec, how they are written, and at which rates.
type Kind = (
    &'static str,
    &'static str,
    &'static [&'static str],
    &'static [&'static str],
);

const H264: &[&str] = &[
    "-c:v",
    "libx264",
    "-preset",
    "ultrafast",
    "-pix_fmt",
    "yuv420p",
    "-g",
    "5",
];
const H264_B: &[&str] = &[
    "-c:v", "libx264", "-preset", "veryfast", "-pix_fmt", "yuv420p", "-g", "6", "-bf", "2",
];
const MPEG4_B: &[&str] = &["-c:v", "mpeg4", "-q:v", "2", "-g", "6", "-bf", "2"];
const MPEG2_B: &[&str] = &["-c:v", "mpeg2video", "-q:v", "2", "-g", "6", "-bf", "2"];
const NTSC: [&str; 3] = ["24000/1001", "30000/1001", "60000/1001"];

const KINDS: &[Kind] = &[
    ("mp4", "H.264", H264, &["24", "30000/1001", "60", "240"]),
    (
        "mp4",
        "H.264 with B-frames",
        H264_B,
        &["25", "30", "60000/1001"],
    ),
    (
        "mp4",
        "MPEG-4 with B-frames",
        MPEG4_B,
        &["24000/1001", "50"],
    ),
    ("m4v", "MPEG-4", &["-c:v", "mpeg4"], &["15"]),
    (
        "mov",
        "ProRes",
        &["-c:v", "prores_ks"],
        &["24", "50", "60000/1001"],
    ),
    ("mov", "Motion JPEG", &["-c:v", "mjpeg"], &["25/2", "120"]),
    ("mov", "H.264 with B-frames", H264_B, &["30", "30000/1001"]),
    (
        "mkv",
        "H.264 with B-frames",
        H264_B,
        &["24", "30", "60", "120"],
    ),
    (
        "mkv",
        "FFV1",
        &["-c:v", "ffv1"],
        &["24000/1001", "30000/1001", "60000/1001", "240"],
    ),
    (
        "webm",
        "VP8",
        &["-c:v", "libvpx"],
        &["30", "60000/1001", "120"],
    ),
    (
        "webm",
        "VP9",
        &["-c:v", "libvpx-vp9", "-cpu-used", "8"],
        &["24", "30000/1001"],
    ),
    ("avi", "FFV1", &["-c:v", "ffv1"], &["24", "30", "120"]),
    (
        "avi",
        "Motion JPEG",
        &["-c:v", "mjpeg"],
        &["15", "30000/1001"],
    ),
    ("avi", "MPEG-4 with B-frames", MPEG4_B, &["25", "30"]),
    ("avi", "H.264 with B-frames", H264_B, &["30", "60000/1001"]),
    ("ts", "H.264", H264, &["24", "30", "60000/1001"]),
    ("ts", "H.264 with B-frames", H264_B, &["25", "60"]),
    ("ts", "MPEG-2 with B-frames", MPEG2_B, &NTSC),
    ("m2ts", "H.264 with B-frames", H264_B, &["50", "30000/1001"]),
    (
        "mxf",
        "MPEG-2 with B-frames",
        MPEG2_B,
        &["25", "30000/1001"],
    ),
    (
        "mpg",
        "MPEG-2 with B-frames",
        MPEG2_B,
        &["25", "30000/1001"],
    ),
];

/// A rate such as `30000/1001` as a number.
fn rate(text: &str) -> f64 {
    let number = |text: &str| text.parse::<f64>().expect("a number");
    match text.split_once('/') {
        Some((n, d)) => number(n) / number(d),
        None => number(text),
    }
}

/// Both ways give every frame once and at its time.
#[track_caller]
fn assert_whole(footage: &Footage, fps: f64, context: &str) {
    let dataset = footage
        .load(false)
        .unwrap_or_else(|e| panic!("{context}: {e}"));
    assert_eq!((dataset.n_cameras, dataset.n_frames), (2, N), "{context}");
    let found = dataset.frame_rate.expect("videos have stamps");
    assert!((found / fps - 1.0).abs() < 1e-3, "{context}: {found}");
    for view in &dataset.views {
        let time = (view.frame as f64 / (N - 1) as f64) as f32;
        assert_eq!(
            view.time.to_bits(),
            time.to_bits(),
            "{context}: {}",
            view.name
        );
    }
    let summary = footage
        .prepare(PrepareConfig::default())
        .unwrap_or_else(|e| panic!("{context}: {e}"));
    assert_eq!(
        (summary.n_frames, summary.fps),
        (N, fps),
        "{context}: {summary}"
    );
    assert!(
        summary.remarks.iter().all(|said| said.contains("points")),
        "{context}: {summary}"
    );
    for camera in CAMERAS {
        for shown in [pictures(&dataset, camera), footage.prepared(camera)] {
            let numbers: Vec<usize> = shown.iter().map(|picture| picture.number()).collect();
            assert!(
                numbers.iter().copied().eq(0..N),
                "{context}: {camera} shows {numbers:?}"
            );
        }
        let seconds = footage.prepared_seconds(camera);
        let off = |(k, secs): (usize, &f64)| (secs - k as f64 / fps).abs();
        let most = seconds.iter().enumerate().map(off).fold(0.0, f64::max);
        assert!(
            seconds.len() == N && most < PARSED,
            "{context}: {seconds:?}"
        );
    }
}

#[test]
fn every_frame_is_there_once_and_at_its_time() {
    let mut cases: Vec<(&str, &Kind)> = KINDS
        .iter()
        .flat_map(|kind| kind.3.iter().map(move |&rate| (rate, kind)))
        .collect();
    assert!(cases.len() >= 40, "only {}", cases.len());
    // Two of one rate make a rig, so that containers go together, too.
    cases.sort_by_key(|(rate, _)| *rate);
    let of_one_rate: Vec<_> = cases.chunk_by(|a, b| a.0 == b.0).collect();
    let rigs: Vec<_> = of_one_rate.iter().flat_map(|c| c.chunks(2)).collect();
    rigs.par_iter().for_each(|rig| {
        let footage = Footage::new();
        let text = rig[0].0;
        let pair = [rig[0].1, rig[rig.len() - 1].1];
        for (camera, (extension, _, options, _)) in CAMERAS.iter().zip(pair) {
            footage.record_one(camera, text, extension, options);
        }
        let [first, second] = pair.map(|kind| format!("{}, {}", kind.0, kind.1));
        let context = format!("{first} and {second} at {text}");
        assert_whole(&footage, rate(text), &context);
    });
    check_table();
}

/// The book's table is that of [`KINDS`].
fn check_table() {
    let mut table = String::from("| container | codec | frames a second |\n| --- | --- | --- |\n");
    for (extension, codec, _, rates) in KINDS {
        table += &format!("| `.{extension}` | {codec} | {} |\n", rates.join(", "));
    }
    let page = fs::read_to_string(PAGE).expect("a page of the book");
    let start = page.find("| container |").expect("the table");
    let end = page[start..]
        .find("\n\n")
        .map_or(page.len(), |length| start + length + 1);
    if std::env::var_os(WRITE).is_some() {
        let page = format!("{}{table}{}", &page[..start], &page[end..]);
        fs::write(PAGE, page).expect("written");
    } else {
        assert_eq!(
            page[start..end],
            table,
            "run this test with {WRITE}=1 to write the table anew"
        );
    }
}

/// A rate, a codec, the containers of the recording and its copy, and how that is written.
type Copied<'a> = (&'a str, &'a [&'a str], &'a str, &'a str, &'a [&'a str]);

/// Units of time, beginnings and roundings that programs choose when they copy a recording.
#[test]
fn copies_keep_the_times() {
    let cases: [Copied; 12] = [
        // Units of a frame, of a millisecond, and ones that are no multiple of a frame.
        ("30", H264, "mp4", "mp4", &["-video_track_timescale", "30"]),
        (
            "30",
            H264_B,
            "mp4",
            "mp4",
            &["-video_track_timescale", "1000"],
        ),
        ("48", H264, "mp4", "mov", &["-video_track_timescale", "600"]),
        (
            "24",
            H264,
            "mp4",
            "mov",
            &["-video_track_timescale", "90000"],
        ),
        // Rounded to milliseconds first.
        ("30", H264, "mkv", "mp4", &[]),
        ("60", H264, "mkv", "ts", &[]),
        (
            "24",
            H264,
            "mkv",
            "mov",
            &["-video_track_timescale", "30000"],
        ),
        // Late beginnings, and a negative one: the clock of MPEG-TS starts anew in the middle.
        ("30", H264_B, "mp4", "mp4", &["-output_ts_offset", "1.4"]),
        (
            "30000/1001",
            H264,
            "mp4",
            "mkv",
            &["-output_ts_offset", "0.7"],
        ),
        ("25", H264, "mp4", "mov", &["-output_ts_offset", "0.05"]),
        ("60", H264_B, "mp4", "ts", &["-output_ts_offset", "95442.2"]),
        // Without what the file says of its length and rate.
        (
            "30",
            H264_B,
            "mp4",
            "mp4",
            &["-movflags", "frag_keyframe+empty_moov"],
        ),
    ];
    cases
        .par_iter()
        .for_each(|(text, codec, from, to, options)| {
            let footage = Footage::new();
            footage.record(text, from, codec);
            for camera in CAMERAS {
                footage.rewrite(camera, from, to, &[], options);
            }
            assert_whole(
                &footage,
                rate(text),
                &format!("{from} to {to} {options:?} at {text}"),
            );
        });
}

/// Where a recording's clock begins depends on the program that wrote it: the first frames belong together.
#[test]
fn recordings_of_different_clocks_go_together() {
    let others: [(&str, &[&str]); 3] = [
        ("mov", &["-output_ts_offset", "1.4"]),
        ("mkv", &["-output_ts_offset", "0.25"]),
        ("ts", &["-output_ts_offset", "26"]),
    ];
    others.par_iter().for_each(|(extension, options)| {
        let footage = Footage::new();
        footage.record("30", "mp4", H264);
        footage.rewrite(CAMERAS[1], "mp4", extension, &[], options);
        assert_whole(&footage, 30.0, &format!("{extension} {options:?}"));
    });
}

/// Frames that an edit list says are not shown are no frames.
#[test]
fn edit_lists_leave_out_what_is_not_shown() {
    [
        ("mp4", "0.22"),
        ("mov", "0.22"),
        ("mp4", "0.1"),
        ("mov", "0.3"),
        ("mp4", "0.26"),
    ]
    .par_iter()
    .for_each(|(extension, start)| {
        let footage = Footage::new();
        footage.record("30", extension, H264_B);
        for camera in CAMERAS {
            footage.rewrite(camera, extension, extension, &["-ss", start], &[]);
        }
        let dataset = footage.load(false).expect("loads");
        let numbers = |shown: Vec<super::footage::Picture>| -> Vec<usize> {
            shown.iter().map(|picture| picture.number()).collect()
        };
        let read = numbers(pictures(&dataset, CAMERAS[0]));
        let n = read.len();
        assert!(
            (2..N).contains(&n) && read.iter().copied().eq(N - n..N),
            "{read:?}"
        );
        let summary = footage.prepare(PrepareConfig::default()).expect("prepares");
        assert_eq!(summary.fps, 30.0, "{summary}");
        assert_eq!(
            numbers(footage.prepared(CAMERAS[0])),
            read,
            "{extension} from {start}"
        );
    });
}

/// Every fifth instant is missing: the others stay at theirs, and `prepare` fills in the frame before.
#[test]
fn frames_that_are_missing_move_no_others() {
    let cases: [(&str, &[&str], &str); 6] = [
        ("mp4", H264_B, "30"),
        ("mov", H264, "60000/1001"),
        ("mkv", H264_B, "24"),
        ("mkv", H264, "120"),
        ("webm", &["-c:v", "libvpx"], "60"),
        ("ts", H264, "60000/1001"),
    ];
    let place = |frame: usize| frame + frame / 4;
    cases.par_iter().for_each(|(extension, codec, text)| {
        let footage = Footage::new();
        let filter = ["-vf", "setpts=N+floor(N/4)", "-fps_mode", "passthrough"];
        footage.record(text, extension, &[&filter, *codec].concat());
        let dataset = footage.load(false).expect("loads");
        let last = place(N - 1);
        for (frame, view) in dataset.views.iter().take(N).enumerate() {
            let time = place(frame) as f32 / last as f32;
            assert!(
                (view.time - time).abs() < 1e-6,
                "{extension}: {} at {}",
                view.name,
                view.time
            );
        }
        let summary = footage.prepare(PrepareConfig::default()).expect("prepares");
        assert_eq!(
            (summary.fps, summary.n_frames),
            (rate(text), last + 1),
            "{extension}"
        );
        let shown = footage.prepared(CAMERAS[1]);
        let numbers: Vec<usize> = shown.iter().map(|picture| picture.number()).collect();
        assert_eq!(numbers, (0..N).collect::<Vec<usize>>(), "{extension}");
    });
}

#[test]
fn another_rate_takes_the_nearest_frames() {
    let cases: [(&str, &str, f64, &[usize]); 5] = [
        ("mkv", "60", 30.0, &[0, 2, 4, 6, 8, 10]),
        ("mp4", "60", 24.0, &[0, 2, 5, 7, 10]),
        ("ts", "30", 10.0, &[0, 3, 6, 9]),
        ("webm", "24", 12.0, &[0, 2, 4, 6, 8, 10]),
        (
            "avi",
            "30",
            60.0,
            &[
                0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7, 8, 8, 9, 9, 10, 10, 11,
            ],
        ),
    ];
    cases
        .par_iter()
        .for_each(|(extension, text, fps, expected)| {
            let footage = Footage::new();
            let codec: &[&str] = if *extension == "webm" {
                &["-c:v", "libvpx"]
            } else {
                H264
            };
            footage.record(text, extension, codec);
            let config = PrepareConfig {
                fps: Some(*fps),
                ..PrepareConfig::default()
            };
            let summary = footage.prepare(config).expect("prepares");
            let repeats = summary
                .remarks
                .iter()
                .any(|said| said.contains("more than"));
            assert_eq!(repeats, *fps > rate(text), "{summary}");
            let shown = footage.prepared(CAMERAS[0]);
            let numbers: Vec<usize> = shown.iter().map(|picture| picture.number()).collect();
            assert_eq!(&numbers, expected, "{extension}");
        });
}
