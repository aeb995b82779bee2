use burn::tensor::Device;
use dash_kernels::Camera;
use rand::{Rng, SeedableRng};

use super::axes::HalfTurn;
use super::*;
use crate::{DynamicScene, Gaussians, Picture, SceneSettings};

/// Gaussians before a camera at the origin, with colours that depend on direction.
fn random_rows(n: usize, sh_degree: usize) -> GaussianRows {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
    let mut triple = |low: f32, high: f32| [(); 3].map(|()| rng.random_range(low..high));
    let points: Vec<[f32; 3]> = (0..n)
        .map(|_| {
            let [x, y, z] = triple(-1.0, 1.0);
            [x, y, z + 4.0]
        })
        .collect();
    let colors: Vec<[f32; 3]> = (0..n).map(|_| triple(0.1, 0.9)).collect();
    let mut rows = GaussianRows::from_points(&points, &colors, sh_degree, 0.1);
    for row in 0..n {
        rows.log_scales[row] = triple(-3.0, -1.0);
        let [x, y, z] = triple(-1.0, 1.0);
        rows.quats[row] = unit([0.3, x, y, z]);
        rows.opacity_logits[row] = triple(-1.0, 4.0)[0];
    }
    for value in &mut rows.sh_rest {
        *value = triple(-0.4, 0.4)[0];
    }
    rows
}

fn picture(rows: &GaussianRows, camera: &Camera) -> Picture {
    let set = Gaussians::from_rows(rows, &Device::flex());
    let scene = DynamicScene {
        settings: SceneSettings {
            sh_degree: set.sh_degree(),
            ..Default::default()
        },
        static_set: set,
        dynamic: None,
    };
    Picture::of(scene.render(camera, 0.0).expect("renders")).expect("copied")
}

fn camera() -> Camera {
    Camera::new(80.0, 80.0, 40.0, 30.0, 80, 60).look_at(
        [0.3, -0.2, 0.0],
        [0.0, 0.1, 4.0],
        [0.1, -1.0, 0.0],
    )
}

/// dB between two pictures.
fn psnr(a: &Picture, b: &Picture) -> f64 {
    let squares = a
        .rgb
        .iter()
        .zip(&b.rgb)
        .map(|(a, b)| f64::from(a - b).powi(2));
    -10.0 * (squares.sum::<f64>() / a.rgb.len() as f64).log10()
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a scratch folder")
}

fn written(rows: &GaussianRows, format: SplatFormat) -> (SplatFile, usize) {
    let folder = folder();
    let path = folder.path().join(format!("a.{format}"));
    write_splats(&path, rows, 0.2).expect("writable");
    let bytes = std::fs::metadata(&path).expect("written").len();
    (read_splats(&path).expect("readable"), bytes as usize)
}

/// What is turned looks alike to a camera that is turned with it, colours that depend on direction included.
#[test]
fn turned_gaussians_look_alike_to_a_turned_camera() {
    for degree in 0..4 {
        let rows = random_rows(40, degree);
        let straight = picture(&rows, &camera());
        for (turn, signs) in [
            (HalfTurn::AboutX, [1.0, -1.0, -1.0]),
            (HalfTurn::AboutZ, [-1.0, -1.0, 1.0]),
        ] {
            let mut there = camera();
            for row in &mut there.rotation {
                *row = std::array::from_fn(|axis| row[axis] * signs[axis]);
            }
            let back = psnr(&straight, &picture(&turn.of(rows.clone()), &there));
            assert!(back > 100.0, "{turn:?}, degree {degree}: {back}");
            assert_eq!(turn.of(turn.of(rows.clone())), rows);
        }
    }
}

