//! Errors on ever harder inputs: longer needles, larger and smaller scales, more splats on a pixel, smaller and
//! larger tables.

use dash_kernels::hash_encode::{
    HashGridConfig, HashGridLayout, Interpolation, LevelSizing, hash_encode, reference,
};
use dash_kernels::project::Activation;
use dash_kernels::rasterize::rasterize;
use dash_kernels::splats::{ALPHA_MIN, CONIC_A, CONIC_C, N_COLUMNS};
use rand::Rng;

use super::hash_encode::{HALF_TABLE, through_half};
use super::project::{Cloud, columns_apart, sight};
use super::rasterize::Judged;
use super::{
    Bench, BenchOptions, ErrorStats, Errors, Op, StiffnessPoint, Target, determinant, exponent,
    generator, to_f64, uniform, values,
};
use crate::Error;

const NEEDLES: &str = "needle length (px)";
const NEEDLES_PX: [f64; 9] = [10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4, 3e4, 65e3];
const SCALES: &str = "logarithm of the scale";
const SPLATS: &str = "splats on a pixel";
const N_SPLATS: [usize; 9] = [1, 3, 10, 30, 100, 300, 1_000, 3_000, 10_000];
const TABLES: &str = "log2 of the table size";
const LOG2_TABLES: std::ops::RangeInclusive<u32> = 1..=24;
/// Gaussians or points for each value.
const N: usize = 2_000;
/// Ratio of a needle's other axes to its length.
const NEEDLE_RATIO: f64 = 1e-8;
/// Side of the picture under many splats, pixels.
const SMALL_SIDE: usize = 16;

pub(super) fn measure(bench: &mut Bench, options: &BenchOptions) -> Result<(), Error> {
    let wants = |op| options.ops.contains(&op);
    if wants(Op::Project) {
        for length_px in NEEDLES_PX {
            determinant::stiff(bench, NEEDLES, length_px, N);
        }
    }
    if wants(Op::Rasterize) {
        for length_px in NEEDLES_PX {
            exponent::stiff(bench, NEEDLES, length_px, N);
        }
    }
    for (name, device) in &options.devices {
        let target = Target { name, device };
        (bench.on_part)(&format!("{name}: harder and harder inputs"));
        if wants(Op::Project) {
            needles(bench, target)?;
            scales(bench, target)?;
        }
        if wants(Op::Rasterize) {
            crowds(bench, target)?;
        }
        if wants(Op::HashEncode) {
            tables(bench, target)?;
        }
    }
    Ok(())
}

impl Target<'_> {
    fn stiffness(
        &self,
        (sweep, logarithmic): (&str, bool),
        value: f64,
        (op, variant): (&str, &str),
        error: ErrorStats,
    ) -> StiffnessPoint {
        StiffnessPoint {
            sweep: sweep.into(),
            value,
            logarithmic,
            op: op.into(),
            backend: self.name.into(),
            variant: variant.into(),
            error,
        }
    }
}

fn needles(bench: &mut Bench, target: Target) -> Result<(), Error> {
    let sight = sight(Activation::Linear);
    for length_px in NEEDLES_PX {
        let mut cloud = Cloud::random(N, 12);
        for (i, scale) in cloud.scales.iter_mut().enumerate() {
            let depth = f64::from(cloud.means[i / 3 * 3 + 2]);
            let longest = length_px * depth / sight.camera.fx;
            let share = if i.is_multiple_of(3) {
                1.0
            } else {
                NEEDLE_RATIO
            };
            *scale = (longest * share) as f32;
        }
        let got = cloud.projected(target, &sight)?;
        let errors = columns_apart(&got, &cloud.expected(&sight), CONIC_A..CONIC_C + 1);
        let op = ("project: inverse covariance", "f32");
        let point = target.stiffness((NEEDLES, true), length_px, op, errors);
        bench.found.stiffness.push(point);
    }
    Ok(())
}

