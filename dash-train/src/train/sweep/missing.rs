//! Points where pictures show what the scene as trained so far does not.

use dash_kernels::Camera;
use rand::Rng;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::{DRAWS_PER_POINT, MAX_SIDE, Picture, Sweep, difference, smoothed, witnesses};
use crate::TrainError;
use crate::cameras::focus_point;
use crate::dataset::View;

/// Mean error of a pixel's channels from which on something is missing there.
const MIN_ERROR: f32 = 0.06;
/// Part of that error by which the errors of other views may differ from it.
const MAX_DISAGREEMENT: f32 = 0.5;

/// A point that is missing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Missing {
    /// World units.
    pub(crate) position: [f32; 3],
    /// What a picture shows there, in [0, 1].
    pub(crate) color: [f32; 3],
    /// How wide a pixel of that picture is there, world units.
    pub(crate) width: f32,
}

/// At most `n` points, at least `near` before the camera of the view that shows them. Pixels are drawn by how wrong
/// they are, and each point is looked for at the depth where other views lack the same: the colour that is missing
/// is compared, not the colour, so that a bright lamp does not match what is bright and already there.
///
/// `render` draws the scene for a camera and a time, `[H * W * 3]`.
///
/// # Errors
/// When an image can't be read, or rendering fails.
pub(crate) fn missing_points(
    views: &[&View],
    background: [f32; 3],
    n: usize,
    near: f64,
    rng: &mut Pcg64,
    mut render: impl FnMut(&Camera, f32) -> Result<Vec<f32>, TrainError>,
) -> Result<Vec<Missing>, TrainError> {
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera.clone()).collect();
    let mut pictures = Vec::with_capacity(views.len());
    let mut shown = Vec::with_capacity(views.len());
    let mut pixels = Vec::new();
    for (index, view) in views.iter().enumerate() {
        let small = view.at_most(MAX_SIDE, background)?;
        let rendered = render(&small.camera, view.time)?;
        let pairs = small.rgb.iter().zip(&rendered);
        let mut errors: Vec<f32> = pairs.map(|(shown, drawn)| shown - drawn).collect();
        if let Some(counted) = &small.counted {
            let pixels = errors.chunks_exact_mut(3).zip(counted);
            for (error, _) in pixels.filter(|(_, counts)| **counts == 0) {
                error.fill(0.0);
            }
        }
        let smooth = smoothed(&errors, &small.camera);
        let wrong = errors.chunks_exact(3).zip(&smooth).enumerate();
        pixels.extend(wrong.filter_map(|(pixel, (error, &around))| {
            // What lies beside what is missing is as wrong only once it is smoothed.
            let size = size([error[0], error[1], error[2]]).min(size(around));
            (size > MIN_ERROR && size.is_finite()).then_some((index, pixel, size))
        }));
        pictures.push(Picture {
            colors: smooth,
            camera: small.camera,
            alpha: None,
            witnesses: witnesses(&cameras, index),
        });
        shown.push(small.rgb);
    }
    let sweep = Sweep {
        pictures,
        focus: focus_point(&cameras).into(),
    };
    let found = drawn(&pixels, DRAWS_PER_POINT * n, rng)
        .into_par_iter()
        .filter_map(|(index, pixel)| {
            let Picture { camera, colors, .. } = &sweep.pictures[index];
            let (x, y) = (pixel % camera.width, pixel / camera.width);
            let (disagreement, point) = sweep.best(index, x, y)?;
            let depth = camera.transform(point.to_array())[2];
            let agrees = disagreement <= MAX_DISAGREEMENT * size(colors[pixel]);
            (agrees && depth >= near).then(|| Missing {
                position: point.as_vec3().to_array(),
                color: std::array::from_fn(|c| shown[index][3 * pixel + c]),
                width: (depth / camera.fx) as f32,
            })
        })
        .collect::<Vec<_>>();
    Ok(found.into_iter().take(n).collect())
}

