//! Static Gaussians under which an error moves with time become dynamic.

use burn::tensor::{Tensor, TensorData};
use dash_kernels::splats::{DEPTH, N_COLUMNS, RED};
use dash_model::{Gaussians, SpaceBox};

use super::split::keep_static;
use super::statistics::{splat_gradient, spread};
use super::trainer::{DYNAMIC, Trainer};
use crate::Error as TrainError;
use crate::dataset::View;

/// Views that are asked what error each static Gaussian sees.
const VIEWS: usize = 64;
/// Pixels' worth of a Gaussian that such a view must show.
const MIN_SHARE: f64 = 0.1;
/// Views that must.
const MIN_VIEWS: usize = 8;
/// Standard deviations by which errors at neighbouring times must be more alike than in random order.
const MIN_Z: f64 = 3.5;

/// What a view says of a Gaussian: its error in RGB, truth less picture weighted as the Gaussian is blended,
/// and the sum of these weights.
type Error = [f64; 4];

/// Moves static Gaussians within the field's box to the dynamic part, if there is one, at rest where they are.
pub(crate) fn promote(trainer: &mut Trainer) -> Result<(), TrainError> {
    let floor = f64::from(trainer.config.decomposition.promote_floor);
    let space = match &trainer.scene.dynamic {
        Some(dynamic) if floor > 0.0 && !dynamic.gaussians.is_empty() => *dynamic.field.space(),
        _ => return Ok(()),
    };
    let rows = trainer.scene.static_set.to_rows();
    let errors = errors(trainer)?;
    let (leave, stay): (Vec<usize>, Vec<usize>) = (0..rows.len()).partition(|&row| {
        let of_row: Vec<Error> = errors.iter().map(|view| view[row]).collect();
        is_within(&space, rows.means[row]) && follows_time(&of_row, floor)
    });
    if leave.is_empty() {
        return Ok(());
    }
    let mut more = rows.gather(&leave);
    if let Some(dynamic) = &mut trainer.scene.dynamic {
        let n_dynamic = dynamic.gaussians.len();
        let mut all = dynamic.gaussians.to_rows();
        more.trajectory_width = all.trajectory_width;
        more.trajectories = vec![0.0; leave.len() * all.trajectory_width];
        more.embedding_width = all.embedding_width;
        more.embeddings = vec![0.0; leave.len() * all.embedding_width];
        all.append(&more);
        dynamic.gaussians = Gaussians::from_rows(&all, &trainer.device);
        trainer
            .optimizer
            .extend_rows(DYNAMIC, n_dynamic, leave.len());
        trainer.density_dynamic.grow(leave.len());
    }
    keep_static(trainer, &stay);
    tracing::debug!("{} static Gaussians became dynamic", leave.len());
    Ok(())
}

fn is_within(space: &SpaceBox, mean: [f32; 3]) -> bool {
    (0..3).all(|axis| (space.min[axis]..=space.max[axis]).contains(&mean[axis]))
}

/// For each of some views, in the order of their times, the error of each static Gaussian.
fn errors(trainer: &Trainer) -> Result<Vec<Vec<Error>>, TrainError> {
    let (n_static, _) = trainer.scene.counts();
    let mut views: Vec<&View> = spread(trainer, VIEWS).collect();
    views.sort_by(|a, b| a.time.total_cmp(&b.time));
    let of_view = |view: &View| -> Result<Vec<Error>, TrainError> {
        let (truth, counted) = view.rgb_and_counted(trainer.scene.settings.background)?;
        let tensor = |values: Vec<f32>, channels: usize| {
            let shape = [view.camera.height, view.camera.width, channels];
            Tensor::<3>::from_data(TensorData::new(values, shape), &trainer.device)
        };
        // Colours and depth of a splat enter a pixel with its weight: the gradients of these sums.
        let gradient = splat_gradient(trainer, view, |image| {
            let rgb = image.clone().narrow(2, 0, 3);
            let mut error = tensor(truth, 3) - rgb.clone().detach();
            if let Some(counted) = counted {
                error = error * tensor(counted, 1);
            }
            (rgb * error).sum() + image.narrow(2, 4, 1).sum()
        })?;
        let mut errors = vec![[0.0; 4]; n_static];
        for (error, splat) in errors.iter_mut().zip(gradient.chunks_exact(N_COLUMNS)) {
            let [red, green, blue] = [0, 1, 2].map(|c| f64::from(splat[RED + c]));
            *error = [red, green, blue, splat[DEPTH].into()];
        }
        Ok(errors)
    };
    views.into_iter().map(of_view).collect()
}

