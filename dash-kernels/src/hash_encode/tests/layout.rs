//! Level sizes are exact for every table size and resolution, and bad configurations are refused.

use crate::KernelError;
use crate::hash_encode::{
    HASH_PRIMES, HashGridConfig, HashGridLayout, HashGridLevel, Interpolation, LevelSizing,
};

fn config(base: &[u32], finest: &[u32]) -> HashGridConfig {
    HashGridConfig {
        n_levels: 32,
        n_features_per_level: 2,
        log2_hashmap_size: 19,
        base_resolution: base.to_vec(),
        finest_resolution: finest.to_vec(),
        interpolation: Interpolation::Linear,
        sizing: LevelSizing::Paper,
    }
}

fn sized(config: &HashGridConfig) -> HashGridLayout {
    HashGridLayout::new(config).expect("a good configuration")
}

#[test]
fn five_levels_by_hand() {
    // b = 2 on the first axis, 1 on the second.
    let mut config = config(&[2, 3], &[32, 3]);
    config.n_levels = 5;
    config.log2_hashmap_size = 6;
    let layout = sized(&config);
    let sizes: Vec<_> = layout.levels().iter().map(|l| (l.size, l.dense)).collect();
    // Vertices 3x4, 5x4, 9x4, then 17x4 = 68 and 33x4 = 132 exceed 64.
    assert_eq!(
        sizes,
        [(12, true), (20, true), (36, true), (64, false), (64, false)]
    );
    let scales: Vec<_> = layout.levels().iter().map(|l| l.scale[0]).collect();
    assert_eq!(scales, [2.0, 4.0, 8.0, 16.0, 32.0]);
    assert_eq!(layout.levels()[3].offset, 68);
    assert_eq!(layout.n_entries(), 196);
    assert_eq!(layout.n_features(), 10);

    config.sizing = LevelSizing::Reference;
    let layout = sized(&config);
    // Scales 1, 3, 7, 15, 31: one vertex less per axis than cells of the paper's.
    let sizes: Vec<_> = layout.levels().iter().map(|l| (l.size, l.dense)).collect();
    assert_eq!(
        sizes,
        [(6, true), (12, true), (24, true), (48, true), (64, false)]
    );
}

#[test]
fn rows_by_hand() {
    let dense = HashGridLevel {
        scale: [2.0, 3.0, 4.0, 0.0],
        resolution: [3, 4, 5, 1],
        offset: 100,
        size: 60,
        dense: true,
    };
    assert_eq!(dense.row(&[2, 1, 3]), 2 + 3 + 3 * 12);
    let hashed = HashGridLevel {
        size: 16,
        dense: false,
        ..dense
    };
    let expected = (2u32 ^ 2_654_435_761 ^ 3u32.wrapping_mul(805_459_861)) % 16;
    assert_eq!(hashed.row(&[2, 1, 3]), u64::from(expected));
    assert_eq!(HASH_PRIMES, [1, 2654435761, 805459861, 3674653429]);
}

/// Every level of every table size from 2^1 to 2^24, for resolutions up to 65,536: consistent
/// with arithmetic in u128, nothing wraps.
#[test]
fn sizes_are_exact_for_every_table_and_resolution() {
    for sizing in [LevelSizing::Paper, LevelSizing::Reference] {
        for log2 in 1..=24 {
            for finest in [1, 2, 25, 2047, 2048, 2049, 65_535, 65_536] {
                for dims in 2..=4 {
                    let mut config = config(&vec![1.max(finest / 256); dims], &vec![finest; dims]);
                    config.log2_hashmap_size = log2;
                    config.n_levels = 16;
                    config.sizing = sizing;
                    check(&sized(&config), &config);
                }
            }
        }
    }
}

fn check(layout: &HashGridLayout, config: &HashGridConfig) {
    let dims = config.base_resolution.len();
    let mut offset = 0;
    for level in layout.levels() {
        let vertices: u128 = level.resolution[..dims]
            .iter()
            .map(|&r| u128::from(r))
            .product();
        let capacity = 1u128 << config.log2_hashmap_size;
        assert_eq!(u128::from(level.size), vertices.min(capacity), "{config:?}");
        assert_eq!(level.dense, vertices <= capacity, "{config:?}");
        assert_eq!(level.offset, offset);
        offset += level.size;
        for axis in 0..dims {
            let (scale, resolution) = (level.scale[axis], level.resolution[axis]);
            assert!(resolution >= 2);
            assert!(
                scale <= (resolution - 1) as f64,
                "a point at 1 stays in the grid"
            );
            if level.dense {
                let last: Vec<u64> = level.resolution[..dims].iter().map(|r| r - 1).collect();
                assert_eq!(level.row(&last), level.size - 1);
            }
        }
    }
    assert_eq!(layout.n_entries() as u64, offset);
    let finest = layout.levels().last().expect("16 levels");
    for axis in 0..dims {
        let n_max = config.finest_resolution[axis];
        let expected = match config.sizing {
            LevelSizing::Paper => f64::from(n_max),
            LevelSizing::Reference => f64::from(n_max) - 1.0,
        };
        assert_eq!(
            finest.scale[axis], expected,
            "the finest level is exactly N_max"
        );
    }
}

