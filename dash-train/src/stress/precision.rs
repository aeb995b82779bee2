//! What single precision is worst at, from Gaussians to the picture: needles and scenes far from the origin.

use std::f64::consts::TAU;

use burn::tensor::Device;
use dash_kernels::project::{Gaussians, ProjectOptions, ShSlices, View, project, sh};
use dash_kernels::rasterize::{N_CHANNELS, RasterizeOptions, rasterize};
use dash_kernels::{Camera, project as projection, rasterize as rasterization};
use rand::Rng;
use rand_pcg::Pcg64;

use super::Case;
use super::inputs::{gradient, rng, tensor, to_host, tracked, uniform, widen};
use super::measured::{Measured, relative_error, worst_of};
use super::projected::Set;
use crate::Error;

const FAMILY: &str = "precision";

/// Root mean square error of a picture's colours: 55 dB below white.
const PICTURE: f64 = 1.778e-3;
/// Relative error of a whole gradient.
const GRADIENT: f64 = 1e-3;
/// Pixels nearer than this to a threshold of drawing, relatively, have no gradient here: rounding may decide them.
const BAND: f64 = 1e-2;
const BACKGROUND: [f32; 3] = [0.25, 0.5, 0.125];
/// How far the scene is moved, world units.
const FAR: f64 = 3e4;
const N_SCENES: u64 = 200;

pub(super) const CASES: &[Case] = &[
    Case {
        family: FAMILY,
        name: "long needles",
        extreme: "400 needles, e^3 to e^7 long and e^-8 wide, at depths of 2 to 6",
        measure: |device| two_views(&long_needles(), [0.0; 3], device),
    },
    Case {
        family: FAMILY,
        name: "needles from outside",
        extreme: "400 needles that lead into the picture from up to 20 picture widths away",
        measure: |device| two_views(&needles_from_outside(), [0.0; 3], device),
    },
    Case {
        family: FAMILY,
        name: "far from the origin",
        extreme: "an ordinary scene and its cameras at 3e4",
        measure: far_from_origin,
    },
    Case {
        family: FAMILY,
        name: "random needles",
        extreme: "200 scenes of needles, axis ratios to 1e6, lengths to 65,000 px, centres up to 1e5 px away",
        measure: random_needles,
    },
];

/// Two cameras that see the same scene around (0, 0, 4) + `at`, the second one turned.
fn cameras(at: [f64; 3]) -> [Camera; 2] {
    let moved = |x: [f64; 3]| -> [f64; 3] { std::array::from_fn(|k| x[k] + at[k]) };
    [[0.0, 0.0, 0.0], [1.1, -0.7, 0.3]].map(|eye| {
        Camera::new(180.0, 180.0, 100.0, 75.0, 200, 150).look_at(
            moved(eye),
            moved([0.0, 0.0, 4.0]),
            [0.1, -1.0, 0.0],
        )
    })
}

/// The quaternion that turns x into `axis`, with any turn about it.
fn quat_along(axis: [f64; 3], rng: &mut Pcg64) -> [f32; 4] {
    let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [x, y, z] = axis.map(|value| value / length);
    // Half way between, and half a turn about the middle where they are opposite.
    let half = [1.0 + x, 0.0, -z, y];
    let half = match half.iter().map(|v| v * v).sum::<f64>() > 1e-12 {
        true => half,
        false => [0.0, 0.0, 1.0, 0.0],
    };
    let (sin, cos) = rng.random_range(0.0..0.5 * TAU).sin_cos();
    let [w, i, j, k] = half;
    [
        w * cos - i * sin,
        w * sin + i * cos,
        j * cos + k * sin,
        k * cos - j * sin,
    ]
    .map(|value| value as f32)
}

fn long_needles() -> Set {
    let mut set = Set::ordinary(81, 400, 0);
    let mut rng = rng(82);
    for scales in set.scales.chunks_exact_mut(3) {
        scales.copy_from_slice(&[rng.random_range(3.0..7.0), -8.0, -8.0]);
    }
    for mean in set.means.chunks_exact_mut(3) {
        mean[2] = rng.random_range(2.0..6.0);
    }
    set
}

