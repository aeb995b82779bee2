//! The moving pixels in the video of a static camera.

use std::convert::Infallible;
use std::ops::Range;

use rayon::prelude::*;

use super::CHANNELS;

/// Rows of all frames that are looked at together take about this much memory.
const BAND_BYTES: usize = 128 << 20;

/// A blurred value this far from its median over time has moved. Sensor noise of standard
/// deviation 0.03 is 0.01 after the blur: a tenth of it.
pub const MOVING_THRESHOLD: f32 = 0.1;
/// Values of 8-bit pictures can lie exactly at the threshold, and then don't move. Rounding in single precision is
/// smaller than this, and the next larger value is further away.
const ROUNDING: f32 = 1e-6;
/// How the moving pixels are found, for `metric_settings`.
pub const MOVING_PIXELS_RULE: &str = "per camera, one mask for its whole video: after a 3x3 box blur (over the pixels that exist), a \
     pixel moves when in some frame some sRGB channel is more than 0.1 from its median over the \
     video's frames (the lower of the two middle values); of a camera with a single frame, the pixels that \
     the dataset's mask of it marks, or none";

/// The moving pixels in the video of one static camera.
///
/// A pixel moves when in some frame, after a 3x3 box blur, some channel is more than
/// [`MOVING_THRESHOLD`] from its median over all frames. The same mask holds for every frame of the
/// camera. With fewer than two frames nothing moves. A NaN never makes a pixel move.
///
/// # Shapes
/// `video` frames of `[H, W, 3]` -> `[H, W]`.
///
/// # Panics
/// When a frame's size is not `width x height`.
///
/// ```
/// use dash_train::metrics::moving_pixels;
///
/// let (dark, bright) = (vec![0.0; 48], vec![1.0; 48]);
/// let moving = moving_pixels(&[&dark, &dark, &bright], 4, 4);
/// assert_eq!(moving, [true; 16]);
/// ```
pub fn moving_pixels(video: &[&[f32]], width: usize, height: usize) -> Vec<bool> {
    for frame in video {
        assert_eq!(
            frame.len(),
            width * height * CHANNELS,
            "moving_pixels: a frame is not {width} x {height}"
        );
    }
    let rows = |frame: usize, rows: Range<usize>| {
        let line = width * CHANNELS;
        Ok::<_, Infallible>(video[frame][rows.start * line..rows.end * line].to_vec())
    };
    match moving_pixels_by_bands(video.len(), [width, height], rows) {
        Ok(moving) => moving,
        Err(never) => match never {},
    }
}

/// [`moving_pixels`] of a video that is not in memory as a whole: bands of rows are looked at one after
/// the other, and `rows_of` gives those of a frame, `[rows, W, 3]`.
///
/// # Errors
/// What `rows_of` refuses.
pub(crate) fn moving_pixels_by_bands<E>(
    n_frames: usize,
    [width, height]: [usize; 2],
    mut rows_of: impl FnMut(usize, Range<usize>) -> Result<Vec<f32>, E>,
) -> Result<Vec<bool>, E> {
    let mut moving = vec![false; width * height];
    if n_frames < 2 || moving.is_empty() {
        return Ok(moving);
    }
    let band_rows = rows_per_band(n_frames, width);
    for (band, moving) in moving.chunks_mut(width * band_rows).enumerate() {
        let first = band * band_rows;
        let last = first + moving.len() / width;
        // The blur reaches a row further.
        let seen = first.saturating_sub(1)..(last + 1).min(height);
        let strips = (0..n_frames)
            .map(|frame| rows_of(frame, seen.clone()))
            .collect::<Result<Vec<_>, E>>()?;
        moving.par_chunks_mut(width).enumerate().for_each_init(
            || (vec![0.0; width * CHANNELS * n_frames], vec![0.0; n_frames]),
            |(blurred, sorted), (y, row)| {
                for (t, strip) in strips.iter().enumerate() {
                    blur_row(strip, width, &seen, first + y, |value, v| {
                        blurred[value * n_frames + t] = v;
                    });
                }
                for (x, moves) in row.iter_mut().enumerate() {
                    *moves = (x * CHANNELS..(x + 1) * CHANNELS).any(|value| {
                        let over_time = &blurred[value * n_frames..(value + 1) * n_frames];
                        departs(over_time, sorted)
                    });
                }
            },
        );
    }
    Ok(moving)
}

/// How often [`moving_pixels_by_bands`] asks for rows of every frame.
pub(crate) fn n_bands(n_frames: usize, [width, height]: [usize; 2]) -> usize {
    height.div_ceil(rows_per_band(n_frames, width))
}

fn rows_per_band(n_frames: usize, width: usize) -> usize {
    let row_bytes = width * CHANNELS * size_of::<f32>() * n_frames;
    (BAND_BYTES / row_bytes.max(1)).max(1)
}

/// Whether a value leaves its median; `sorted` is scratch space of the same length.
fn departs(over_time: &[f32], sorted: &mut [f32]) -> bool {
    sorted.copy_from_slice(over_time);
    let middle = (sorted.len() - 1) / 2;
    let median = *sorted.select_nth_unstable_by(middle, f32::total_cmp).1;
    over_time
        .iter()
        .any(|v| (v - median).abs() > MOVING_THRESHOLD + ROUNDING)
}

