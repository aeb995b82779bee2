//! One row of tiles: its splats in drawing order and the list of them for each tile.

use crate::splats::{self, N_COLUMNS};

use super::super::RasterizeOptions;
use super::super::needle::Needle;
use super::super::tiles::{Footprint, TILE};

/// Pixels in a tile.
pub const TILE_PIXELS: usize = TILE * TILE;

/// Exponents are kept in base 2.
pub const LOG2_E: f32 = std::f32::consts::LOG2_E;

/// Splats that are read together.
const FETCHED: usize = 16;

/// Below it `exp2` is no number: what an opacity above 1 would make visible.
const MIN_EXPONENT: f32 = -126.0;

/// A splat as blending reads it.
///
/// The exponent is kept in base 2: with `d` the offset from a pixel to the centre,
/// `log2(alpha / opacity) = qa dx^2 + qb dx dy + qc dy^2`.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct Record {
    pub x: f32,
    pub y: f32,
    pub qa: f32,
    pub qb: f32,
    pub qc: f32,
    pub opacity: f32,
    /// The exponent where alpha is 1/255.
    pub threshold: f32,
    pub red: f32,
    pub green: f32,
    pub blue: f32,
    pub depth: f32,
    /// First row of the band that the splat's box touches, and one past the last.
    pub rows: [u8; 2],
    /// First tile column, and one past the last.
    pub tiles: [u16; 2],
    /// Place among the band's needles, `NO_NEEDLE` for other splats.
    needle: u32,
}

/// See [`Record`].
const NO_NEEDLE: u32 = u32::MAX;

/// A needle in a tile, in pixels from the tile's corner.
#[derive(Debug, Clone, Copy)]
pub struct NeedleInTile {
    /// The axis' point next to the tile's middle.
    pub foot: [f32; 2],
    /// Unit vector across.
    pub normal: [f32; 2],
    /// The centre's distance along the axis from the foot.
    pub far: f32,
    /// What the squares of the distances across and along are multiplied with: the exponent in base 2.
    pub factors: [f32; 2],
}

impl NeedleInTile {
    #[inline(always)]
    fn new(needle: &Needle<f32>, [left, top]: [f32; 2]) -> Self {
        let half = 0.5 * TILE as f32;
        let [across, along] = needle.parts([left + half, top + half]);
        let ([nx, ny], distance) = (needle.normal, needle.offset - across);
        Self {
            foot: [half + distance * nx, half + distance * ny],
            normal: needle.normal,
            far: needle.centre - along,
            factors: [-0.5 * LOG2_E * needle.across, -0.5 * LOG2_E * needle.along],
        }
    }
}

impl Record {
    #[inline(always)]
    fn new(row: &[f32; N_COLUMNS], footprint: &Footprint, band: usize) -> Self {
        let top = band * TILE;
        let within = |y: u16| usize::from(y).saturating_sub(top).min(TILE) as u8;
        let tiles = footprint.tile_columns();
        Self {
            x: row[splats::MEAN_X],
            y: row[splats::MEAN_Y],
            qa: -0.5 * LOG2_E * row[splats::CONIC_A],
            qb: -LOG2_E * row[splats::CONIC_B],
            qc: -0.5 * LOG2_E * row[splats::CONIC_C],
            opacity: row[splats::OPACITY],
            threshold: (-(255.0 * row[splats::OPACITY]).log2()).max(MIN_EXPONENT),
            red: row[splats::RED],
            green: row[splats::GREEN],
            blue: row[splats::BLUE],
            depth: row[splats::DEPTH],
            rows: [within(footprint.y0), within(footprint.y1)],
            tiles: [tiles.start as u16, tiles.end as u16],
            needle: NO_NEEDLE,
        }
    }

    /// The conic's entries a, b, c.
    pub fn conic(&self) -> [f32; 3] {
        [
            self.qa * (-2.0 / LOG2_E),
            self.qb * (-1.0 / LOG2_E),
            self.qc * (-2.0 / LOG2_E),
        ]
    }