/// A needle through `target` that starts at `mean`; `length` is its standard deviation, all in world units.
fn lead(
    set: &mut Set,
    row: usize,
    mean: [f64; 3],
    target: [f64; 3],
    scales: [f64; 3],
    rng: &mut Pcg64,
) {
    let axis = std::array::from_fn(|k| target[k] - mean[k]);
    for k in 0..3 {
        set.means[3 * row + k] = mean[k] as f32;
        set.scales[3 * row + k] = scales[k].ln() as f32;
    }
    set.quats[4 * row..4 * row + 4].copy_from_slice(&quat_along(axis, rng));
}

fn needles_from_outside() -> Set {
    let mut set = Set::ordinary(83, 400, 0);
    let mut rng = rng(84);
    for row in 0..set.len() {
        let z = rng.random_range(2.0..6.0);
        let target = [
            z * rng.random_range(-0.5..0.5),
            z * rng.random_range(-0.4..0.4),
            z,
        ];
        let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
        let away = z / 180.0 * 200.0 * rng.random_range(1.0..20.0);
        let mean = [target[0] + away * cos, target[1] + away * sin, z];
        lead(
            &mut set,
            row,
            mean,
            target,
            [0.7 * away, 3e-4, 3e-4],
            &mut rng,
        );
    }
    set
}

/// Needles of the hardest kinds together, seen by the first of [`cameras`].
fn hardest(seed: u64, n: usize) -> Set {
    let mut rng = rng(seed);
    let mut set = Set::ordinary(seed, n, 0);
    for row in 0..n {
        let z = rng.random_range(2.0..6.0);
        let target = [
            z * rng.random_range(-0.15..0.15),
            z * rng.random_range(-0.1..0.1),
            z,
        ];
        let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
        let away_px = 10f64.powf(rng.random_range(0.0..5.0));
        let away = z / 180.0 * away_px;
        let mean = [
            target[0] + away * cos,
            target[1] + away * sin,
            z * rng.random_range(0.9..1.1),
        ];
        // Long enough to reach the picture.
        let length_px = rng.random_range((0.3 * away_px).clamp(50.0, 6e4)..65_000.0);
        let length = z / 180.0 * length_px;
        let ratio = 10f64.powf(-rng.random_range(2.0..6.0));
        lead(
            &mut set,
            row,
            mean,
            target,
            [length, length * ratio, length * 1e-6],
            &mut rng,
        );
    }
    set
}