/// Octaves: N_min 2^l is exact although `exp` and `ln` are not.
#[test]
fn powers_of_two_are_exact() {
    for base in [1, 2, 3, 5, 7, 8, 16, 100] {
        let mut config = config(&[base; 3], &[base << 9; 3]);
        config.n_levels = 10;
        for (l, level) in sized(&config).levels().iter().enumerate() {
            assert_eq!(level.scale[0], f64::from(base << l));
        }
    }
}

/// The released preset's 4D grid holds 13.05 M entries.
#[test]
fn the_released_preset_has_its_published_size() {
    let mut config = config(&[8; 4], &[2048, 2048, 2048, 25]);
    config.sizing = LevelSizing::Reference;
    let entries = sized(&config).n_entries() as f64;
    assert!((entries - 13.05e6).abs() < 0.01e6, "{entries}");
}

#[test]
fn one_level_and_one_entry() {
    let mut config = config(&[4, 4], &[64, 64]);
    config.n_levels = 1;
    config.log2_hashmap_size = 0;
    let layout = sized(&config);
    assert_eq!(
        layout.levels()[0].scale[0],
        4.0,
        "a single level has the base resolution"
    );
    assert_eq!(layout.n_entries(), 1);
    assert_eq!(layout.levels()[0].row(&[3, 2]), 0);
}

#[test]
fn bad_configurations_are_refused() {
    let good = config(&[8; 3], &[128; 3]);
    type Spoil = fn(&mut HashGridConfig);
    let spoils: [(&str, Spoil); 10] = [
        ("axes", |c| c.base_resolution = vec![8]),
        ("axes", |c| c.base_resolution = vec![8; 5]),
        ("finest_resolution", |c| c.finest_resolution = vec![128; 2]),
        ("axis 1", |c| c.base_resolution[1] = 0),
        ("axis 2", |c| c.finest_resolution[2] = 7),
        ("axis 0", |c| c.finest_resolution[0] = u32::MAX),
        ("n_levels", |c| c.n_levels = 0),
        ("n_features_per_level", |c| c.n_features_per_level = 3),
        ("log2_hashmap_size", |c| c.log2_hashmap_size = 32),
        ("entries", |c| {
            c.log2_hashmap_size = 31;
            c.finest_resolution = vec![1 << 20; 3];
        }),
    ];
    for (word, spoil) in spoils {
        let mut bad = good.clone();
        spoil(&mut bad);
        let Err(KernelError::Config { what, .. }) = HashGridLayout::new(&bad) else {
            panic!("accepted {bad:?}");
        };
        assert!(what.contains(word), "{what:?} does not mention {word}");
    }
}

#[test]
fn parts_hold_the_levels_of_the_whole() {
    let layout = super::small_layout(3, 4, |_| ());
    let sizes: Vec<usize> = layout
        .levels()
        .iter()
        .map(|l| l.size as usize * 4)
        .collect();
    for max_values in [1, sizes[0] + sizes[1], 3 * 512 * 4, usize::MAX] {
        let parts = layout.chunks(max_values);
        let mut from_parts = Vec::new();
        for part in &parts {
            let n_values = part.n_entries() * 4;
            assert!(
                n_values <= max_values || part.n_levels() == 1,
                "{max_values}"
            );
            assert_eq!(part.levels()[0].offset, 0);
            let before: u64 = from_parts.iter().map(|l: &HashGridLevel| l.size).sum();
            from_parts.extend(part.levels().iter().map(|l| HashGridLevel {
                offset: l.offset + before,
                ..*l
            }));
        }
        assert_eq!(from_parts, layout.levels());
        // As few as there can be, in this order.
        for pair in parts.windows(2) {
            let first_of_next = pair[1].levels()[0].size as usize * 4;
            assert!(pair[0].n_entries() * 4 + first_of_next > max_values);
        }
    }
    assert_eq!(layout.chunks(usize::MAX).len(), 1);
    assert_eq!(layout.chunks(1).len(), layout.n_levels());
}
