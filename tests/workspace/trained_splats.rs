//! Whole pictures of the kernels in single precision against the double-precision references: of a trained
//! 3DGS scene from the test data, and of a random scene. Both pass through the PLY reader.

use std::path::PathBuf;

use crate::common::test_data;
use dash_kernels::project::{self, ProjectOptions, View};
use dash_kernels::rasterize::{self, N_CHANNELS};
use dash_kernels::splats::NEAR_PLANE;
use dash_kernels::splats::{MEAN_Y, N_COLUMNS};
use dash_kernels::testing::{finite_values, named_devices, to_f64};
use dash_model::{
    Camera, DynamicScene, Gaps, GaussianRows, Gaussians, OffsetPlacement, SceneSettings,
    TrajectoryBasis, read_splat_ply, write_splat_ply,
};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// Smallest PSNR against the reference, dB. The random scene has 132; the trained one 114, for the
/// few pixels in which rounding decides whether a splat reaches 1/255 or a pixel is finished.
const BOUND_DB: f64 = 90.0;

/// A pixel is off when a channel differs by more than this, a fortieth of an 8-bit step.
const OFF: f64 = 1e-4;

/// Largest share of pixels that are off, all of them of that kind (gsplat allows as many).
const OFF_SHARE: f64 = 1e-3;

/// Added to the log scales by the negative control: Gaussians a thousandth too large.
const SCALE_ERROR: f32 = 1e-3;

const BACKGROUND: [f32; 3] = [0.1, 0.2, 0.3];
const SH_DEGREE: usize = 3;

/// How far a picture is from the reference's.
struct Deviation {
    /// Of RGB in [0, 1], dB.
    psnr: f64,
    /// Share of the pixels with a channel off by more than [`OFF`].
    off: f64,
    largest: f64,
}

fn rendered(rows: &GaussianRows, camera: &Camera, device: &burn::tensor::Device) -> Vec<f32> {
    let scene = DynamicScene {
        static_set: Gaussians::from_rows(rows, device),
        dynamic: None,
        settings: SceneSettings {
            background: BACKGROUND,
            sh_degree: SH_DEGREE,
            near_plane: NEAR_PLANE,
            trajectory_basis: TrajectoryBasis::Linear,
            offsets: OffsetPlacement::BeforeActivation,
            gaps: Gaps::default(),
        },
    };
    finite_values(scene.render(camera, 0.0).expect("renders").rgb())
}

/// RGB of the references in double precision.
fn reference(rows: &GaussianRows, camera: &Camera) -> Vec<f64> {
    /// Rows of pixels that one task draws.
    const STRIP: usize = 8;
    let n_coeffs = rows.sh_rest_width / 3 + 1;
    let (dc, rest) = (to_f64(rows.sh_dc.as_flattened()), to_f64(&rows.sh_rest));
    let gaussians = project::Gaussians {
        means: &to_f64(rows.means.as_flattened()),
        quats: &to_f64(rows.quats.as_flattened()),
        scales: &to_f64(rows.log_scales.as_flattened()),
        opacities: &to_f64(&rows.opacity_logits),
        sh_coeffs: project::ShSlices::apart(&dc, &rest, n_coeffs),
    };
    let view = View::<f64>::new(camera, &ProjectOptions::default(), SH_DEGREE);
    let splats = project::reference::project(&gaussians, &view);
    let strips: Vec<Vec<f64>> = (0..camera.height)
        .into_par_iter()
        .step_by(STRIP)
        .map(|top| {
            let mut shifted = splats.clone();
            for row in shifted.chunks_exact_mut(N_COLUMNS) {
                row[MEAN_Y] -= top as f64;
            }
            let size = [camera.width, STRIP.min(camera.height - top)];
            rasterize::reference::rasterize(&shifted, size, BACKGROUND.map(f64::from))
        })
        .collect();
    strips
        .concat()
        .chunks_exact(N_CHANNELS)
        .flat_map(|pixel| [pixel[0], pixel[1], pixel[2]])
        .collect()
}