/// How far a device is off: the picture, and the gradients of means, quaternions, scales, opacities and colours.
struct Off {
    picture: f64,
    gradients: [(&'static str, f64); 5],
}

impl Set {
    /// The set as references take it.
    fn with_f64<R>(&self, f: impl FnOnce(&Gaussians<f64>) -> R) -> R {
        let own = [
            &self.means,
            &self.quats,
            &self.scales,
            &self.opacities,
            &self.sh_coeffs,
        ];
        let [means, quats, scales, opacities, sh_coeffs] = &own.map(|values| widen(values));
        f(&Gaussians {
            means,
            quats,
            scales,
            opacities,
            sh_coeffs: ShSlices::joined(sh_coeffs, sh::N_COEFFS[self.sh_degree]),
        })
    }
}

/// Draws the set on a device and in double precision.
fn compare(set: &Set, camera: &Camera, device: &Device) -> Result<Off, Error> {
    let (n, size) = (set.len(), [camera.width, camera.height]);
    let options = ProjectOptions::default();
    let view = View::<f64>::new(camera, &options, set.sh_degree);
    let background = BACKGROUND.map(f64::from);
    let wide = set.with_f64(|gaussians| projection::reference::project(gaussians, &view));
    let expected = rasterization::reference::rasterize(&wide, size, background);
    let mut v_image = uniform(&mut rng(85), expected.len(), -1.0, 1.0);
    for (i, v) in v_image.chunks_exact_mut(N_CHANNELS).enumerate() {
        let [width, _] = size;
        if rasterization::reference::margin(&wide, i % width, i / width) < BAND {
            v.fill(0.0);
        }
    }
    let v_wide = rasterization::reference::rasterize_vjp(&wide, size, background, &widen(&v_image));
    let v = set.with_f64(|gaussians| projection::reference::project_vjp(gaussians, &view, &v_wide));

    let means = tracked(&set.means, [n, 3], device);
    let quats = tracked(&set.quats, [n, 4], device);
    let scales = tracked(&set.scales, [n, 3], device);
    let opacities = tracked(&set.opacities, [n], device);
    let sh_coeffs = tracked(&set.sh_coeffs, [n, sh::N_COEFFS[set.sh_degree], 3], device);
    let splats = project(
        means.clone(),
        quats.clone(),
        scales.clone(),
        opacities.clone(),
        sh_coeffs.clone(),
        camera,
        &options,
    )?;
    let options = RasterizeOptions {
        width: camera.width,
        height: camera.height,
        background: BACKGROUND,
    };
    let image = rasterize(splats, &options)?;
    let got = to_host(image.clone().inner());
    let shape = [camera.height, camera.width, N_CHANNELS];
    let v_out = tensor(&v_image, shape, &device.clone().autodiff());
    let all = (image * v_out).sum().backward();
    let (v_sh_coeffs, off) = (v.v_sh_coeffs(), relative_error);
    Ok(Off {
        picture: colours_apart(&got, &expected),
        gradients: [
            ("means", off(&gradient(&means, &all), &v.v_means)),
            ("quats", off(&gradient(&quats, &all), &v.v_quats)),
            ("scales", off(&gradient(&scales, &all), &v.v_scales)),
            (
                "opacities",
                off(&gradient(&opacities, &all), &v.v_opacities),
            ),
            ("sh_coeffs", off(&gradient(&sh_coeffs, &all), &v_sh_coeffs)),
        ],
    })
}

/// Root mean square difference of the colours of two pictures.
fn colours_apart(got: &[f32], expected: &[f64]) -> f64 {
    let pixels = got
        .chunks_exact(N_CHANNELS)
        .zip(expected.chunks_exact(N_CHANNELS));
    let squares = pixels.flat_map(|(got, expected)| {
        (0..3).map(|channel| (f64::from(got[channel]) - expected[channel]).powi(2))
    });
    (squares.sum::<f64>() / (got.len() / N_CHANNELS * 3) as f64).sqrt()
}

/// The worst of several pictures.
fn judge(all: &[Off]) -> Measured {
    let mut measured = Measured::default();
    measured.judge(
        "picture",
        worst_of(all.iter().map(|off| off.picture)),
        PICTURE,
    );
    for (k, (name, _)) in all[0].gradients.iter().enumerate() {
        let worst = worst_of(all.iter().map(|off| off.gradients[k].1));
        measured.judge(format!("gradient of {name}"), worst, GRADIENT);
    }
    measured
}

fn two_views(set: &Set, at: [f64; 3], device: &Device) -> Result<Measured, Error> {
    let views = cameras(at).map(|camera| compare(set, &camera, device));
    let views: Result<Vec<Off>, Error> = views.into_iter().collect();
    Ok(judge(&views?))
}

fn far_from_origin(device: &Device) -> Result<Measured, Error> {
    let mut set = Set::ordinary(86, 400, 1);
    let at = [FAR, -FAR, 0.5 * FAR];
    for mean in set.means.chunks_exact_mut(3) {
        for (x, by) in mean.iter_mut().zip(at) {
            *x = (f64::from(*x) + by) as f32;
        }
    }
    two_views(&set, at, device)
}

fn random_needles(device: &Device) -> Result<Measured, Error> {
    let camera = Camera::new(180.0, 180.0, 24.0, 16.0, 48, 32);
    let scenes = (0..N_SCENES).map(|seed| compare(&hardest(1000 + seed, 24), &camera, device));
    Ok(judge(&scenes.collect::<Result<Vec<Off>, Error>>()?))
}
