//! Entries of a hash grid's tables that no point reads.

use std::collections::HashSet;

use dash_kernels::hash_encode::HashGridLevel;

use super::HashEncoder;
use crate::gaussians::to_host;
use crate::parameters::parameter;

/// Most difference between two devices in a coordinate of the unit cube.
const ROUNDING: f64 = 1e-6;

impl HashEncoder {
    /// The encoder with zeros in the entries that the `places` read at no coordinate along the last axis (time), and the
    /// numbers of entries read and of all entries. Features at the places stay equal bit for bit.
    ///
    /// # Shapes
    /// `places [N, D - 1]` in the unit cube; a place outside reads nothing.
    pub fn without_unread(&self, places: &[f32]) -> (Self, [usize; 2]) {
        let axes = self.layout.dims() - 1;
        let width = self.layout.n_features_per_level();
        let (mut n_read, mut n_entries) = (0, 0);
        let mut tables = self
            .tables()
            .zip(&self.table_layouts)
            .map(|(table, layout)| {
                let mut read = vec![false; layout.n_entries()];
                for level in layout.levels() {
                    for vertex in vertices(places, axes, level) {
                        for last in 0..level.resolution[axes] {
                            let mut whole = vertex;
                            whole[axes] = last;
                            let row = level.offset + level.row(&whole[..=axes]);
                            read[row as usize] = true;
                        }
                    }
                }
                n_read += read.iter().filter(|&&read| read).count();
                n_entries += read.len();
                let table = table.val();
                let (device, shape) = (table.device(), table.dims());
                let mut values = to_host(table.detach());
                for (entry, read) in values.chunks_exact_mut(width).zip(read) {
                    if !read {
                        entry.fill(0.0);
                    }
                }
                parameter(values, shape, &device)
            });
        let table = tables.next().expect("an encoder has a table");
        let further_tables = tables.collect();
        let encoder = Self {
            table,
            further_tables,
            layout: self.layout.clone(),
            table_layouts: self.table_layouts.clone(),
        };
        (encoder, [n_read, n_entries])
    }
}

/// Vertices of the cells that hold a place, without the coordinate along the last axis. A place on a border is in all
/// cells beside it.
fn vertices(places: &[f32], axes: usize, level: &HashGridLevel) -> HashSet<[u64; 4]> {
    let mut found = HashSet::new();
    for place in places.chunks_exact(axes) {
        let inside = |&x: &f32| (-ROUNDING..=1.0 + ROUNDING).contains(&f64::from(x));
        if !place.iter().all(inside) {
            continue;
        }
        let ranges: [_; 3] = std::array::from_fn(|axis| {
            if axis >= axes {
                return 0..=0;
            }
            let cell = |x: f64| {
                let cell = (x.clamp(0.0, 1.0) * level.scale[axis]).floor() as u64;
                cell.min(level.resolution[axis] - 2)
            };
            let x = f64::from(place[axis]);
            cell(x - ROUNDING)..=cell(x + ROUNDING) + 1
        });
        for z in ranges[2].clone() {
            for y in ranges[1].clone() {
                found.extend(ranges[0].clone().map(|x| [x, y, z, 0]));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, Tensor, TensorData};
    use dash_kernels::hash_encode::reference;
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;
    use crate::HashEncoderConfig;

    /// Dense and hashed levels of four axes, the last finer than the others on some.
    fn encoder(device: &Device) -> HashEncoder {
        let config = HashEncoderConfig {
            n_levels: 5,
            n_features_per_level: 2,
            log2_hashmap_size: 9,
            base_resolution: vec![2, 3, 2, 4],
            finest_resolution: vec![40, 33, 52, 9],
            smoothstep: false,
            reference_sizing: false,
            pruned_levels: Vec::new(),
        };
        config
            .init_between(0.5..1.0, &mut Pcg64::seed_from_u64(3), device)
            .expect("a good configuration")
    }

    /// Where some points are, and times that reach every cell of every level.
    fn points(n: usize) -> (Vec<f32>, Vec<f32>) {
        let mut rng = Pcg64::seed_from_u64(5);
        let places = (0..3 * n).map(|_| rng.random_range(0.1..0.6)).collect();
        let times = (0..200).map(|k| (k as f32 + 0.5) / 200.0).collect();
        (places, times)
    }

    fn at(places: &[f32], time: f32) -> Vec<f32> {
        let places = places.chunks_exact(3);
        places
            .flat_map(|place| [place[0], place[1], place[2], time])
            .collect()
    }

    #[test]
    fn the_entries_that_are_read_are_those_with_a_gradient() {
        let encoder = encoder(&Device::flex());
        let (places, times) = points(4);
        let layout = encoder.layout();
        let table: Vec<f64> = to_host(encoder.table.val())
            .into_iter()
            .map(f64::from)
            .collect();
        let mut slopes = vec![0.0; table.len()];
        for &time in &times {
            let wide: Vec<f64> = at(&places, time).into_iter().map(f64::from).collect();
            let ones = vec![1.0; 4 * layout.n_features()];
            let (_, v_table) = reference::hash_encode_vjp(&wide, &table, &ones, layout);
            for (slope, v) in slopes.iter_mut().zip(v_table) {
                *slope += v;
            }
        }
        let (sparse, [n_read, n_entries]) = encoder.without_unread(&places);
        let left = to_host(sparse.table.val());
        let mut expected = 0;
        for ((entry, before), slopes) in left
            .chunks_exact(2)
            .zip(table.chunks_exact(2))
            .zip(slopes.chunks_exact(2))
        {
            let read = slopes[0] > 0.0;
            expected += usize::from(read);
            let wanted = if read { before } else { &[0.0; 2] };
            assert!(entry.iter().zip(wanted).all(|(a, b)| f64::from(*a) == *b));
        }
        assert_eq!((n_read, n_entries), (expected, layout.n_entries()));
        assert!(n_read > 100 && 2 * n_read < n_entries, "{n_read}");
    }

    #[test]
    fn features_are_the_same_at_every_time_and_on_every_border() {
        let device = Device::flex();
        let encoder = encoder(&device);
        let (mut places, mut times) = points(20);
        // On vertices of the levels, on the borders of the cube, one float beside them, and outside.
        places.extend([
            0.0,
            1.0,
            0.5,
            0.25,
            0.5,
            1.0,
            0.5f32.next_up(),
            0.5f32.next_down(),
            0.75,
        ]);
        places.extend([
            1.0f32.next_down(),
            0.0,
            0.0,
            1.5,
            0.5,
            0.5,
            f32::NAN,
            0.5,
            0.5,
        ]);
        times.extend([0.0, 0.25, 0.5, 1.0]);
        let (sparse, [n_read, n_entries]) = encoder.without_unread(&places);
        assert!(n_read < n_entries);
        for time in times {
            let points = at(&places, time);
            let n = points.len() / 4;
            let points = Tensor::<2>::from_data(TensorData::new(points, [n, 4]), &device);
            let features = |encoder: &HashEncoder| {
                let features = encoder.forward(points.clone()).expect("fits");
                to_host(features)
                    .into_iter()
                    .map(f32::to_bits)
                    .collect::<Vec<_>>()
            };
            assert_eq!(features(&sparse), features(&encoder), "time {time}");
        }
        let (nothing, [n_read, _]) = encoder.without_unread(&[]);
        assert_eq!(n_read, 0);
        assert!(to_host(nothing.table.val()).iter().all(|&v| v == 0.0));
    }
}