    /// The rows of the band that the splat's box touches, as bits.
    #[inline(always)]
    pub fn row_bits(&self) -> u32 {
        (1 << self.rows[1]) - (1 << self.rows[0])
    }
}

/// A row of tiles.
#[derive(Debug)]
pub struct Band {
    /// Row of the image at the band's top.
    pub top: usize,
    /// The band's splats in drawing order.
    pub records: Vec<Record>,
    needles: Vec<Needle<f32>>,
    /// Where each tile's part of `entries` starts; one more entry than tiles.
    pub starts: Vec<u32>,
    /// Indices into `records`, in drawing order within each tile.
    pub entries: Vec<u32>,
    /// Transmittance behind the last splat of each pixel, tile after tile; filled by blending.
    pub transmittance: Vec<f32>,
    /// One past the place in its tile's list of each pixel's last splat; filled by blending.
    pub last: Vec<i32>,
}

impl Band {
    /// Sorts the band's splats into its tiles.
    pub fn new(
        splats: &[f32],
        footprints: &[Footprint],
        ids: &[u32],
        index: usize,
        options: &RasterizeOptions,
    ) -> Self {
        let n_tiles = options.width.div_ceil(TILE);
        let mut needles = Vec::new();
        let mut records = Vec::with_capacity(ids.len());
        let (rows, _) = splats.as_chunks::<N_COLUMNS>();
        for ids in ids.chunks(FETCHED) {
            // Rows in drawing order lie anywhere in memory: read together, they are waited for together.
            let mut fetched = [([0.0; N_COLUMNS], Footprint::default()); FETCHED];
            for (fetched, &id) in fetched.iter_mut().zip(ids) {
                *fetched = (rows[id as usize], footprints[id as usize]);
            }
            for (row, footprint) in &fetched[..ids.len()] {
                let mut record = Record::new(row, footprint, index);
                if let Some(needle) = Needle::of(row) {
                    record.needle = needles.len() as u32;
                    needles.push(needle);
                }
                records.push(record);
            }
        }
        let mut starts = vec![0u32; n_tiles + 1];
        for record in &records {
            for tile in record.tiles[0]..record.tiles[1] {
                starts[usize::from(tile) + 1] += 1;
            }
        }
        for tile in 0..n_tiles {
            starts[tile + 1] += starts[tile];
        }
        let mut ends = starts.clone();
        let mut entries = vec![0; starts[n_tiles] as usize];
        for (index, record) in (0u32..).zip(&records) {
            for tile in record.tiles[0]..record.tiles[1] {
                let end = &mut ends[usize::from(tile)];
                entries[*end as usize] = index;
                *end += 1;
            }
        }
        Self {
            top: index * TILE,
            records,
            needles,
            starts,
            entries,
            transmittance: Vec::new(),
            last: Vec::new(),
        }
    }

    /// The needles among the band's splats, of which `ids` are given.
    pub fn needle_ids(&self, ids: &[u32]) -> Vec<u32> {
        if self.needles.is_empty() {
            return Vec::new();
        }
        let records = ids.iter().zip(&self.records);
        let needles = records.filter(|(_, record)| record.needle != NO_NEEDLE);
        needles.map(|(&id, _)| id).collect()
    }

    /// The needle of a record; `None` for other splats.
    #[inline(always)]
    fn needle(&self, record: &Record) -> Option<&Needle<f32>> {
        self.needles.get(record.needle as usize)
    }

    /// The same as a tile with this left edge sees it.
    #[inline(always)]
    pub fn needle_in_tile(&self, record: &Record, left: f32) -> Option<NeedleInTile> {
        let needle = self.needle(record)?;
        Some(NeedleInTile::new(needle, [left, self.top as f32]))
    }

    /// The splats of a tile, front to back, as indices into `records`.
    #[inline(always)]
    pub fn tile(&self, tile: usize) -> &[u32] {
        &self.entries[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }
}
