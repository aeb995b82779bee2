//! Tiles that splats touch, and the drawing order. Shared by the backends.

use crate::splats::{self, ALPHA_MIN, N_COLUMNS, is_finite};

/// Side of a square tile in pixels.
pub const TILE: usize = 16;

/// Largest image side in pixels: tile indices are kept in 16 bits.
pub const MAX_IMAGE_SIDE: usize = u16::MAX as usize;

/// The pixels whose centres lie in a splat's box, and its place in the drawing order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Footprint {
    /// Ascending with the depth.
    pub depth_key: u32,
    /// First column.
    pub x0: u16,
    /// One past the last column.
    pub x1: u16,
    /// First row.
    pub y0: u16,
    /// One past the last row.
    pub y1: u16,
}

impl Footprint {
    /// The footprint of a packed row in an image; empty when nothing of it is drawn.
    pub fn new(row: &[f32], width: usize, height: usize) -> Self {
        let empty = Self::default();
        if !row.iter().all(|&value| is_finite(value)) {
            return empty;
        }
        let (radius_x, radius_y) = (row[splats::RADIUS_X], row[splats::RADIUS_Y]);
        if radius_x <= 0.0 || radius_y <= 0.0 || row[splats::OPACITY] < ALPHA_MIN as f32 {
            return empty;
        }
        let (x0, x1) = pixel_range(row[splats::MEAN_X], radius_x, width);
        let (y0, y1) = pixel_range(row[splats::MEAN_Y], radius_y, height);
        if x0 >= x1 || y0 >= y1 {
            return empty;
        }
        Self {
            depth_key: ascending_bits(row[splats::DEPTH]),
            x0,
            x1,
            y0,
            y1,
        }
    }

    /// Whether nothing is drawn.
    pub fn is_empty(&self) -> bool {
        self.x0 >= self.x1
    }

    /// The tile rows touched.
    pub fn tile_rows(&self) -> std::ops::Range<usize> {
        tile_range(self.y0, self.y1)
    }

    /// The tile columns touched.
    pub fn tile_columns(&self) -> std::ops::Range<usize> {
        tile_range(self.x0, self.x1)
    }
}

fn tile_range(from: u16, to: u16) -> std::ops::Range<usize> {
    usize::from(from) / TILE..usize::from(to).div_ceil(TILE)
}

/// Pixels of `0..size` whose centres (at +0.5) lie within `radius` of `centre`.
fn pixel_range(centre: f32, radius: f32, size: usize) -> (u16, u16) {
    let size = size.min(MAX_IMAGE_SIDE) as f32;
    let from = (centre - radius - 0.5).ceil().clamp(0.0, size);
    let to = ((centre + radius - 0.5).floor() + 1.0).clamp(0.0, size);
    (from as u16, to as u16)
}

/// Bits that compare as unsigned integers like the finite float does.
fn ascending_bits(value: f32) -> u32 {
    // -0 must not come before 0.
    let bits = (value + 0.0).to_bits();
    if bits >> 31 == 0 {
        bits | 1 << 31
    } else {
        !bits
    }
}

/// Rows in drawing order: by depth, equal depths by row; empty footprints are left out.
pub fn depth_order(footprints: &[Footprint]) -> Vec<u32> {
    /// Bits sorted per pass: the counts of a pass fit the first-level cache.
    const DIGIT: u32 = 11;
    let mut entries: Vec<(u32, u32)> = (0u32..)
        .zip(footprints)
        .filter(|(_, footprint)| !footprint.is_empty())
        .map(|(id, footprint)| (footprint.depth_key, id))
        .collect();
    let mut scratch = vec![(0, 0); entries.len()];
    for shift in (0..u32::BITS).step_by(DIGIT as usize) {
        let digit = |key: u32| (key >> shift) as usize & ((1 << DIGIT) - 1);
        let mut starts = [0u32; 1 << DIGIT];
        for &(key, _) in &entries {
            starts[digit(key)] += 1;
        }
        if starts.iter().any(|&count| count as usize == entries.len()) {
            continue;
        }
        let mut sum = 0;
        for start in &mut starts {
            sum += std::mem::replace(start, sum);
        }
        for &entry in &entries {
            let start = &mut starts[digit(entry.0)];
            scratch[*start as usize] = entry;
            *start += 1;
        }
        std::mem::swap(&mut entries, &mut scratch);
    }
    entries.into_iter().map(|(_, id)| id).collect()
}

/// The splats of every tile row ("band"), each in drawing order.
#[derive(Debug)]
pub struct Bands {
    /// Where each band's part of `ids` starts; one more entry than bands.
    pub starts: Vec<usize>,
    /// Rows of the packed splats.
    pub ids: Vec<u32>,
}

impl Bands {
    /// Counting sort, stable in the drawing order.
    pub fn new(order: &[u32], footprints: &[Footprint], n_bands: usize) -> Self {
        let mut starts = vec![0; n_bands + 1];
        for &id in order {
            for band in footprints[id as usize].tile_rows() {
                starts[band + 1] += 1;
            }
        }
        for band in 0..n_bands {
            starts[band + 1] += starts[band];
        }
        let mut ends = starts.clone();
        let mut ids = vec![0; starts[n_bands]];
        for &id in order {
            for band in footprints[id as usize].tile_rows() {
                ids[ends[band]] = id;
                ends[band] += 1;
            }
        }
        Self { starts, ids }
    }

    /// Number of bands.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// The rows of a band.
    pub fn ids(&self, band: usize) -> &[u32] {
        &self.ids[self.starts[band]..self.starts[band + 1]]
    }
}

const _: () = assert!(N_COLUMNS > splats::RADIUS_Y, "the radii are columns");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixel_ranges_by_hand() {
        assert_eq!(pixel_range(8.0, 1.0, 16), (7, 9), "centres 7.5 and 8.5");
        assert_eq!(
            pixel_range(8.5, 1.0, 16),
            (7, 10),
            "the border belongs to the range"
        );
        assert_eq!(pixel_range(8.0, 0.4, 16), (8, 8), "no centre is that near");
        assert_eq!(pixel_range(-3.0, 1.0, 16), (0, 0), "outside on the left");
        assert_eq!(pixel_range(30.0, 1.0, 16), (16, 16), "outside on the right");
        assert_eq!(pixel_range(8.0, f32::MAX, 16), (0, 16), "everything");
    }

    #[test]
    fn depth_order_is_the_stable_sort() {
        let depths = [3.0, -1.0, 0.0, -0.0, 1e-40, 3.0, f32::MAX, 2.0, -5.0, 3.0];
        let footprints = depths.map(|depth| Footprint {
            depth_key: ascending_bits(depth),
            x1: 1,
            y1: 1,
            ..Footprint::default()
        });
        assert_eq!(depth_order(&footprints), [8, 1, 2, 3, 4, 7, 0, 5, 9, 6]);
    }

    #[test]
    fn bands_keep_the_order_and_hold_each_splat_once_per_tile_row() {
        let footprint = |y0, y1| Footprint {
            depth_key: 0,
            x0: 0,
            x1: 1,
            y0,
            y1,
        };
        let footprints = [footprint(0, 17), footprint(16, 40), footprint(3, 4)];
        let bands = Bands::new(&[2, 1, 0], &footprints, 3);
        assert_eq!(bands.ids(0), [2, 0]);
        assert_eq!(bands.ids(1), [1, 0]);
        assert_eq!(bands.ids(2), [1]);
    }
}
