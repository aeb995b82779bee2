//! Plain rasterization, every pixel over every splat, for any float type: what the fast kernels
//! are judged by.

use num_traits::Float;

use crate::splats::{self, ALPHA_MAX, ALPHA_MIN, N_COLUMNS, TRANSMITTANCE_STOP};

use super::needle::Needle;
use super::{CHANNEL_ALPHA, CHANNEL_DEPTH, N_CHANNELS};

/// The image `[H, W, 5]`.
pub fn rasterize<T: Float>(splats: &[T], size: [usize; 2], background: [T; 3]) -> Vec<T> {
    let order = depth_order(splats);
    pixels(size)
        .flat_map(|(px, py)| {
            let (contributions, transmittance) = blend(splats, &order, px, py);
            let mut out = [T::zero(); N_CHANNELS];
            for part in &contributions {
                let row = row(splats, part.splat);
                let visibility = part.alpha * part.before;
                for channel in 0..3 {
                    out[channel] = out[channel] + visibility * row[splats::RED + channel];
                }
                out[CHANNEL_DEPTH] = out[CHANNEL_DEPTH] + visibility * row[splats::DEPTH];
            }
            for channel in 0..3 {
                out[channel] = out[channel] + transmittance * background[channel];
            }
            out[CHANNEL_ALPHA] = T::one() - transmittance;
            out
        })
        .collect()
}

/// Gradient of the splats `[N, C]` from `v_image [H, W, 5]`.
pub fn rasterize_vjp<T: Float>(
    splats: &[T],
    size: [usize; 2],
    background: [T; 3],
    v_image: &[T],
) -> Vec<T> {
    let order = depth_order(splats);
    let mut v_splats = vec![T::zero(); splats.len()];
    for ((px, py), v) in pixels(size).zip(v_image.chunks_exact(N_CHANNELS)) {
        let (contributions, transmittance) = blend(splats, &order, px, py);
        // Colour and depth accumulated behind a splat, times their gradients. Behind all splats the
        // background adds colour and takes away alpha.
        let mut accumulated = (0..3).fold(-v[CHANNEL_ALPHA], |sum, channel| {
            sum + background[channel] * v[channel]
        }) * transmittance;
        for part in contributions.iter().rev() {
            let row = row(splats, part.splat);
            let v_row = &mut v_splats[part.splat * N_COLUMNS..][..N_COLUMNS];
            let visibility = part.alpha * part.before;
            let mut v_visibility = row[splats::DEPTH] * v[CHANNEL_DEPTH];
            v_row[splats::DEPTH] = v_row[splats::DEPTH] + visibility * v[CHANNEL_DEPTH];
            for (column, &v) in (splats::RED..=splats::BLUE).zip(v) {
                v_visibility = v_visibility + row[column] * v;
                v_row[column] = v_row[column] + visibility * v;
            }
            let v_alpha = part.before * v_visibility - accumulated / (T::one() - part.alpha);
            accumulated = accumulated + visibility * v_visibility;
            if part.clamped {
                continue;
            }
            let v_sigma = -part.alpha * v_alpha;
            v_row[splats::OPACITY] =
                v_row[splats::OPACITY] + v_alpha * part.alpha / row[splats::OPACITY];
            for (column, v) in exponent_vjp(row, part.place, v_sigma) {
                v_row[column] = v_row[column] + v;
            }
        }
    }
    v_splats
}

/// The smallest relative distance of any alpha from its thresholds, and of any transmittance from
/// its own, for the pixel: near zero means that rounding may decide what is drawn.
pub fn margin<T: Float>(splats: &[T], px: usize, py: usize) -> T {
    let relative = |value: T, threshold: f64| {
        let threshold = T::from(threshold).expect("every float type holds the thresholds");
        ((value - threshold) / threshold).abs()
    };
    let order = depth_order(splats);
    let mut smallest = T::infinity();
    let mut transmittance = T::one();
    for &splat in &order {
        let (sigma, _) = exponent(row(splats, splat), px, py);
        let alpha = row(splats, splat)[splats::OPACITY] * (-sigma).exp();
        smallest = smallest
            .min(relative(alpha, ALPHA_MIN))
            .min(relative(alpha, ALPHA_MAX));
        let Some((alpha, _)) = clamped_alpha(sigma, alpha) else {
            continue;
        };
        let next = transmittance * (T::one() - alpha);
        smallest = smallest.min(relative(next, TRANSMITTANCE_STOP));
        if next < T::from(TRANSMITTANCE_STOP).expect("every float type holds the thresholds") {
            break;
        }
        transmittance = next;
    }
    smallest
}

