//! Colours: range, matrix and depth are undone; what would come out wrong is refused.

use dash_train::prepare::PrepareConfig;
use rayon::prelude::*;

use super::footage::{CAMERAS, Footage, H, W, pictures};

const H264: &[&str] = &[
    "-c:v",
    "libx264",
    "-preset",
    "ultrafast",
    "-pix_fmt",
    "yuv444p",
];

/// A container, the matrix and range of the conversion, the format, how it is encoded, and whether that is tagged.
type Conversion<'a> = (&'a str, &'a str, &'a str, &'a str, &'a [&'a str], bool);
/// A container, how it is encoded, tags, and words of the error.
type Refused<'a> = (&'a str, &'a [&'a str], &'a [&'a str], &'a [&'a str]);

/// Three columns in two rows, of one colour each.
const PATCHES: [[u8; 3]; 6] = [
    [200, 40, 40],
    [40, 180, 60],
    [50, 60, 200],
    [128, 128, 128],
    [240, 220, 30],
    [16, 200, 200],
];
/// Of 255: 8 bits of limited range twice rounded.
const COLOUR_ERROR: f32 = 5.0;

#[test]
fn colours_come_out_as_they_went_in() {
    const X264: [&str; 4] = ["-c:v", "libx264", "-qp", "1"];
    const MOV: [&str; 6] = ["-c:v", "mpeg4", "-q:v", "1", "-movflags", "write_colr"];
    let cases: [Conversion; 14] = [
        ("mp4", "bt709", "tv", "yuv444p", &X264, true),
        ("mp4", "bt709", "pc", "yuv444p", &X264, true),
        ("mp4", "smpte170m", "tv", "yuv420p", &X264, true),
        ("mp4", "smpte170m", "pc", "yuv444p", &X264, true),
        ("mp4", "bt2020nc", "tv", "yuv420p10le", &X264, true),
        ("mkv", "bt709", "tv", "yuv422p10le", &X264, true),
        ("mkv", "smpte240m", "tv", "yuv444p", &X264, true),
        ("mkv", "bt709", "pc", "yuv444p", &["-c:v", "ffv1"], true),
        (
            "mkv",
            "bt2020nc",
            "tv",
            "yuv444p12le",
            &["-c:v", "ffv1"],
            true,
        ),
        ("mov", "bt709", "tv", "yuv420p", &MOV, true),
        ("mov", "bt709", "tv", "yuv422p10le", &X264, true),
        (
            "webm",
            "bt709",
            "tv",
            "yuv420p",
            &["-c:v", "libvpx-vp9", "-lossless", "1"],
            true,
        ),
        // Without statements: BT.601, limited range.
        (
            "avi",
            "smpte170m",
            "tv",
            "yuv420p",
            &["-c:v", "mpeg4", "-q:v", "1"],
            false,
        ),
        ("mkv", "bt709", "tv", "gbrp", &["-c:v", "ffv1"], false),
    ];
    let frame: Vec<u8> = (0..W * H)
        .flat_map(|at| PATCHES[at / W * 2 / H * 3 + at % W * 3 / W])
        .collect();
    cases
        .par_iter()
        .for_each(|(extension, matrix, range, format, codec, tagged)| {
            let context = format!("{extension}, {matrix}, {range}, {format}, {codec:?}");
            let footage = Footage::new();
            let name = if *matrix == "bt2020nc" {
                "bt2020"
            } else {
                matrix
            };
            let flags = "flags=accurate_rnd+full_chroma_int+full_chroma_inp";
            let filter =
                format!("scale=out_color_matrix={name}:out_range={range}:{flags},format={format}");
            let tags: &[&str] = &["-colorspace", matrix, "-color_range", range];
            let tags = if *tagged { tags } else { &[] };
            let output = [*codec, &["-vf", &filter], tags].concat();
            footage.record_rgb(&[frame.clone(), frame.clone()], extension, &output);
            let dataset = footage
                .load(false)
                .unwrap_or_else(|e| panic!("{context}: {e}"));
            footage.prepare(PrepareConfig::default()).expect("prepares");
            let shown = [pictures(&dataset, CAMERAS[0]), footage.prepared(CAMERAS[1])];
            for picture in shown.iter().flatten() {
                for (place, patch) in PATCHES.iter().enumerate() {
                    let found = picture.cell([3, 2], [place % 3, place / 3]);
                    let found = found.map(|v| 255.0 * v);
                    let off = found
                        .iter()
                        .zip(patch)
                        .map(|(f, p)| (f - f32::from(*p)).abs());
                    assert!(
                        off.fold(0.0, f32::max) < COLOUR_ERROR,
                        "{context}: {found:?} of {patch:?}"
                    );
                }
            }
        });
}

#[test]
fn colours_that_would_come_out_wrong_are_refused() {
    let mpeg4 = [
        "-c:v",
        "mpeg4",
        "-movflags",
        "write_colr",
        "-colorspace",
        "bt2020nc",
    ];
    let vp9 = ["-c:v", "libvpx-vp9", "-pix_fmt", "yuv420p"];
    let pq = ["-color_primaries", "bt2020", "-color_trc", "smpte2084"];
    let cases: [Refused; 8] = [
        ("mp4", H264, &pq, &["PQ", "HDR"]),
        ("mov", &mpeg4, &pq, &["PQ"]),
        ("mkv", &["-c:v", "ffv1"], &pq, &["PQ", "tonemap"]),
        (
            "mp4",
            H264,
            &["-color_trc", "arib-std-b67"],
            &["HLG", "HDR"],
        ),
        ("webm", &vp9, &["-color_trc", "arib-std-b67"], &["HLG"]),
        ("mp4", H264, &["-color_trc", "linear"], &["curve linear"]),
        ("mp4", H264, &["-colorspace", "ycgco"], &["matrix ycgco"]),
        (
            "mkv",
            H264,
            &["-colorspace", "bt2020c"],
            &["matrix bt2020c"],
        ),
    ];
    cases
        .par_iter()
        .for_each(|(extension, codec, tags, words)| {
            let footage = Footage::new();
            footage.record("30", extension, &[*codec, tags].concat());
            let name = format!(".{extension}: ");
            footage.is_refused(&[*words, &[name.as_str()]].concat());
        });
}
