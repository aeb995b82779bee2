//! Lens distortion: the OpenCV model, and its removal at load.

use std::path::Path;

use dash_kernels::Camera;

use super::image::{ImageData, accumulate};
use crate::Error;

/// Coefficients below this move no pixel that matters.
const NEGLIGIBLE: f64 = 1e-6;
/// Largest magnification by which the empty border of an undistorted image is cut off.
const MAX_ZOOM: f64 = 2.0;

/// Radial (`k`) and tangential (`p`) coefficients: with `r2 = x^2 + y^2` at unit depth,
/// `x' = x (1 + k1 r2 + k2 r2^2 + k3 r2^3 + k4 r2^4) + 2 p1 x y + p2 (r2 + 2 x^2)`, `y'` alike.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Distortion {
    pub(crate) k: [f64; 4],
    pub(crate) p: [f64; 2],
}

impl Distortion {
    pub(crate) fn is_negligible(&self) -> bool {
        self.k.iter().chain(&self.p).all(|c| c.abs() <= NEGLIGIBLE)
    }

    pub(crate) fn is_finite(&self) -> bool {
        self.k.iter().chain(&self.p).all(|c| c.is_finite())
    }

    /// Where the lens shows the direction `(x, y, 1)`.
    pub(crate) fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [k1, k2, k3, k4] = self.k;
        let [p1, p2] = self.p;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)));
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y),
        ]
    }

    /// Whether radii up to `radius` keep their order, so that no direction is seen twice.
    fn is_monotonic(&self, radius: f64) -> bool {
        let [k1, k2, k3, k4] = self.k;
        (0..=64).all(|step| {
            let r2 = (radius * f64::from(step) / 64.0).powi(2);
            1.0 + r2 * (3.0 * k1 + r2 * (5.0 * k2 + r2 * (7.0 * k3 + r2 * 9.0 * k4))) > 0.0
        })
    }

    /// The pinhole camera of the undistorted image: the same, or zoomed in just so far that every
    /// pixel lies inside the distorted image (as COLMAP's undistorter does for no blank pixels).
    /// Call it for a camera at its full size, before [`undistort`].
    ///
    /// # Errors
    /// Names `path` when the lens folds the image onto itself or needs a zoom beyond 2.
    pub(crate) fn pinhole(&self, camera: &Camera, path: &Path) -> Result<Camera, Error> {
        let refused = |found: &str| {
            Error::invalid(
                path,
                "lens distortion that can be undone over the whole image",
                format!("{found} with coefficients k {:?}, p {:?}", self.k, self.p),
                "undistort the images first (`colmap image_undistorter`)",
            )
        };
        let zoomed = |zoom: f64| Camera {
            fx: camera.fx * zoom,
            fy: camera.fy * zoom,
            ..camera.clone()
        };
        let fits = |zoom: f64| {
            let target = zoomed(zoom);
            border(camera).all(|pixel| {
                let [u, v] = self.source_pixel(camera, &target, pixel);
                (0.0..=camera.width as f64).contains(&u)
                    && (0.0..=camera.height as f64).contains(&v)
            })
        };
        let corner = [0.0, camera.width as f64]
            .map(|u| (u - camera.cx) / camera.fx)
            .into_iter()
            .flat_map(|x| [0.0, camera.height as f64].map(|v| x.hypot((v - camera.cy) / camera.fy)))
            .fold(0.0, f64::max);
        if !self.is_monotonic(corner) {
            return Err(refused("a lens that folds the image's corners back"));
        }
        if fits(1.0) {
            return Ok(camera.clone());
        }
        if !fits(MAX_ZOOM) {
            return Err(refused("a field of view that shrinks by more than half"));
        }
        let (mut too_small, mut large_enough) = (1.0, MAX_ZOOM);
        for _ in 0..30 {
            let middle = 0.5 * (too_small + large_enough);
            if fits(middle) {
                large_enough = middle;
            } else {
                too_small = middle;
            }
        }
        Ok(zoomed(large_enough))
    }

    /// The pixel of the distorted image (camera `source`) seen at `pixel` of the pinhole `target`.
    fn source_pixel(&self, source: &Camera, target: &Camera, [u, v]: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.apply([(u - target.cx) / target.fx, (v - target.cy) / target.fy]);
        [source.fx * x + source.cx, source.fy * y + source.cy]
    }
}

/// Centres of the outermost pixels.
fn border(camera: &Camera) -> impl Iterator<Item = [f64; 2]> {
    let (width, height) = (camera.width as f64, camera.height as f64);
    let rows = (0..camera.width)
        .flat_map(move |x| [[x as f64 + 0.5, 0.5], [x as f64 + 0.5, height - 0.5]]);
    let columns = (0..camera.height)
        .flat_map(move |y| [[0.5, y as f64 + 0.5], [width - 0.5, y as f64 + 0.5]]);
    rows.chain(columns)
}