/// Each kind gives back what it was given, as exactly as its numbers are.
#[test]
fn every_format_looks_as_what_was_written() {
    for degree in 0..4 {
        let rows = random_rows(200, degree);
        let expected = picture(&rows, &camera());
        let mut sizes = Vec::new();
        for (format, least) in [
            (SplatFormat::Ply, 120.0),
            (SplatFormat::Glb, 100.0),
            (SplatFormat::Spz, 34.0),
            (SplatFormat::Splat, 34.0),
        ] {
            let (file, bytes) = written(&rows, format);
            assert_eq!(
                (file.rows.len(), file.left_out.count()),
                (200, 0),
                "{format}"
            );
            sizes.push(bytes);
            if format == SplatFormat::Splat && degree > 0 {
                assert_eq!(file.rows.sh_degree(), 0);
                continue;
            }
            assert_eq!(file.rows.sh_degree(), degree, "{format}");
            let got = psnr(&expected, &picture(&file.rows, &camera()));
            assert!(got > least, "{format}, degree {degree}: {got} dB");
        }
        assert!(sizes[2] < sizes[0] / 3, "SPZ is small: {sizes:?}");
    }
}

#[test]
fn a_name_says_the_kind() {
    let of = |name: &str| SplatFormat::of(Path::new(name));
    assert_eq!(of("a/b.SPZ"), Some(SplatFormat::Spz));
    assert_eq!(of("b.compressed.ply"), Some(SplatFormat::Ply));
    assert_eq!(
        (of("b.sog"), of("splat"), of("a.splat/")),
        (None, None, Some(SplatFormat::Splat))
    );
    let folder = folder();
    let path = folder.path().join("a.ksplat");
    let error = write_splats(&path, &random_rows(2, 0), 0.2).expect_err("unknown");
    assert!(
        error.to_string().contains(".spz") && error.to_string().contains("`ksplat`"),
        "{error}"
    );
    assert!(!path.exists());
}

/// A file that is cut anywhere is refused, with its name.
#[test]
fn cut_files_are_refused() {
    let folder = folder();
    for format in [SplatFormat::Spz, SplatFormat::Splat, SplatFormat::Glb] {
        let path = folder.path().join(format!("a.{format}"));
        write_splats(&path, &random_rows(5, 1), 0.2).expect("writable");
        let whole = std::fs::read(&path).expect("written");
        for kept in (0..whole.len()).filter(|kept| format != SplatFormat::Splat || kept % 32 != 0) {
            std::fs::write(&path, &whole[..kept]).expect("writable");
            let error = read_splats(&path).expect_err("cut").to_string();
            assert!(error.contains(&format!("a.{format}")), "{error}");
        }
    }
}

/// Later versions of SPZ are another container; they are told by their number.
#[test]
fn a_later_version_is_told() {
    let folder = folder();
    let path = folder.path().join("a.spz");
    std::fs::write(&path, b"NGSP\x04\0\0\0 and more").expect("writable");
    let error = read_splats(&path).expect_err("another version").to_string();
    assert!(
        error.contains("version 2 or 3") && error.contains("found version 4"),
        "{error}"
    );
}

/// Values at the ends of what the formats hold stay values.
#[test]
fn ends_of_the_ranges_are_kept() {
    let mut rows = random_rows(4, 0);
    rows.opacity_logits = vec![40.0, -40.0, 40.0, 40.0];
    rows.log_scales[0] = [-30.0, 12.0, 0.0];
    rows.means[2] = [1e6, -3e6, 0.5];
    rows.quats[3] = [0.0; 4];
    for format in [SplatFormat::Spz, SplatFormat::Splat] {
        let (file, _) = written(&rows, format);
        assert_eq!(
            file.left_out.invisible, 1,
            "{format}: what 8 bits round to nothing is left out"
        );
        let rows = file.rows;
        assert_eq!(rows.len(), 3);
        assert!(rows.opacity_logits.iter().all(|logit| *logit > 5.0));
        let far = rows
            .means
            .iter()
            .find(|mean| mean[0] > 9e5)
            .expect("far away");
        assert!((far[1] + 3e6).abs() < 1.0, "{format}: {far:?}");
        assert!(rows.quats.as_flattened().iter().all(|q| q.is_finite()));
    }
}
