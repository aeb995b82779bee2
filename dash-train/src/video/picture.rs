//! What a file says of how its pictures are to be shown: turned or mirrored, the shape of pixels, colours.
//!
//! `ffmpeg` is told all of it in filters of ours, so that every way of decoding gives the same pictures. Frames come out
//! upright, with square pixels, in full-range RGB. A picture without a stated matrix or range is taken as `ffmpeg`
//! takes it: BT.601, limited range. Curves close to sRGB's count as sRGB. Primaries are kept; wide ones are told, and so are
//! interlaced pictures and transparency, which is not read.

use std::path::Path;

use serde::Deserialize;

use super::clock::Ratio;
use crate::Error;

/// Largest side of a picture that is read.
pub(crate) const MAX_IMAGE_SIDE: u32 = 16_384;

/// Averages over the area that a pixel covers, so that fine detail doesn't alias.
const SMALLER: &str = "flags=area+accurate_rnd+full_chroma_int";
const LARGER: &str = "flags=bicubic+accurate_rnd+full_chroma_int";
/// Curves that are near sRGB's, so that pictures are shown with their values unchanged.
const SDR_CURVES: [&str; 13] = [
    "unknown",
    "bt709",
    "gamma22",
    "gamma28",
    "bt470m",
    "bt470bg",
    "smpte170m",
    "smpte240m",
    "iec61966-2-1",
    "iec61966-2-4",
    "bt1361e",
    "bt2020-10",
    "bt2020-12",
];
/// Matrices that `ffmpeg` undoes. `gbr` is none.
const MATRICES: [&str; 8] = [
    "unknown",
    "gbr",
    "bt709",
    "fcc",
    "bt470bg",
    "smpte170m",
    "smpte240m",
    "bt2020nc",
];
/// Primaries about those of sRGB.
const NARROW_PRIMARIES: [&str; 6] = [
    "unknown",
    "bt709",
    "bt470m",
    "bt470bg",
    "smpte170m",
    "smpte240m",
];
/// Largest share of a matrix's larger entries that its smaller ones may have: a turn of a degree.
const ASKEW: f64 = 0.02;

/// What `ffprobe` lists of a video stream's pictures.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct Stated {
    width: usize,
    height: usize,
    sample_aspect_ratio: Option<String>,
    color_range: Option<String>,
    color_space: Option<String>,
    color_transfer: Option<String>,
    color_primaries: Option<String>,
    field_order: Option<String>,
    pix_fmt: Option<String>,
    side_data_list: Vec<SideData>,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
struct SideData {
    /// Three lines such as `00000000:   65536   0   0`.
    displaymatrix: Option<String>,
}

/// How frames become upright pictures with square pixels.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Picture {
    /// Filters that turn and mirror.
    turn: &'static [&'static str],
    /// Width and height with square pixels, once turned, where pixels are not square.
    square: Option<[usize; 2]>,
    /// Width and height once turned.
    turned: [usize; 2],
    /// Stated colours, which copied pictures lose.
    colours: Vec<String>,
    /// What the user should know.
    pub(super) remarks: Vec<String>,
}

impl Picture {
    /// How the pictures of a stream are shown.
    ///
    /// # Errors
    /// When they cannot be shown as they are meant.
    pub(super) fn new(path: &Path, stated: &Stated) -> Result<Self, Error> {
        let turn = turn(path, stated)?;
        let is_quarter = turn.iter().any(|filter| filter.starts_with("transpose"));
        let upright = |[width, height]: [usize; 2]| match is_quarter {
            true => [height, width],
            false => [width, height],
        };
        let coded = [stated.width, stated.height];
        let mut remarks = Vec::new();
        let square = squared(path, stated)?;
        if let (Some([width, height]), Some(shape)) = (square, &stated.sample_aspect_ratio) {
            remarks.push(format!(
                "its pixels have the shape {shape}: frames of {}x{} are resampled to {width}x{height} square pixels",
                coded[0], coded[1]
            ));
        }
        remarks.extend(check_colours(path, stated)?);
        remarks.extend(interlaced(stated));
        remarks.extend(transparent(stated));
        Ok(Self {
            turn,
            square: square.map(upright),
            turned: upright(coded),
            colours: colours(stated),
            remarks,
        })
    }

    /// The filters for frames of `size`, or of their own. `is_copied` tells that the file's statements were lost.
    pub(super) fn filters(&self, is_copied: bool, size: Option<[usize; 2]>) -> Vec<String> {
        let mut filters = Vec::new();
        if is_copied && !self.colours.is_empty() {
            filters.push(format!("setparams={}", self.colours.join(":")));
        }
        filters.extend(self.turn.iter().map(ToString::to_string));
        // Pictures of their own size, too, are converted by a filter: without one, `ffmpeg` rounds colours down.
        let [width, height] = size.or(self.square).unwrap_or(self.turned);
        let is_smaller =
            [width, height] != self.turned && width <= self.turned[0] && height <= self.turned[1];
        let flags = if is_smaller { SMALLER } else { LARGER };
        filters.push(format!("scale={width}:{height}:{flags}"));
        filters
    }
}