/// A splat's contribution to a pixel.
struct Contribution<T> {
    splat: usize,
    alpha: T,
    clamped: bool,
    /// Transmittance in front of the splat.
    before: T,
    /// What [`exponent`] says of the pixel's place.
    place: [T; 2],
}

fn blend<T: Float>(
    splats: &[T],
    order: &[usize],
    px: usize,
    py: usize,
) -> (Vec<Contribution<T>>, T) {
    let stop = T::from(TRANSMITTANCE_STOP).expect("every float type holds the thresholds");
    let mut contributions = Vec::new();
    let mut transmittance = T::one();
    for &splat in order {
        let row = row(splats, splat);
        let (sigma, place) = exponent(row, px, py);
        let Some((alpha, clamped)) = clamped_alpha(sigma, row[splats::OPACITY] * (-sigma).exp())
        else {
            continue;
        };
        let next = transmittance * (T::one() - alpha);
        if next < stop {
            break;
        }
        contributions.push(Contribution {
            splat,
            alpha,
            clamped,
            before: transmittance,
            place,
        });
        transmittance = next;
    }
    (contributions, transmittance)
}

/// The exponent sigma at a pixel's centre, and the offset of the splat from there: across and along of a needle.
fn exponent<T: Float>(row: &[T], px: usize, py: usize) -> (T, [T; 2]) {
    let c = |value: f64| T::from(value).expect("every float type converts from f64");
    let pixel = [c(px as f64 + 0.5), c(py as f64 + 0.5)];
    if let Some(needle) = Needle::of(row) {
        let [across, along] = needle.parts(pixel);
        let (w, z) = (needle.offset - across, needle.centre - along);
        return (
            c(0.5) * (needle.across * w * w + needle.along * z * z),
            [w, z],
        );
    }
    let dx = row[splats::MEAN_X] - pixel[0];
    let dy = row[splats::MEAN_Y] - pixel[1];
    let quadratic = row[splats::CONIC_A] * dx * dx + row[splats::CONIC_C] * dy * dy;
    (
        c(0.5) * quadratic + row[splats::CONIC_B] * dx * dy,
        [dx, dy],
    )
}

/// Gradients of the mean and the shape, with their columns.
fn exponent_vjp<T: Float>(row: &[T], [dx, dy]: [T; 2], v_sigma: T) -> [(usize, T); 5] {
    let half = T::from(0.5).expect("every float type holds a half");
    let needle = Needle::of(row);
    let (v_mean, columns) = match needle {
        Some(needle) => {
            let (v_w, v_z) = (needle.across * dx, needle.along * dy);
            let [nx, ny] = needle.normal;
            ([nx * v_w - ny * v_z, ny * v_w + nx * v_z], splats::ACROSS_X)
        }
        None => {
            let (a, b, c) = (row[2], row[3], row[4]);
            ([a * dx + b * dy, b * dx + c * dy], splats::CONIC_A)
        }
    };
    [
        (splats::MEAN_X, v_sigma * v_mean[0]),
        (splats::MEAN_Y, v_sigma * v_mean[1]),
        (columns, v_sigma * half * dx * dx),
        (columns + 1, v_sigma * dx * dy),
        (columns + 2, v_sigma * half * dy * dy),
    ]
}

/// Alpha after clamping, and whether it was clamped; `None` where the splat is skipped.
fn clamped_alpha<T: Float>(sigma: T, alpha: T) -> Option<(T, bool)> {
    let c = |value: f64| T::from(value).expect("every float type converts from f64");
    (sigma >= T::zero() && alpha >= c(ALPHA_MIN))
        .then(|| (alpha.min(c(ALPHA_MAX)), alpha > c(ALPHA_MAX)))
}

/// Drawn rows by depth, equal depths by row.
fn depth_order<T: Float>(splats: &[T]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..splats.len() / N_COLUMNS)
        .filter(|&i| {
            let row = row(splats, i);
            let radii = [row[splats::RADIUS_X], row[splats::RADIUS_Y]];
            row.iter().all(|value| value.is_finite()) && radii.iter().all(|&r| r > T::zero())
        })
        .collect();
    order.sort_by(|&a, &b| {
        let depths = [a, b].map(|i| row(splats, i)[splats::DEPTH]);
        depths[0]
            .partial_cmp(&depths[1])
            .expect("rows that are not finite were left out")
    });
    order
}

fn row<T>(splats: &[T], i: usize) -> &[T] {
    &splats[i * N_COLUMNS..(i + 1) * N_COLUMNS]
}

fn pixels([width, height]: [usize; 2]) -> impl Iterator<Item = (usize, usize)> {
    (0..height).flat_map(move |py| (0..width).map(move |px| (px, py)))
}
