//! What a step is trained on.

use dash_kernels::Camera;

use crate::dataset::{DatasetError, View};

/// Shortest side of a picture that was made smaller, pixels: not much more than SSIM's window of 11.
const SHORTEST_SIDE: usize = 16;

/// More than any share of n x n pixels but all of them.
const ALL: f32 = 0.9999;

/// A view's picture, or a smaller one of it.
pub(crate) struct Target {
    pub(super) camera: Camera,
    pub(super) time: f32,
    /// `[H * W * 3]` in [0, 1].
    pub(super) rgb: Vec<f32>,
    /// `[H * W]` of 1 and 0: which pixels count; `None` where all do.
    pub(super) counted: Option<Vec<f32>>,
}

impl Target {
    /// A view over `background`, `times` smaller in width and height, as far as that leaves a picture.
    pub(super) fn of(
        view: &View,
        background: [f32; 3],
        times: usize,
    ) -> Result<Self, DatasetError> {
        let camera = &view.camera;
        let (rgb, counted) = view.rgb_and_counted(background)?;
        let most = camera.width.min(camera.height) / SHORTEST_SIDE;
        let n = times.min(most).max(1);
        if n == 1 {
            return Ok(Self {
                camera: camera.clone(),
                time: view.time,
                rgb,
                counted,
            });
        }
        let counted = counted.map(|counted| {
            let shares = pooled::<1>(&counted, camera.width, n);
            // A pixel counts when all of it does.
            let counts = |share: &f32| f32::from(u8::from(*share > ALL));
            shares.iter().map(counts).collect()
        });
        Ok(Self {
            camera: smaller(camera, n),
            time: view.time,
            rgb: pooled::<3>(&rgb, camera.width, n),
            counted,
        })
    }
}

/// A camera with pixels of n x n of its own. The last columns and rows, fewer than n, are left out.
fn smaller(camera: &Camera, n: usize) -> Camera {
    let by = 1.0 / n as f64;
    Camera {
        fx: camera.fx * by,
        fy: camera.fy * by,
        cx: camera.cx * by,
        cy: camera.cy * by,
        width: camera.width / n,
        height: camera.height / n,
        ..camera.clone()
    }
}

/// Means over n x n pixels of a picture `[H, W, C]`, without the last columns and rows where n does not divide
/// its sides.
fn pooled<const C: usize>(values: &[f32], width: usize, n: usize) -> Vec<f32> {
    let columns = width / n;
    let share = 1.0 / (n * n) as f32;
    let mut out = Vec::with_capacity(values.len() / (n * n));
    let mut sums = vec![[0.0f32; C]; columns];
    for rows in values.chunks_exact(width * C * n) {
        sums.fill([0.0; C]);
        for row in rows.chunks_exact(width * C) {
            for (sum, pixels) in sums.iter_mut().zip(row.chunks_exact(C * n)) {
                for pixel in pixels.chunks_exact(C) {
                    for (sum, value) in sum.iter_mut().zip(pixel) {
                        *sum += value;
                    }
                }
            }
        }
        out.extend(sums.iter().flatten().map(|sum| sum * share));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values that tell where they come from.
    fn view(width: usize, height: usize) -> View {
        let camera = Camera::new(40.0, 44.0, 21.0, 15.0, width, height);
        let pixels = (0..width * height * 3).map(|i| (i * 7 % 251) as u8);
        View::from_rgb8("made", camera, 0.5, pixels.collect())
    }

    #[test]
    fn a_smaller_picture_has_the_means_and_a_camera_that_sees_the_same() {
        let (width, height, n) = (50, 34, 3);
        let view = view(width, height);
        let all = Target::of(&view, [0.0; 3], 1).expect("in memory");
        assert_eq!((all.camera.clone(), all.time), (view.camera.clone(), 0.5));
        let small = Target::of(&view, [0.0; 3], 2).expect("in memory");
        assert_eq!((small.camera.width, small.camera.height), (25, 17));
        // Three times smaller would leave fewer than 16 rows.
        let no_smaller = Target::of(&view, [0.0; 3], n).expect("in memory");
        assert_eq!(no_smaller.camera, small.camera);
        for (x, y, c) in [(0, 0, 0), (24, 16, 2), (7, 11, 1)] {
            let at = |x: usize, y: usize| all.rgb[(y * width + x) * 3 + c];
            let pixels = [(0, 0), (1, 0), (0, 1), (1, 1)];
            let mean = pixels
                .map(|(i, j)| at(2 * x + i, 2 * y + j))
                .iter()
                .sum::<f32>()
                / 4.0;
            assert!((small.rgb[(y * 25 + x) * 3 + c] - mean).abs() < 1e-6);
        }
        let point = [0.1, -0.2, 2.0];
        let (large, tiny) = (all.camera.project(point), small.camera.project(point));
        let (Some(([u, v], _)), Some(([s, t], _))) = (large, tiny) else {
            panic!("before the camera");
        };
        assert!((u / 2.0 - s).abs() < 1e-12 && (v / 2.0 - t).abs() < 1e-12);
    }

    #[test]
    fn columns_and_rows_that_fill_no_pixel_are_left_out() {
        // 5 x 3 pixels of their own numbers.
        let values: Vec<f32> = (0..15).map(|i| i as f32).collect();
        assert_eq!(pooled::<1>(&values, 5, 2), [3.0, 5.0]);
        let camera = smaller(&view(5, 3).camera, 2);
        assert_eq!((camera.width, camera.height), (2, 1));
    }

    #[test]
    fn all_of_a_pixel_is_more_than_nearly_all_of_it() {
        for n in [2, 3, 7, 64] {
            let mut counted = vec![1.0f32; n * n];
            assert!(pooled::<1>(&counted, n, n)[0] > ALL, "{n}");
            counted[n] = 0.0;
            assert!(pooled::<1>(&counted, n, n)[0] < ALL, "{n}");
        }
    }

    #[test]
    fn pictures_too_small_to_be_made_smaller_stay_as_they_are() {
        let target = Target::of(&view(40, 24), [0.0; 3], 4).expect("in memory");
        assert_eq!((target.camera.width, target.rgb.len()), (40, 40 * 24 * 3));
    }
}