fn deviation(got: &[f32], expected: &[f64]) -> Deviation {
    assert_eq!(got.len(), expected.len(), "picture sizes");
    let differences: Vec<f64> = to_f64(got)
        .iter()
        .zip(expected)
        .map(|(got, expected)| (got - expected).abs())
        .collect();
    let squares: f64 = differences.iter().map(|d| d * d).sum();
    let off = differences
        .chunks_exact(3)
        .filter(|pixel| pixel.iter().any(|&d| d > OFF))
        .count();
    Deviation {
        psnr: -10.0 * (squares / differences.len() as f64).log10(),
        off: off as f64 / (differences.len() / 3) as f64,
        largest: differences.iter().copied().fold(0.0, f64::max),
    }
}

/// Checks a scene on every backend, and that a slightly wrong one does not pass.
#[track_caller]
fn assert_close_to_the_reference(name: &str, rows: &GaussianRows, camera: &Camera) {
    let expected = reference(rows, camera);
    let contrast = deviation(&vec![0.5; expected.len()], &expected).psnr;
    assert!(
        contrast < 25.0,
        "{name}: the picture is nearly uniform, {contrast:.1} dB from grey"
    );
    for (backend, device) in named_devices() {
        let Deviation { psnr, off, largest } =
            deviation(&rendered(rows, camera, &device), &expected);
        let found = format!(
            "{name} on {backend}: {psnr:.1} dB, {:.4} % of the pixels off by more than {OFF}, the \
             worst by {largest:.1e}",
            100.0 * off
        );
        eprintln!("{found}");
        assert!(psnr >= BOUND_DB && off <= OFF_SHARE, "{found}");

        let mut wrong = rows.clone();
        for scale in wrong.log_scales.as_flattened_mut() {
            *scale += SCALE_ERROR;
        }
        let control = deviation(&rendered(&wrong, camera, &device), &expected);
        assert!(
            control.psnr < BOUND_DB && control.off > OFF_SHARE,
            "{name} on {backend}: log scales {SCALE_ERROR} too large pass with {:.1} dB, {} off",
            control.psnr,
            control.off
        );
    }
}

#[test]
fn a_trained_scene() {
    let Some(path) = test_data("splat_ply/trained_9080.ply") else {
        return;
    };
    let rows = read_splat_ply(&path).expect("a sound file").rows;
    assert_eq!((rows.len(), rows.sh_rest_width), (9080, 45));
    // A room in the axes of COLMAP, y downwards, seen from within along z.
    let camera = Camera::new(280.0, 280.0, 160.0, 120.0, 320, 240).look_at(
        [0.0, 0.0, 0.0],
        [21.0, -26.0, 400.0],
        [0.0, -1.0, 0.0],
    );
    assert_close_to_the_reference("trained scene", &rows, &camera);
}

#[test]
fn a_random_scene() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path: PathBuf = folder.path().join("random.ply");
    let written = random(2000);
    write_splat_ply(&path, &written, NEAR_PLANE).expect("writes");
    let rows = read_splat_ply(&path).expect("reads").rows;
    assert_eq!(rows, written, "the file holds every bit");
    let camera = Camera::new(150.0, 155.0, 83.0, 58.0, 160, 121).look_at(
        [0.3, -0.2, -4.0],
        [0.0; 3],
        [0.1, -1.0, 0.0],
    );
    assert_close_to_the_reference("random scene", &rows, &camera);
}

/// Gaussians of all shapes and opacities around the origin, their colours depending on the view.
fn random(n: usize) -> GaussianRows {
    let mut rng = Pcg64::seed_from_u64(5);
    let mut triples = |low: f32, high: f32| -> Vec<[f32; 3]> {
        (0..n)
            .map(|_| std::array::from_fn(|_| rng.random_range(low..high)))
            .collect()
    };
    let mut rows =
        GaussianRows::from_points(&triples(-2.0, 2.0), &triples(0.0, 1.0), SH_DEGREE, 0.1);
    rows.log_scales = triples(-5.0, -1.5);
    for quat in &mut rows.quats {
        *quat = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
    }
    rows.opacity_logits
        .fill_with(|| rng.random_range(-4.0..4.0));
    rows.sh_rest.fill_with(|| rng.random_range(-0.15..0.15));
    rows
}