fn scales(bench: &mut Bench, target: Target) -> Result<(), Error> {
    let sight = sight(Activation::Exp);
    for exponent in (-20..=20).step_by(2) {
        let mut cloud = Cloud::random(N, 13);
        let mut rng = generator(14);
        for scale in &mut cloud.scales {
            *scale = exponent as f32 + rng.random_range(-0.5..0.5);
        }
        for opacity in &mut cloud.opacities {
            *opacity = (*opacity / (1.0 - *opacity)).ln();
        }
        let got = cloud.projected(target, &sight)?;
        let errors = columns_apart(&got, &cloud.expected(&sight), 0..N_COLUMNS);
        let value = f64::from(exponent);
        let point = target.stiffness((SCALES, false), value, ("project", "f32"), errors);
        bench.found.stiffness.push(point);
    }
    Ok(())
}

/// Faint splats that all cover a small picture.
fn crowd(n: usize) -> Judged {
    /// Standard deviation, pixels.
    const SIGMA_PX: f32 = 50.0;
    let mut rng = generator(15);
    let splats = (0..n)
        .flat_map(|_| {
            let mut row = [0.0_f32; N_COLUMNS];
            let opacity: f32 = rng.random_range(0.006..0.02);
            let radius = SIGMA_PX * (2.0 * (opacity / ALPHA_MIN as f32).ln()).sqrt();
            let precision = 1.0 / (SIGMA_PX * SIGMA_PX);
            let centre: [f32; 2] = std::array::from_fn(|_| rng.random_range(4.0..12.0));
            row[..6].copy_from_slice(&[centre[0], centre[1], precision, 0.0, precision, opacity]);
            for value in &mut row[6..9] {
                *value = rng.random();
            }
            row[9..12].copy_from_slice(&[rng.random_range(1.0..9.0), radius, radius]);
            row
        })
        .collect();
    Judged {
        splats,
        size: [SMALL_SIDE; 2],
        parts: vec![[0, 0]],
        side: SMALL_SIDE,
    }
}

fn crowds(bench: &mut Bench, target: Target) -> Result<(), Error> {
    for n in N_SPLATS {
        let judged = crowd(n);
        let image = values(rasterize(judged.tensor(target), &judged.options())?)?;
        let errors = judged.picture_errors(&image);
        let (sweep, value) = ((SPLATS, true), n as f64);
        let point = target.stiffness(sweep, value, ("rasterize", "f32"), errors);
        bench.found.stiffness.push(point);
        judged.gradients(target, |way, errors, _| {
            let variant = format!("f32{way}");
            let op = ("rasterize: gradient", variant.as_str());
            bench
                .found
                .stiffness
                .push(target.stiffness(sweep, value, op, errors));
            Ok(())
        })?;
    }
    Ok(())
}

fn tables(bench: &mut Bench, target: Target) -> Result<(), Error> {
    for log2 in LOG2_TABLES {
        let measured = table(bench, target, log2);
        bench.unless_too_large(measured, &format!("{}: a table of 2^{log2}", target.name))?;
    }
    Ok(())
}

/// One level, so that the table of 2^24 fits into the memory of most machines.
fn table(bench: &mut Bench, target: Target, log2: u32) -> Result<(), Error> {
    for (variant, interpolation) in [
        ("linear", Interpolation::Linear),
        ("smoothstep", Interpolation::Smoothstep),
    ] {
        let layout = HashGridLayout::new(&HashGridConfig {
            n_levels: 1,
            n_features_per_level: 2,
            log2_hashmap_size: log2,
            base_resolution: vec![2048, 2048, 2048, 25],
            finest_resolution: vec![2048, 2048, 2048, 25],
            interpolation,
            sizing: LevelSizing::Paper,
        })?;
        let mut rng = generator(16);
        let positions = uniform(&mut rng, N * 4, 0.0, 1.0);
        let table = uniform(&mut rng, layout.n_entries() * 2, -0.1, 0.1);
        let expected = reference::hash_encode(&to_f64(&positions), &to_f64(&table), &layout);
        let placed = target.tensor(&positions, [N, 4]);
        let mut add = |table: &[f32], variant| {
            let table = target.tensor(table, [layout.n_entries(), 2]);
            let got = values(hash_encode(placed.clone(), table, &layout)?)?;
            let (value, op) = (f64::from(log2), ("hash_encode", variant));
            let errors = Errors::of(&got, &expected);
            let point = target.stiffness((TABLES, false), value, op, errors);
            bench.found.stiffness.push(point);
            Ok::<_, Error>(())
        };
        add(&table, variant)?;
        if interpolation == Interpolation::Linear {
            add(&through_half(&table), HALF_TABLE)?;
        }
    }
    Ok(())
}