/// The filters that do what the display matrix says.
fn turn(path: &Path, stated: &Stated) -> Result<&'static [&'static str], Error> {
    let mut matrices = stated.side_data_list.iter();
    let Some(text) = matrices.find_map(|data| data.displaymatrix.as_ref()) else {
        return Ok(&[]);
    };
    let rows: Vec<Vec<f64>> = text
        .lines()
        .filter_map(|line| line.split_once(':'))
        .map(|(_, row)| row.split_whitespace().flat_map(str::parse).collect())
        .collect();
    let malformed = |found: String| {
        Error::invalid(
            path,
            "pictures turned by right angles or mirrored",
            found,
            "turn the pictures themselves (`ffmpeg -i OLD NEW`)",
        )
    };
    let [[a, b, ..], [c, d, ..], ..] = &rows.iter().map(Vec::as_slice).collect::<Vec<_>>()[..]
    else {
        return Err(malformed(format!("the display matrix {text:?}")));
    };
    let [a, b, c, d] = [*a, *b, *c, *d];
    let sign = |value: f64, beside: f64| match value.abs() <= ASKEW * beside.abs() {
        true => 0,
        false => value.signum() as i32,
    };
    // What becomes of (x, y), y pointing down: (a x + c y, b x + d y).
    Ok(match [sign(a, b), sign(b, a), sign(c, d), sign(d, c)] {
        // No matrix at all.
        [0, 0, 0, 0] | [1, 0, 0, 1] => &[],
        [-1, 0, 0, 1] => &["hflip"],
        [1, 0, 0, -1] => &["vflip"],
        [-1, 0, 0, -1] => &["hflip", "vflip"],
        [0, 1, -1, 0] => &["transpose=clock"],
        [0, -1, 1, 0] => &["transpose=cclock"],
        [0, 1, 1, 0] => &["transpose=cclock_flip"],
        [0, -1, -1, 0] => &["transpose=clock_flip"],
        _ => {
            let degrees = b.atan2(a).to_degrees().round();
            return Err(malformed(format!("ones turned by {degrees} degrees")));
        }
    })
}

/// Width and height with square pixels before turning; `None` where they are square. Players, too, keep the height.
fn squared(path: &Path, stated: &Stated) -> Result<Option<[usize; 2]>, Error> {
    let shape = stated.sample_aspect_ratio.as_deref();
    let Some(shape) = shape.and_then(|text| Ratio::parse(text, ':')) else {
        return Ok(None);
    };
    let width = (stated.width as f64 * shape.value()).round();
    if !(1.0..=f64::from(MAX_IMAGE_SIDE)).contains(&width) {
        return Err(Error::invalid(
            path,
            format!("frames from 1 to {MAX_IMAGE_SIDE} pixels wide"),
            format!(
                "{width} with square pixels: they are {}:{}",
                shape.n, shape.d
            ),
            "state the true shape of its pixels (`ffmpeg -i OLD -c copy -aspect 16:9 NEW`)",
        ));
    }
    let width = width as usize;
    Ok((width != stated.width).then_some([width, stated.height]))
}

/// Refuses colours that would come out wrong; a remark where they are of another gamut.
fn check_colours(path: &Path, stated: &Stated) -> Result<Option<String>, Error> {
    let or_unknown = |value: &Option<String>| value.as_deref().unwrap_or("unknown").to_string();
    let curve = or_unknown(&stated.color_transfer);
    let is_among = |known: &[&str], value: &str| known.contains(&value) || value == "reserved";
    if !is_among(&SDR_CURVES, &curve) {
        let name = match curve.as_str() {
            "smpte2084" => "PQ (smpte2084), which is HDR".into(),
            "arib-std-b67" => "HLG (arib-std-b67), which is HDR".into(),
            _ => curve,
        };
        return Err(Error::invalid(
            path,
            "pictures in standard dynamic range",
            format!("the transfer curve {name}"),
            "convert it (`ffmpeg -i OLD -vf zscale=t=linear:npl=100,format=gbrpf32le,tonemap=hable,\
             zscale=p=bt709:t=bt709:m=bt709:r=tv,format=yuv420p NEW`)",
        ));
    }
    let matrix = or_unknown(&stated.color_space);
    if !is_among(&MATRICES, &matrix) {
        return Err(Error::invalid(
            path,
            "colours of RGB, BT.601, BT.709 or BT.2020 (non-constant luminance)",
            format!("the matrix {matrix}"),
            "convert it (`ffmpeg -i OLD -vf zscale=m=bt709 NEW`)",
        ));
    }
    let primaries = or_unknown(&stated.color_primaries);
    let is_wide = !is_among(&NARROW_PRIMARIES, &primaries);
    Ok(is_wide.then(|| {
        format!(
            "its primaries are {primaries}: colours are kept as they are, not converted to sRGB's"
        )
    }))
}

/// A remark on pictures of two instants each, their lines taking turns.
fn interlaced(stated: &Stated) -> Option<String> {
    let order = stated.field_order.as_deref()?;
    ["tt", "bb", "tb", "bt"].contains(&order).then(|| {
        format!(
            "its pictures are interlaced (field order {order}): every other line is of another instant; take them apart first \
             (`ffmpeg -i OLD -vf bwdif=mode=send_frame NEW`)"
        )
    })
}

/// A remark on pictures that are partly transparent.
fn transparent(stated: &Stated) -> Option<String> {
    let format = stated.pix_fmt.as_deref()?;
    let has_alpha = [
        "yuva", "gbrap", "rgba", "bgra", "argb", "abgr", "ya8", "ya16",
    ]
    .iter()
    .any(|start| format.starts_with(start));
    has_alpha.then(|| {
        format!(
            "it has transparency ({format}), which is not read of videos: colours count as they are stored; write its pictures \
             as PNG files to keep it"
        )
    })
}

/// The stated range and matrix as options of the filter `setparams`.
fn colours(stated: &Stated) -> Vec<String> {
    let option = |name: &str, value: &Option<String>| {
        let value = value.as_deref().filter(|value| *value != "unknown")?;
        (value != "reserved").then(|| format!("{name}={value}"))
    };
    let range = option("range", &stated.color_range);
    let matrix = option("colorspace", &stated.color_space);
    range.into_iter().chain(matrix).collect()
}

#[cfg(test)]
mod tests;