/// The image that the pinhole `target` sees, sampled bilinearly from `image` as `source` saw it
/// through the lens. All three have the same size.
pub(crate) fn undistort(
    image: &ImageData,
    source: &Camera,
    distortion: &Distortion,
    target: &Camera,
) -> ImageData {
    let mut out = image.empty_like(image.width, image.height);
    let (last_x, last_y) = (image.width - 1, image.height - 1);
    for y in 0..image.height {
        for x in 0..image.width {
            let pixel = [x as f64 + 0.5, y as f64 + 0.5];
            let [u, v] = distortion.source_pixel(source, target, pixel);
            let u = (u - 0.5).clamp(0.0, last_x as f64);
            let v = (v - 0.5).clamp(0.0, last_y as f64);
            let (left, top) = (u as usize, v as usize);
            let (right, bottom) = ((left + 1).min(last_x), (top + 1).min(last_y));
            let (wx, wy) = ((u - left as f64) as f32, (v - top as f64) as f32);
            let mut value = [0.0; 4];
            accumulate(
                &mut value,
                image.premultiplied(left, top),
                (1.0 - wx) * (1.0 - wy),
            );
            accumulate(&mut value, image.premultiplied(right, top), wx * (1.0 - wy));
            accumulate(
                &mut value,
                image.premultiplied(left, bottom),
                (1.0 - wx) * wy,
            );
            accumulate(&mut value, image.premultiplied(right, bottom), wx * wy);
            out.push_premultiplied(value);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::new(60.0, 62.0, 41.0, 29.0, 80, 60)
    }

    #[test]
    fn follows_the_opencv_model() {
        let lens = Distortion {
            k: [0.1, -0.02, 0.003, 0.0],
            p: [0.01, -0.005],
        };
        // By hand: r2 = 0.25, radial = 1 + 0.025 - 0.00125 + 0.000046875 = 1.023796875.
        let [x, y] = lens.apply([0.3, 0.4]);
        assert!((x - (0.3071390625 + 0.0024 - 0.00215)).abs() < 1e-12, "{x}");
        assert!((y - (0.40951875 - 0.0012 + 0.0057)).abs() < 1e-12, "{y}");
    }

    #[test]
    fn undone_distortion_puts_points_where_the_pinhole_projects_them() {
        for lens in [
            Distortion {
                k: [0.15, 0.02, 0.0, 0.0],
                p: [0.002, -0.001],
            },
            Distortion {
                k: [-0.12, 0.01, 0.0, 0.0],
                p: [0.0; 2],
            },
        ] {
            // A smooth image of the direction itself, as the lens shows it.
            let source = camera();
            let mut image = ImageData {
                width: 80,
                height: 60,
                channels: 3,
                pixels: vec![0; 80 * 60 * 3],
                counted: None,
            };
            let shade = |[x, y]: [f64; 2]| [128.0 + 100.0 * x, 128.0 + 100.0 * y];
            for y in 0..60 {
                for x in 0..80 {
                    let seen = [
                        (x as f64 + 0.5 - source.cx) / source.fx,
                        (y as f64 + 0.5 - source.cy) / source.fy,
                    ];
                    let mut direction = seen;
                    for _ in 0..100 {
                        let [dx, dy] = lens.apply(direction);
                        direction = [direction[0] + seen[0] - dx, direction[1] + seen[1] - dy];
                    }
                    let at = (y * 80 + x) * 3;
                    for (out, v) in image.pixels[at..].iter_mut().zip(shade(direction)) {
                        *out = v.round() as u8;
                    }
                }
            }
            let target = lens.pinhole(&source, Path::new("lens")).expect("mild");
            assert_eq!(
                target.fx > source.fx,
                lens.k[0] > 0.0,
                "only pincushion needs a zoom"
            );
            let flat = undistort(&image, &source, &lens, &target);
            for y in 0..60 {
                for x in 0..80 {
                    let direction = [
                        (x as f64 + 0.5 - target.cx) / target.fx,
                        (y as f64 + 0.5 - target.cy) / target.fy,
                    ];
                    let at = (y * 80 + x) * 3;
                    for (got, expected) in flat.pixels[at..].iter().zip(shade(direction)) {
                        assert!(
                            (f64::from(*got) - expected).abs() < 2.0,
                            "({x}, {y}): {got} {expected}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn lenses_that_fold_or_swallow_the_image_are_refused() {
        for k1 in [-1.5, 40.0] {
            let lens = Distortion {
                k: [k1, 0.0, 0.0, 0.0],
                p: [0.0; 2],
            };
            let error = lens
                .pinhole(&camera(), Path::new("cameras.bin"))
                .expect_err("refused");
            assert!(error.to_string().contains("cameras.bin"), "{error}");
        }
    }
}