/// Calls `out(x * 3 + channel, mean)` for row `y` of a frame of which the rows `seen` are given: means
/// over the 3x3 pixels that exist.
fn blur_row(
    strip: &[f32],
    width: usize,
    seen: &Range<usize>,
    y: usize,
    mut out: impl FnMut(usize, f32),
) {
    // Beyond the rows that are given there is no picture.
    let rows = y.saturating_sub(1).max(seen.start)..(y + 2).min(seen.end);
    let rows = rows.start - seen.start..rows.end - seen.start;
    for x in 0..width {
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        let mut sum = [0.0; CHANNELS];
        for row in rows.clone() {
            let pixels = &strip
                [(row * width + columns.start) * CHANNELS..(row * width + columns.end) * CHANNELS];
            for pixel in pixels.chunks_exact(CHANNELS) {
                for (sum, v) in sum.iter_mut().zip(pixel) {
                    *sum += v;
                }
            }
        }
        let n = (rows.len() * columns.len()) as f32;
        for (channel, sum) in sum.iter().enumerate() {
            out(x * CHANNELS + channel, sum / n);
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg32;

    use super::*;
    use crate::numbers::standard_normal;

    fn gray(width: usize, height: usize, value: f32) -> Vec<f32> {
        vec![value; width * height * CHANNELS]
    }

    fn moving(video: &[Vec<f32>], width: usize, height: usize) -> Vec<bool> {
        let frames: Vec<&[f32]> = video.iter().map(Vec::as_slice).collect();
        moving_pixels(&frames, width, height)
    }

    #[test]
    fn the_pixels_whose_blur_reaches_the_object_move() {
        // A white pixel on black for one frame of three: 1/9 > 0.1 over its 3x3 surroundings.
        let (width, height) = (7, 5);
        let mut video = vec![gray(width, height, 0.0); 3];
        let pixel = 2 * width + 3;
        video[1][pixel * CHANNELS] = 1.0;
        let mask = moving(&video, width, height);
        for y in 0..height {
            for x in 0..width {
                let expected = (1..=3).contains(&y) && (2..=4).contains(&x);
                assert_eq!(mask[y * width + x], expected, "pixel {x}, {y}");
            }
        }
        // 0.85 / 9 stays below the threshold.
        video[1][pixel * CHANNELS] = 0.85;
        assert!(!moving(&video, width, height).contains(&true));
    }

    #[test]
    fn at_the_corner_the_mean_is_over_four_pixels() {
        let mut video = vec![gray(4, 4, 0.5); 3];
        video[2][2] = 0.5 - 0.41;
        let mask = moving(&video, 4, 4);
        // 0.41 / 4 > 0.1 at the corner; 0.41 / 6 beside it.
        assert_eq!(mask.iter().filter(|m| **m).count(), 1);
        assert!(mask[0]);
    }

    #[test]
    fn what_is_exactly_the_threshold_away_does_not_move() {
        // At the corner 102 steps of 255, over four pixels, are a tenth; single precision has it a little more or less.
        for low in 0..=153 {
            let level = |steps: usize| steps as f32 / 255.0;
            let mut video = vec![gray(4, 4, level(low)); 3];
            video[2][0] = level(low + 102);
            assert!(!moving(&video, 4, 4).contains(&true), "{low}");
            if low < 153 {
                video[2][0] = level(low + 103);
                assert!(moving(&video, 4, 4)[0], "{low}");
            }
        }
    }

    #[test]
    fn the_median_is_what_is_seen_most() {
        // The object stands still in most frames: the pixels it covers then move once it leaves.
        let video: Vec<_> = (0..5)
            .map(|t| gray(3, 3, if t == 0 { 0.2 } else { 0.6 }))
            .collect();
        assert!(moving(&video, 3, 3).iter().all(|m| *m));
        let drift: Vec<_> = (0..5).map(|t| gray(3, 3, 0.5 + 0.04 * t as f32)).collect();
        assert!(
            !moving(&drift, 3, 3).contains(&true),
            "0.08 from its median at most"
        );
    }

    #[test]
    fn two_frames_measure_the_whole_change() {
        let video = [gray(2, 2, 0.3), gray(2, 2, 0.45)];
        assert!(moving(&video, 2, 2).iter().all(|m| *m));
    }

    #[test]
    fn noise_does_not_move_but_an_object_in_it_does() {
        let (width, height, n_frames) = (48, 32, 40);
        let mut rng = Pcg32::seed_from_u64(5);
        let mut video: Vec<Vec<f32>> = (0..n_frames)
            .map(|_| {
                (0..width * height * CHANNELS)
                    .map(|_| 0.5 + 0.03 * standard_normal::<f32>(&mut rng))
                    .collect()
            })
            .collect();
        assert!(!moving(&video, width, height).contains(&true));
        for (t, frame) in video.iter_mut().enumerate() {
            for y in 10..14 {
                for x in t..t + 4 {
                    frame[(y * width + x) * CHANNELS] = 0.9;
                }
            }
        }
        let mask = moving(&video, width, height);
        let on_track = (11..13).all(|y| (1..42).all(|x| mask[y * width + x]));
        let elsewhere = (0..height).filter(|y| !(8..16).contains(y));
        assert!(on_track);
        assert!(
            elsewhere
                .flat_map(|y| &mask[y * width..(y + 1) * width])
                .all(|m| !m)
        );
    }

    #[test]
    fn degenerate_videos_move_nowhere() {
        assert_eq!(moving(&[], 2, 2), [false; 4]);
        assert_eq!(moving(&[gray(2, 2, 1.0)], 2, 2), [false; 4]);
        assert!(moving(&[vec![], vec![]], 0, 0).is_empty());
        assert_eq!(
            moving(&[gray(1, 1, 0.0), gray(1, 1, f32::NAN)], 1, 1),
            [false]
        );
        assert_eq!(moving(&[gray(1, 1, 0.0), gray(1, 1, 1.0)], 1, 1), [true]);
    }
}
