//! Points and tables that are hard to encode.

use burn::tensor::Device;
use dash_kernels::hash_encode::{
    HashGridConfig, HashGridLayout, Interpolation, LevelSizing, hash_encode, reference,
};
use rand::Rng;

use super::Case;
use super::inputs::{gradient, rng, tensor, to_host, tracked, uniform, widen};
use super::measured::{Measured, largest_difference};
use crate::Error;

const FAMILY: &str = "hash grid";

/// Relative error of the gradient of a table, whose weights are off by as little as the features.
const TABLE_GRADIENT: f64 = 1e-3;

pub(super) const CASES: &[Case] = &[
    Case {
        family: FAMILY,
        name: "vertices",
        extreme: "points on grid vertices and one step beside them, at 0 and at 1",
        measure: vertices,
    },
    Case {
        family: FAMILY,
        name: "outside",
        extreme: "points beside the unit cube by one step, far outside, NaN and infinite",
        measure: outside,
    },
    Case {
        family: FAMILY,
        name: "times",
        extreme: "t at 0, at 1, at frames and between them",
        measure: times,
    },
    Case {
        family: FAMILY,
        name: "level sizes",
        extreme: "log2 1-24, resolutions to 65,536, 2 to 4 dimensions",
        measure: level_sizes,
    },
    Case {
        family: FAMILY,
        name: "one-entry tables",
        extreme: "tables of one entry a level",
        measure: one_entry,
    },
    Case {
        family: FAMILY,
        name: "fine grid",
        extreme: "4D, finest level of 2048^4",
        measure: |device| fine(2048, 15, device),
    },
    Case {
        family: FAMILY,
        name: "finest grid",
        extreme: "4D, finest level of 65,536^4, two entries a level",
        measure: |device| fine(65_536, 1, device),
    },
];

fn config(dims: usize) -> HashGridConfig {
    HashGridConfig {
        n_levels: 6,
        n_features_per_level: 2,
        log2_hashmap_size: 9,
        base_resolution: [3, 4, 5, 2][..dims].to_vec(),
        finest_resolution: [90, 64, 70, 25][..dims].to_vec(),
        interpolation: Interpolation::Linear,
        sizing: LevelSizing::Paper,
    }
}

/// How far features may be off: a coordinate times the resolution is rounded to half an ulp of a float
/// (2^-24 of it), along each axis, and entries of the tables here differ by at most 2.
fn feature_tolerance(layout: &HashGridLayout) -> f64 {
    let finest = layout.levels().iter().flat_map(|level| level.scale);
    let cells = finest.fold(1.0, f64::max);
    let rounding = 2.0 * layout.dims() as f64 * cells * 2f64.powi(-24);
    // The weights' own rounding, for coarse grids.
    rounding.max(2e-6)
}

struct Encoded {
    features: Vec<f32>,
    expected: Vec<f64>,
    v_positions: [Vec<f64>; 2],
    v_table: (Vec<f32>, Vec<f64>),
}

fn encode(positions: &[f32], layout: &HashGridLayout, device: &Device) -> Result<Encoded, Error> {
    let (dims, width, rows) = (layout.dims(), layout.n_features(), layout.n_entries());
    let n = positions.len() / dims;
    let mut rng = rng(31);
    let table = uniform(&mut rng, rows * layout.n_features_per_level(), -1.0, 1.0);
    let v_out = uniform(&mut rng, n * width, -1.0, 1.0);
    let points = tracked(positions, [n, dims], device);
    let entries = tracked(&table, [rows, layout.n_features_per_level()], device);
    let out = hash_encode(points.clone(), entries.clone(), layout)?;
    let features = to_host(out.clone().inner());
    let v = tensor(&v_out, [n, width], &device.clone().autodiff());
    let gradients = (out * v).sum().backward();
    let (positions, table) = (widen(positions), widen(&table));
    let (v_positions, v_table) =
        reference::hash_encode_vjp(&positions, &table, &widen(&v_out), layout);
    Ok(Encoded {
        features,
        expected: reference::hash_encode(&positions, &table, layout),
        v_positions: [widen(&gradient(&points, &gradients)), v_positions],
        v_table: (gradient(&entries, &gradients), v_table),
    })
}

impl Encoded {
    fn judge(&self, layout: &HashGridLayout) -> Measured {
        let mut measured = Measured::default();
        measured.saw(&self.features);
        measured.finite &= self.v_positions[0].iter().all(|v| v.is_finite());
        let error = largest_difference(&self.features, &self.expected);
        measured.judge("features", error, feature_tolerance(layout));
        let tolerance = TABLE_GRADIENT.max(10.0 * feature_tolerance(layout));
        let (got, expected) = &self.v_table;
        measured.agree("gradient of the table", got, expected, tolerance);
        measured
    }

    fn judge_positions(&self, measured: &mut Measured, tolerance: f64) {
        let got: Vec<f32> = self.v_positions[0].iter().map(|&v| v as f32).collect();
        measured.agree(
            "gradient of the points",
            &got,
            &self.v_positions[1],
            tolerance,
        );
    }
}