/// Some of the pixels, each a picture's index, a pixel's, and how wrong it is, which is how likely it is drawn: as many as
/// there are, `most` at most.
fn drawn(pixels: &[(usize, usize, f32)], most: usize, rng: &mut Pcg64) -> Vec<(usize, usize)> {
    let mut sum = 0.0;
    let sums: Vec<f64> = pixels
        .iter()
        .map(|&(_, _, size)| {
            sum += f64::from(size);
            sum
        })
        .collect();
    let draw = |_| {
        let at = rng.random_range(0.0..sum);
        let (index, pixel, _) = pixels[sums.partition_point(|&s| s <= at).min(sums.len() - 1)];
        (index, pixel)
    };
    (0..most.min(pixels.len())).map(draw).collect()
}

/// Mean of the channels' sizes.
fn size(error: [f32; 3]) -> f32 {
    difference(error, [0.0; 3])
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    const LAMP: [f64; 3] = [0.4, -0.2, 0.5];
    const SIDE: usize = 40;

    /// A lamp in the dark, three pixels wide, seen from four units away.
    fn views() -> Vec<View> {
        let eyes = [-0.9, -0.3, 0.3, 0.9].map(|x| [x, 0.3 * x, -4.0]);
        let of_eye = |eye: [f64; 3]| {
            let camera = Camera::new(40.0, 40.0, 20.0, 20.0, SIDE, SIDE);
            let camera = camera.look_at(eye, [0.0; 3], [0.0, -1.0, 0.0]);
            let [u, v] = camera.project_inside(LAMP).expect("in sight").0;
            let is_lit = |k: usize| {
                let (x, y) = ((k % SIDE) as f64 + 0.5, (k / SIDE) as f64 + 0.5);
                (x - u).abs() < 1.5 && (y - v).abs() < 1.5
            };
            let shade = |k| if is_lit(k) { [250, 240, 200] } else { [5; 3] };
            let pixels = (0..SIDE * SIDE).flat_map(shade).collect();
            View::from_rgb8("dark", camera, 0.0, pixels)
        };
        eyes.map(of_eye).into()
    }

    fn found(near: f64, render: impl FnMut(&Camera, f32) -> Vec<f32>) -> Vec<Missing> {
        let (views, mut render) = (views(), render);
        let views: Vec<&View> = views.iter().collect();
        let mut rng = Pcg64::seed_from_u64(1);
        let drawn = |camera: &Camera, time| Ok(render(camera, time));
        missing_points(&views, [0.0; 3], 10, near, &mut rng, drawn).expect("in memory")
    }

    #[test]
    fn a_lamp_that_nothing_stands_for_is_found_where_it_is() {
        let dark = |_: &Camera, _: f32| vec![5.0 / 255.0; SIDE * SIDE * 3];
        let points = found(0.5, dark);
        assert_eq!(points.len(), 10);
        for point in &points {
            let off = |axis: usize| (f64::from(point.position[axis]) - LAMP[axis]).abs();
            // A pixel is a tenth of a unit, and in a view 0.6 aside it is 0.7 units of depth; of depths that do alike
            // the farthest is taken.
            assert!(off(0).max(off(1)) < 0.3 && off(2) < 1.4, "{point:?}");
            assert!((0.08..0.15).contains(&point.width), "{point:?}");
        }
        let is_bright = |point: &Missing| point.color[0] > 0.9;
        assert!(points.iter().all(is_bright), "{points:?}");
        assert!(found(6.0, dark).is_empty(), "nearer than what is drawn");
    }

    #[test]
    fn nothing_is_missing_where_all_is_shown() {
        let views = views();
        let mut shown = views
            .iter()
            .map(|view| view.rgb([0.0; 3]).expect("in memory"));
        assert!(found(0.5, |_, _| shown.next().expect("one a view")).is_empty());
    }

    #[test]
    fn what_one_view_alone_lacks_is_nowhere() {
        // All views but the first are drawn as they are.
        let views = views();
        let mut shown: Vec<Vec<f32>> = views
            .iter()
            .map(|view| view.rgb([0.0; 3]).expect("in memory"))
            .collect();
        shown[0].fill(5.0 / 255.0);
        let mut shown = shown.into_iter();
        assert!(found(0.5, |_, _| shown.next().expect("one a view")).is_empty());
    }
}