/// Whether errors under a Gaussian, in the order of time, are alike at neighbouring times, and by at least
/// `floor`, root mean square of a channel's range. What is wrong by the camera, not by the time, is not.
fn follows_time(errors: &[Error], floor: f64) -> bool {
    let seen = || errors.iter().filter(|error| error[3] >= MIN_SHARE);
    let n = seen().count();
    if n < MIN_VIEWS {
        return false;
    }
    let weight: f64 = seen().map(|error| error[3]).sum();
    let mean: [f64; 3] = [0, 1, 2].map(|c| seen().map(|error| error[c]).sum::<f64>() / weight);
    let left: Vec<[f64; 3]> = seen()
        .map(|error| [0, 1, 2].map(|c| error[c] / error[3] - mean[c]))
        .collect();
    let product = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|c| a[c] * b[c]).sum::<f64>();
    let squares: f64 = left.iter().map(|d| product(d, d)).sum();
    let pairs: f64 = left.windows(2).map(|d| product(&d[0], &d[1])).sum();
    // In random order the sum of products is about 0, and its standard deviation at most this.
    let chance = squares / (n as f64).sqrt();
    pairs >= MIN_Z * chance && pairs / (3 * (n - 1)) as f64 >= floor * floor
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;
    use std::sync::Arc;

    use burn::tensor::Device;
    use dash_kernels::Camera;
    use dash_model::{DeformationField, DynamicPart, GaussianRows};
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;
    use crate::dataset::{Dataset, Layout};
    use crate::train::density::DensityStatistics;
    use crate::train::{Preset, TrainConfig};

    /// Four cameras side by side, eight times; what they see on the right turns from black to white.
    fn dataset() -> Dataset {
        const SIDE: usize = 24;
        let views = (0..32).map(|index| {
            let (camera, frame) = (index % 4, index / 4);
            let eye = [0.1 * camera as f64 - 0.15, 0.0, -4.0];
            let seen = Camera::new(24.0, 24.0, 12.0, 12.0, SIDE, SIDE).look_at(
                eye,
                [0.0; 3],
                [0.0, -1.0, 0.0],
            );
            let right = if frame < 4 { 0 } else { 255 };
            let shade = |pixel: usize| if pixel % SIDE < SIDE / 2 { 128 } else { right };
            let pixels = (0..SIDE * SIDE)
                .flat_map(|pixel| [shade(pixel); 3])
                .collect();
            View {
                camera_index: camera,
                ..View::from_rgb8("made", seen, frame as f32 / 7.0, pixels)
            }
        });
        Dataset {
            name: "made".into(),
            root: PathBuf::new(),
            layout: Layout::Blender,
            n_frames: 8,
            n_cameras: 4,
            stated_span: None,
            views: views.collect(),
            points: None,
            background: None,
        }
    }

    #[test]
    fn what_changes_becomes_dynamic_and_what_is_alike_at_all_times_stays() {
        let mut config = TrainConfig::preset(Preset::Quick);
        for assignment in ["min_initial_points=50", "decomposition.promote_floor=0.03"] {
            config.set(assignment).expect("a known key");
        }
        let device = Device::flex();
        let mut trainer = Trainer::new(config, Arc::new(dataset()), &device).expect("valid");
        let camera = trainer.dataset.views[0].camera.clone();
        // The side that a picture shows on its left.
        let left = if camera.transform([1.0, 0.0, 0.0])[0] < 0.0 {
            1.0
        } else {
            -1.0
        };
        let of = |places: &[[f32; 3]]| {
            let mut rows = GaussianRows::from_points(places, &vec![[0.5; 3]; places.len()], 0, 0.2);
            rows.log_scales.fill([0.2f32.ln(); 3]);
            Gaussians::from_rows(&rows, &device.clone().autodiff())
        };
        let deformation = &trainer.config.field.deformation;
        let mut rng = Pcg64::seed_from_u64(4);
        let field =
            DeformationField::new(deformation, SpaceBox::fixed(1.2), &mut rng, &trainer.device);
        // The last is as wrong as the second, but outside of what the field covers.
        trainer.scene.static_set = of(&[[left, 0.0, 0.0], [-left, 0.0, 0.0], [-left, 0.0, 1.5]]);
        trainer.scene.dynamic = Some(DynamicPart {
            gaussians: of(&[[0.0, 0.8, 0.0]]),
            field: field.expect("valid"),
        });
        trainer.density_static = DensityStatistics::new(3);
        trainer.density_dynamic = DensityStatistics::new(1);
        trainer.step().expect("trains");
        let places = |set: &Gaussians| -> Vec<f32> {
            set.to_rows()
                .means
                .iter()
                .map(|mean| (4.0 * mean[0]).round() / 4.0)
                .collect()
        };
        promote(&mut trainer).expect("renders");
        assert_eq!(places(&trainer.scene.static_set), [left, -left]);
        let dynamic = trainer.scene.dynamic.as_ref().expect("kept");
        assert_eq!(places(&dynamic.gaussians), [0.0, -left]);
        trainer.step().expect("goes on");
        trainer.config.decomposition.promote_floor = 0.0;
        let before = trainer.scene.counts();
        promote(&mut trainer).expect("nothing to do");
        assert_eq!(trainer.scene.counts(), before);
    }

    fn of(n: usize, error: impl Fn(usize) -> f64) -> Vec<Error> {
        (0..n)
            .map(|k| [error(k) * 2.0, 0.0, error(k), 2.0])
            .collect()
    }

    #[test]
    fn an_error_that_comes_and_goes_follows_time_and_one_of_cameras_or_noise_does_not() {
        let passing = |k: usize| if (20..30).contains(&k) { 0.3 } else { 0.0 };
        assert!(follows_time(&of(64, passing), 0.03));
        assert!(!follows_time(&of(64, passing), 0.3), "too small");
        assert!(!follows_time(&of(64, |_| 0.3), 0.03), "always the same");
        assert!(!follows_time(&of(6, |k| k as f64), 0.03), "too few views");
        let of_camera = |k: usize| [0.3, -0.2, 0.0, 0.1, -0.3][k % 5];
        assert!(!follows_time(&of(64, of_camera), 0.03));
        let hidden: Vec<Error> = of(64, passing)
            .into_iter()
            .map(|[r, g, b, _]| [r, g, b, 0.01])
            .collect();
        assert!(!follows_time(&hidden, 0.03), "hardly shown");
        let mut rng = Pcg64::seed_from_u64(1);
        let by_chance = (0..1000).filter(|_| {
            let noise: Vec<f64> = (0..64).map(|_| rng.random_range(-0.5..0.5)).collect();
            follows_time(&of(64, |k| noise[k]), 0.03)
        });
        assert!(by_chance.count() <= 3);
    }
}