fn vertices(device: &Device) -> Result<Measured, Error> {
    let mut measured = Measured::default();
    for (dims, interpolation) in [
        (2, Interpolation::Linear),
        (3, Interpolation::Smoothstep),
        (4, Interpolation::Smoothstep),
    ] {
        let layout = HashGridLayout::new(&HashGridConfig {
            interpolation,
            ..config(dims)
        })?;
        let finest = layout.levels()[layout.n_levels() - 1];
        let mut positions: Vec<f32> = Vec::new();
        for k in 0..=24u16 {
            for step in [f32::next_down, f32::next_up, |x| x] {
                for axis in 0..dims {
                    let x = (f64::from(k) / finest.scale[axis]).min(1.0) as f32;
                    positions.push(step(x).clamp(0.0, 1.0));
                }
            }
        }
        // Every corner of the cube.
        for corner in 0..1usize << dims {
            positions.extend((0..dims).map(|axis| (corner >> axis & 1) as f32));
        }
        let encoded = encode(&positions, &layout, device)?;
        let judged = encoded.judge(&layout);
        measured.finite &= judged.finite;
        for mut part in judged.parts {
            part.name = format!("{dims}D: {}", part.name);
            measured.parts.push(part);
        }
    }
    Ok(measured)
}

fn outside(device: &Device) -> Result<Measured, Error> {
    let layout = HashGridLayout::new(&config(3))?;
    let mut positions = Vec::new();
    for bad in [
        -f32::from_bits(1),
        1f32.next_up(),
        -1.0,
        2.0,
        1e30,
        -1e30,
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
    ] {
        for axis in 0..3 {
            let mut point = [0.3, 0.5, 0.7];
            point[axis] = bad;
            positions.extend(point);
        }
    }
    let encoded = encode(&positions, &layout, device)?;
    let mut measured = Measured::default();
    measured.saw(&encoded.features);
    let others = |values: &mut dyn Iterator<Item = f64>| values.filter(|v| *v != 0.0).count();
    measured.none(
        "features",
        others(&mut encoded.features.iter().map(|&v| f64::from(v))),
    );
    measured.none(
        "gradient of the points",
        others(&mut encoded.v_positions[0].iter().copied()),
    );
    measured.none(
        "gradient of the table",
        others(&mut encoded.v_table.0.iter().map(|&v| f64::from(v))),
    );
    Ok(measured)
}

fn times(device: &Device) -> Result<Measured, Error> {
    /// Frames of the clip.
    const FRAMES: u16 = 50;
    let layout = HashGridLayout::new(&config(4))?;
    let mut rng = rng(32);
    let mut positions = Vec::new();
    for frame in 0..FRAMES {
        for part in [0.0, 0.25, 0.5, 0.99] {
            let time = (f32::from(frame) + part) / f32::from(FRAMES - 1);
            positions.extend(uniform(&mut rng, 3, 0.0, 1.0));
            positions.push(time.min(1.0));
        }
    }
    Ok(encode(&positions, &layout, device)?.judge(&layout))
}

/// Every level of every table size, checked by arithmetic in `u128`; nothing of it runs on the device.
fn level_sizes(_: &Device) -> Result<Measured, Error> {
    let mut wrong = 0;
    for sizing in [LevelSizing::Paper, LevelSizing::Reference] {
        for log2 in 1..=24 {
            for finest in [1, 2, 25, 2047, 2048, 2049, 65_535, 65_536] {
                for dims in 2..=4 {
                    let layout = HashGridLayout::new(&HashGridConfig {
                        n_levels: 16,
                        log2_hashmap_size: log2,
                        base_resolution: vec![1.max(finest / 256); dims],
                        finest_resolution: vec![finest; dims],
                        sizing,
                        ..config(dims)
                    })?;
                    wrong += wrong_levels(&layout, log2);
                }
            }
        }
    }
    let mut measured = Measured::default();
    measured.none("wrong levels", wrong);
    Ok(measured)
}

fn wrong_levels(layout: &HashGridLayout, log2: u32) -> usize {
    let mut offset = 0u128;
    let levels = layout.levels().iter().filter(|level| {
        let resolution = &level.resolution[..layout.dims()];
        let vertices: u128 = resolution.iter().map(|&r| u128::from(r)).product();
        let capacity = 1u128 << log2;
        let last: Vec<u64> = resolution.iter().map(|r| r - 1).collect();
        let inside = u128::from(level.row(&last)) < u128::from(level.size);
        let dense_to_the_end = !level.dense || u128::from(level.row(&last)) + 1 == vertices;
        let right = u128::from(level.size) == vertices.min(capacity)
            && level.dense == (vertices <= capacity)
            && u128::from(level.offset) == offset
            && inside
            && dense_to_the_end;
        offset += u128::from(level.size);
        !right
    });
    levels.count()
}

fn one_entry(device: &Device) -> Result<Measured, Error> {
    let layout = HashGridLayout::new(&HashGridConfig {
        log2_hashmap_size: 0,
        base_resolution: vec![1; 3],
        finest_resolution: vec![64; 3],
        ..config(3)
    })?;
    let positions = uniform(&mut rng(33), 3 * 200, 0.0, 1.0);
    let encoded = encode(&positions, &layout, device)?;
    let mut measured = encoded.judge(&layout);
    // All corners are equal: a slope is the resolution times the rounding of a sum.
    let slope = encoded.v_positions[0]
        .iter()
        .fold(0.0f64, |most, v| most.max(v.abs()));
    measured.judge("slope", slope, 64.0 * 12.0 * 1e-6);
    Ok(measured)
}

fn fine(finest: u32, log2_hashmap_size: u32, device: &Device) -> Result<Measured, Error> {
    let layout = HashGridLayout::new(&HashGridConfig {
        n_levels: 12,
        log2_hashmap_size,
        base_resolution: vec![8; 4],
        finest_resolution: vec![finest; 4],
        ..config(4)
    })?;
    let mut rng = rng(34);
    let positions: Vec<f32> = (0..4 * 500).map(|_| rng.random()).collect();
    let encoded = encode(&positions, &layout, device)?;
    let mut measured = encoded.judge(&layout);
    if finest == 2048 {
        // Where rounding takes the next cell the slope is another one.
        encoded.judge_positions(&mut measured, 0.05);
    }
    Ok(measured)
}
